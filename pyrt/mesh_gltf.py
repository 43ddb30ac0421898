"""Rewrites glTF files so that trimesh reads all of them, and names what pyrt does not use.

trimesh drops the texture coordinates of glTF primitives whose material it does not load.
"""

from __future__ import annotations

import json
import struct
from typing import Any

_UNUSED = ("materials", "textures", "cameras", "animations", "skins")
# extensions that change no geometry
_HARMLESS = ("KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_")
_GLB_HEADER = struct.Struct("<4sII")
_CHUNK_HEADER = struct.Struct("<I4s")
UV_ATTRIBUTE = "_UV"  # trimesh keeps attributes that start with an underscore


def prepare_gltf(content: bytes, extension: str) -> tuple[bytes, list[str]]:
    """The file with texture coordinates copied to UV_ATTRIBUTE, and warnings.

    Raises ValueError for a file that needs an extension which pyrt does not read, such as compressed geometry.
    """
    if extension == "gltf":
        tree = json.loads(content)
        warnings = _adapt(tree)
        return json.dumps(tree).encode(), warnings
    magic, version, _ = _GLB_HEADER.unpack_from(content)
    length, kind = _CHUNK_HEADER.unpack_from(content, _GLB_HEADER.size)
    if magic != b"glTF" or kind != b"JSON":
        raise ValueError("it has no glTF header")
    start = _GLB_HEADER.size + _CHUNK_HEADER.size
    tree = json.loads(content[start : start + length])
    warnings = _adapt(tree)
    text = json.dumps(tree).encode()
    text += b" " * (-len(text) % 4)
    chunks = _CHUNK_HEADER.pack(len(text), b"JSON") + text + content[start + length :]
    return _GLB_HEADER.pack(magic, version, _GLB_HEADER.size + len(chunks)) + chunks, warnings


def _adapt(tree: dict[str, Any]) -> list[str]:
    for name in tree.get("extensionsRequired", []):
        if not name.startswith(_HARMLESS):
            raise ValueError(f"it needs the glTF extension {name}, which pyrt does not read")
    for mesh in tree.get("meshes", []):
        for primitive in mesh["primitives"]:
            attributes = primitive["attributes"]
            if "TEXCOORD_0" in attributes:
                attributes[UV_ATTRIBUTE] = attributes["TEXCOORD_0"]
    unused = [key for key in _UNUSED if tree.get(key)]
    unused += ["lights"] * ("KHR_lights_punctual" in tree.get("extensionsUsed", []))
    return [f"its {' and '.join(unused)} are not used"] if unused else []
