"""Opens glTF 2.0 files, binary (GLB) or JSON, and reads their accessors and images.

Files are data from anywhere: every index, offset and size is checked against what is there before memory is taken for
it, and a file refers only to files in its own folder and below, never to the network.
"""

from __future__ import annotations

import base64
import binascii
import os
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, TypeVar
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import SceneError
from pyrt.files import read_bytes
from pyrt.gltf_schema import Accessor, Gltf, Sparse, parse_gltf
from pyrt.schema_errors import quote

_MAGIC = b"glTF"
_HEADER = struct.Struct("<4sII")
_CHUNK = struct.Struct("<I4s")
_COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}
_MAX_ZEROS = 2**20  # elements of an accessor that no bytes of the file stand for

# What a file may require: pyrt reads it, or it changes only the look of surfaces, and a warning says so.
_READ = ("KHR_materials_", "KHR_texture_", "EXT_texture_", "KHR_lights_", "KHR_mesh_quantization", "KHR_node_visib")

T = TypeVar("T")


@dataclass(frozen=True)
class Document:
    """A file's JSON, and the bytes that it refers to as far as they have been read."""

    folder: Path
    tree: Gltf
    chunk: bytes | None  # the binary part of a GLB
    buffers: dict[int, bytes] = field(default_factory=dict)


def open_gltf(path: str | os.PathLike[str], content: bytes) -> Document:
    """Parses a file's JSON; buffers and images are read when they are asked for.

    Raises:
        SceneError: the content is damaged, or requires an extension that pyrt does not read, such as
            compressed geometry.
    """
    text, chunk = _chunks(content) if content.startswith(_MAGIC) or _is_binary(path) else (content, None)
    document = Document(Path(path).parent, parse_gltf(text), chunk)
    if not document.tree.asset.version.startswith("2."):
        raise SceneError(f"expected glTF version 2, found {quote(document.tree.asset.version)}")
    for name in document.tree.extensionsRequired:
        if not name.startswith(_READ):
            raise SceneError(f"it needs the glTF extension {quote(name)}, which pyrt does not read")
    return document


def at(entries: Sequence[T], index: int, place: str, kind: str) -> T:
    """entries[index]. Raises SceneError for an index that refers to nothing."""
    if index >= len(entries):
        raise SceneError(f"{place}: no {kind} {index}, there are {len(entries)}")
    return entries[index]


def read_accessor(document: Document, index: int, place: str, types: tuple[str, ...]) -> NDArray[Any]:
    """(count, components) values in their own type, or in float64 where they are fractions or floats.

    Raises SceneError for a type that is not among `types`, and for what lies outside of the file.
    """
    accessor = at(document.tree.accessors, index, place, "accessor")
    place = f"accessors[{index}]"
    if accessor.type not in types:
        raise SceneError(f"{place}.type: expected {' or '.join(types)}, got {quote(accessor.type)}")
    kind, width = np.dtype(_COMPONENTS[accessor.componentType]), _WIDTHS[accessor.type]
    if accessor.bufferView is not None:
        values = _view(document, accessor.bufferView, place, accessor.byteOffset, accessor.count, kind, width)
    elif accessor.count <= _MAX_ZEROS:
        values = np.zeros((accessor.count, width), kind)
    else:
        raise SceneError(f"{place}.count: expected at most {_MAX_ZEROS} without a bufferView, got {accessor.count}")
    if accessor.sparse is not None:
        values = _with_sparse(document, f"{place}.sparse", accessor.sparse, values)
    return _as_numbers(values, accessor)


def image_bytes(document: Document, index: int, place: str) -> bytes:
    """The encoded bytes of an image."""
    image = at(document.tree.images, index, place, "image")
    place = f"images[{index}]"
    if image.bufferView is not None:
        view = at(document.tree.bufferViews, image.bufferView, place, "bufferView")
        return _view(document, image.bufferView, place, 0, view.byteLength, np.dtype("u1"), 1).tobytes()
    if image.uri is None:
        raise SceneError(f'{place}: expected "uri" or "bufferView", found neither')
    return _uri(document, image.uri, place)


def _is_binary(path: str | os.PathLike[str]) -> bool:
    return Path(path).suffix.lower() == ".glb"


def _chunks(content: bytes) -> tuple[bytes, bytes | None]:
    """The JSON and the binary chunk of a GLB."""
    if len(content) < _HEADER.size + _CHUNK.size or not content.startswith(_MAGIC):
        raise SceneError("it has no glTF header")
    _, version, length = _HEADER.unpack_from(content)
    if version != 2:
        raise SceneError(f"expected GLB version 2, found {version}")
    if length > len(content):
        raise SceneError(f"its header says {length} bytes, the file has {len(content)}")
    chunks: dict[bytes, bytes] = {}
    start = _HEADER.size
    while start + _CHUNK.size <= length:
        size, kind = _CHUNK.unpack_from(content, start)
        start += _CHUNK.size
        if start + size > length:
            raise SceneError(f"a chunk says {size} bytes, {length - start} are left")
        chunks.setdefault(kind, content[start : start + size])
        start += size
    if b"JSON" not in chunks:
        raise SceneError("it has no JSON chunk")
    return chunks[b"JSON"], chunks.get(b"BIN\0")


def _buffer(document: Document, index: int, place: str) -> bytes:
    buffer = at(document.tree.buffers, index, place, "buffer")
    place = f"buffers[{index}]"
    if index not in document.buffers:
        if buffer.uri is not None:
            document.buffers[index] = _uri(document, buffer.uri, place)
        elif index == 0 and document.chunk is not None:
            document.buffers[index] = document.chunk
        else:
            raise SceneError(f'{place}: missing key "uri"')
    content = document.buffers[index]
    if buffer.byteLength > len(content):
        raise SceneError(f"{place}.byteLength: {buffer.byteLength} bytes, {len(content)} are there")
    return content


def _uri(document: Document, uri: str, place: str) -> bytes:
    """The content of a data URI, or of a file in the document's folder or below."""
    if uri.startswith("data:"):
        head, comma, data = uri.partition(",")
        try:
            if not comma or not head.endswith(";base64"):
                raise SceneError(f"{place}.uri: expected base64 data, got {quote(head)}")
            return base64.b64decode(data, validate=True)
        except (binascii.Error, ValueError):
            raise SceneError(f"{place}.uri: its base64 data is damaged") from None
    name = unquote(uri)
    parts = PurePosixPath(name.replace("\\", "/")).parts
    if ":" in name or ".." in parts or name.startswith(("/", "\\")) or not parts:
        raise SceneError(f"{place}.uri: expected a file in the model's folder or below, got {quote(uri)}")
    try:
        return read_bytes(document.folder.joinpath(*parts))
    except SceneError as error:
        raise SceneError(f"{place}.uri: {error}") from None


def _view(
    document: Document, index: int, place: str, offset: int, count: int, kind: np.dtype[Any], width: int
) -> NDArray[Any]:
    """(count, width) elements of a buffer view, from an offset in it."""
    view = at(document.tree.bufferViews, index, place, "bufferView")
    content = _buffer(document, view.buffer, f"bufferViews[{index}]")
    if view.byteOffset + view.byteLength > len(content):
        end = view.byteOffset + view.byteLength
        raise SceneError(f"bufferViews[{index}]: it ends at byte {end}, its buffer at {len(content)}")
    element = kind.itemsize * width
    stride = view.byteStride or element
    end = offset + (count - 1) * stride + element
    if end > view.byteLength:
        raise SceneError(f"{place}: its {count} elements end at byte {end}, bufferViews[{index}] at {view.byteLength}")
    strides = (stride, kind.itemsize)
    return np.ndarray((count, width), kind, content, view.byteOffset + offset, strides)


def _with_sparse(document: Document, place: str, sparse: Sparse, values: NDArray[Any]) -> NDArray[Any]:
    kind = np.dtype(_COMPONENTS[sparse.indices.componentType])
    if kind.kind != "u":
        raise SceneError(f"{place}.indices.componentType: expected 5121, 5123 or 5125, got {kind}")
    of, new = sparse.indices, sparse.values
    rows = _view(document, of.bufferView, f"{place}.indices", of.byteOffset, sparse.count, kind, 1)[:, 0]
    width = values.shape[1]
    replaced = _view(document, new.bufferView, f"{place}.values", new.byteOffset, sparse.count, values.dtype, width)
    if rows.max() >= len(values):
        raise SceneError(f"{place}.indices: no element {rows.max()}, there are {len(values)}")
    values = values.copy()
    values[rows] = replaced
    return values


def _as_numbers(values: NDArray[Any], accessor: Accessor) -> NDArray[Any]:
    if values.dtype.kind == "f":
        return values.astype(np.float64)
    if not accessor.normalized:
        return values
    fractions: NDArray[Any] = np.maximum(values / np.iinfo(values.dtype).max, -1.0)
    return fractions
