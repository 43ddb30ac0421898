"""Reads Wavefront OBJ: polygons, whose corners name their position, texture coordinates and normal by number.

The format's curves and groups are not read. A reader of our own, because importing trimesh takes longer than a small
picture.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_TABLES = ("v", "vt", "vn")  # in the order in which a corner refers to them
_COLUMNS = (3, 2, 3)
_NOISE = re.compile(rb"#[^\n]*|\\ *\n")  # comments, and line ends that are none
_NUMBER = re.compile(rb"\d+")
_FORMS = {b"1", b"1/", b"1//", b"1/1", b"1/1/", b"1//1", b"1/1/1"}  # of a corner
_MIXED = b""
_MAX_INDEX = 1 << 62


class ObjData(NamedTuple):
    """What the file holds. Polygons are cut into triangles around their first corner.

    `corners` holds the rows of each triangle's corners in the three tables, −1 where the file gives none.
    """

    positions: NDArray[np.float64]  # (n, 3)
    uvs: NDArray[np.float64]  # (k, 2)
    normals: NDArray[np.float64]  # (l, 3)
    corners: NDArray[np.int64]  # (m, 3 corners, 3 tables)
    colors: NDArray[np.float64] | None  # (n, 3) of the positions, as stored
    materials: dict[str, NDArray[np.int64]]  # rows of the triangles of each, "" for those without one
    libraries: tuple[str, ...]  # files that define the materials
    warnings: tuple[str, ...]


@dataclass
class _Lines:
    """The texts of the file's rows of numbers by element, and of its faces with absolute indices."""

    tables: dict[bytes, list[bytes]] = field(default_factory=lambda: {name.encode(): [] for name in _TABLES})
    faces: list[bytes] = field(default_factory=list)
    materials: dict[int, str] = field(default_factory=lambda: {0: ""})  # by the number of the first face
    libraries: list[str] = field(default_factory=list)


def read_obj(content: bytes) -> ObjData:
    """Parses a file. Raises ValueError for what is not a number, or an index that refers to nothing."""
    lines = _sorted(content)
    tables = [_table(*of) for of in zip(lines.tables.values(), _COLUMNS, strict=True)]
    sizes, indices = _polygons(lines.faces)
    places, corners = _triangles(sizes, indices)
    for of, name, table in zip(corners.reshape(-1, 3).T, _TABLES, tables, strict=True):
        if of.max(initial=-1) >= len(table):
            raise ValueError(f"a face refers to {name} {of.max() + 1}, there are {len(table)}")
    return ObjData(
        tables[0],
        tables[1],
        tables[2],
        corners,
        _colors(lines.tables[b"v"]),
        _rows_by_material(lines.materials, places),
        tuple(lines.libraries),
        tuple(_warnings(sizes, corners)),
    )


def _sorted(content: bytes) -> _Lines:
    lines = _Lines()
    text = content.replace(b"\r", b" ").replace(b"\t", b" ")
    for line in _NOISE.sub(b" ", text).split(b"\n"):
        key, _, values = line.lstrip().partition(b" ")
        if key in lines.tables:
            lines.tables[key].append(values)
        elif key == b"f":
            lines.faces.append(_absolute(values, lines) if b"-" in values else values)
        elif key == b"usemtl":
            lines.materials[len(lines.faces)] = values.strip().decode("utf-8", "replace")
        elif key == b"mtllib":
            lines.libraries.append(values.strip().decode("utf-8", "replace"))
    return lines


def _absolute(face: bytes, lines: _Lines) -> bytes:
    """The face with indices from the start of the file in place of those (−1, −2 …) back from here."""
    counts = [len(rows) for rows in lines.tables.values()]

    def absolute(index: bytes, count: int) -> bytes:
        if not index.startswith(b"-"):
            return index
        if int(index) + count < 0:
            raise ValueError(f"a face refers to index {int(index)}")
        return b"%d" % (int(index) + count + 1)

    corners = [corner.split(b"/") for corner in face.split()]
    return b" ".join(b"/".join(map(absolute, corner, counts)) for corner in corners)


def _table(rows: list[bytes], columns: int) -> NDArray[np.float64]:
    """The first `columns` numbers of each row, missing ones as 0."""
    width = len(rows[0].split()) if rows else columns
    if width < columns or any(len(row.split()) != width for row in rows):
        rows = [b" ".join([*row.split(), *[b"0"] * columns][:columns]) for row in rows]
        width = columns
    return _numbers(b" ".join(rows), np.float64).reshape(len(rows), width)[:, :columns]


def _numbers(text: bytes, kind: type) -> NDArray[Any]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # older numpy only warns of what is not a number
        try:
            return np.fromstring(text, kind, sep=" ")
        except (DeprecationWarning, ValueError):
            raise ValueError("a coordinate is not a number") from None


def _polygons(faces: list[bytes]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """The number of corners of each face, and of all corners, one face's after another's, the indices (n, 3) from 0,
    −1 where there is none.

    Faces whose corners all have the same form, such as 1//1, are read together, whatever their sizes.
    """
    sizes = np.zeros(len(faces), np.int64)
    known: dict[bytes, tuple[int, bytes]] = {}
    alike: dict[bytes, list[int]] = {}
    for place, form in enumerate(_NUMBER.sub(b"1", b"\n".join(faces)).split(b"\n") if faces else []):
        if form not in known:
            known[form] = _form(form, faces[place])
        sizes[place], corner = known[form]
        alike.setdefault(corner, []).append(place)
    starts = np.cumsum(sizes) - sizes
    corners = np.full((sizes.sum(), 3), -1, np.int64)
    for corner, places in alike.items():
        rows = np.repeat(starts[places], sizes[places]) + _counted(sizes[places])
        texts = [faces[place] for place in places]
        if corner == _MIXED:
            corners[rows] = [_indices(one) for text in texts for one in text.split()]
        else:
            given = [k for k, index in enumerate(corner.split(b"/")) if index]
            numbers = _numbers(b" ".join(texts).replace(b"/", b" "), np.int64)
            corners[rows[:, None], given] = numbers.reshape(len(rows), len(given)) - 1
            if numbers.min(initial=1) < 1:
                raise ValueError("a face refers to index 0")
    return sizes, corners


def _form(form: bytes, face: bytes) -> tuple[int, bytes]:
    """How many corners a face has, and the form of all of them; `form`: the face with 1 for each number."""
    corners = form.split()
    kinds = set(corners)
    if not kinds <= _FORMS:
        raise ValueError(f"a face is not made of indices: {face.decode('utf-8', 'replace')}")
    return len(corners), kinds.pop() if len(kinds) == 1 else _MIXED


def _indices(corner: bytes) -> list[int]:
    """Of one corner, from 0, −1 where there is none."""
    given = [min(int(index), _MAX_INDEX) if index else None for index in corner.split(b"/")]
    if 0 in given:
        raise ValueError("a face refers to index 0")
    return [-1 if index is None else index - 1 for index in [*given, None, None][:3]]


def _counted(sizes: NDArray[np.int64]) -> NDArray[np.int64]:
    """0, 1 … size − 1 of each size, one after another."""
    return np.arange(sizes.sum()) - np.repeat(np.cumsum(sizes) - sizes, sizes)


def _triangles(sizes: NDArray[np.int64], corners: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All polygons as fans: the place of each triangle's polygon, and its corners (m, 3 corners, 3)."""
    fans = np.maximum(sizes - 2, 0)
    first = np.repeat(np.cumsum(sizes) - sizes, fans)
    last = first + 2 + _counted(fans)
    return np.repeat(np.arange(len(sizes)), fans), corners[np.stack([first, last - 1, last], axis=1)]


def _colors(rows: list[bytes]) -> NDArray[np.float64] | None:
    """The numbers behind the positions, an extension of the format, if all rows have them."""
    if not rows or any(len(row.split()) < 6 for row in rows):
        return None
    return np.clip(_table(rows, 6)[:, 3:], 0, 1)


def _rows_by_material(materials: dict[int, str], places: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
    starts = np.searchsorted(places, list(materials)).tolist()
    rows: dict[str, list[NDArray[np.int64]]] = {}
    for name, first, end in zip(materials.values(), starts, [*starts[1:], len(places)], strict=True):
        if first < end:
            rows.setdefault(name, []).append(np.arange(first, end))
    return {name: np.concatenate(parts) for name, parts in rows.items()}


def _warnings(sizes: NDArray[np.int64], corners: NDArray[np.int64]) -> list[str]:
    uvs, normals = (corners[:, :, k].min(axis=1) >= 0 for k in (1, 2))
    return [
        *["its faces with fewer than 3 corners are dropped"] * bool((sizes < 3).any()),
        *["its texture coordinates do not cover every face"] * bool(uvs.any() > uvs.all()),
        *["its normals do not cover every face"] * bool(normals.any() > normals.all()),
    ]
