"""Makes glTF files in memory: JSON and the bytes that it refers to."""

from __future__ import annotations

import base64
import json
import struct
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np

_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
_COMPONENTS = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}


class GltfFile:
    """The JSON of a file as a dict, `tree`, and its one buffer."""

    def __init__(self, **sections: Any):
        self.data = b""
        self.tree: dict[str, Any] = {"asset": {"version": "2.0"}, "bufferViews": [], "accessors": [], "meshes": []}
        self.tree.update(deepcopy(sections))

    def view(self, data: bytes, **extra: Any) -> int:
        self.data += bytes(-len(self.data) % 4)
        view = {"buffer": 0, "byteOffset": len(self.data), "byteLength": len(data), **extra}
        self.tree["bufferViews"].append(view)
        self.data += data
        return len(self.tree["bufferViews"]) - 1

    def accessor(self, values: Any, kind: str = "f4", **extra: Any) -> int:
        array = np.asarray(values, kind)
        width = array.shape[1] if array.ndim == 2 else 1
        entry = {
            "bufferView": self.view(array.tobytes()),
            "componentType": _COMPONENTS[kind],
            "count": len(array),
            "type": _TYPES[width],
            **extra,
        }
        self.tree["accessors"].append(entry)
        return len(self.tree["accessors"]) - 1

    def mesh(
        self, positions: Any, indices: Any = None, *, mode: int = 4, material: int | None = None, **more: Any
    ) -> int:
        """Adds a mesh of one primitive; `more` are its attributes by name, arrays or numbers of accessors."""
        attributes = {"POSITION": self.accessor(positions)}
        for name, values in more.items():
            attributes[name] = values if isinstance(values, int) else self.accessor(values)
        primitive: dict[str, Any] = {"attributes": attributes, "mode": mode}
        if indices is not None:
            primitive["indices"] = indices if isinstance(indices, int) else self.accessor(indices, "u2")
        if material is not None:
            primitive["material"] = material
        self.tree["meshes"].append({"primitives": [primitive]})
        return len(self.tree["meshes"]) - 1

    def glb(self) -> bytes:
        tree = {"buffers": [{"byteLength": max(len(self.data), 1)}], **self.tree}
        text = json.dumps(tree).encode()
        text += b" " * (-len(text) % 4)
        data = self.data + bytes(-len(self.data) % 4) or bytes(4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def gltf(self) -> bytes:
        """The JSON form, with its buffer in a data URI."""
        uri = "data:application/octet-stream;base64," + base64.b64encode(self.data).decode()
        return json.dumps({"buffers": [{"byteLength": len(self.data), "uri": uri}], **self.tree}).encode()

    def save(self, path: Path) -> Path:
        path.write_bytes(self.glb() if path.suffix == ".glb" else self.gltf())
        return path
