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
    polygons = _polygons(lines.faces)
    places, corners = _triangles([rows for rows in polygons if rows[1].shape[1] >= 3])
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
        tuple(_warnings(polygons, corners)),
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


def _polygons(faces: list[bytes]) -> list[tuple[NDArray[np.int64], NDArray[np.int64]]]:
    """Faces of one form (number of corners, and what these refer to) at a time: their places in the file, and indices
    (faces, corners, 3) from 0, −1 where there is none."""
    forms: dict[bytes, list[int]] = {}
    for place, form in enumerate(_NUMBER.sub(b"1", b"\n".join(faces)).split(b"\n") if faces else []):
        forms.setdefault(form, []).append(place)
    groups = []
    for form, places in forms.items():
        corners = [corner.split(b"/") for corner in form.split()]
        if any(index not in (b"1", b"") or not corner[0] for corner in corners for index in corner):
            raise ValueError(f"a face is not made of indices: {faces[places[0]].decode('utf-8', 'replace')}")
        given = [(i, k) for i, corner in enumerate(corners) for k, index in enumerate(corner[:3]) if index]
        text = b" ".join([faces[place] for place in places]).replace(b"/", b" ")
        numbers = _numbers(text, np.int64).reshape(len(places), -1)
        if numbers.min(initial=1) < 1:
            raise ValueError("a face refers to index 0")
        indices = np.full((len(places), len(corners), 3), -1, np.int64)
        for column, (i, k) in enumerate(given):
            indices[:, i, k] = numbers[:, column] - 1
        groups.append((np.array(places), indices))
    return groups


def _triangles(
    polygons: list[tuple[NDArray[np.int64], NDArray[np.int64]]],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """All polygons as fans, in the order of the file: their places there, and corners."""
    places, triangles = [np.empty(0, np.int64)], [np.empty((0, 3, 3), np.int64)]
    for place, indices in polygons:
        last = np.arange(2, indices.shape[1])
        places.append(np.repeat(place, len(last)))
        triangles.append(indices[:, np.stack([0 * last, last - 1, last], axis=1)].reshape(-1, 3, 3))
    of_triangle = np.concatenate(places)
    order = np.argsort(of_triangle, kind="stable")
    return of_triangle[order], np.concatenate(triangles)[order]


def _colors(rows: list[bytes]) -> NDArray[np.float64] | None:
    """The numbers behind the positions, an extension of the format, if all rows have them."""
    if not rows or any(len(row.split()) < 6 for row in rows):
        return None
    return np.clip(_table(rows, 6)[:, 3:], 0, 1)


def _rows_by_material(materials: dict[int, str], places: NDArray[np.int64]) -> dict[str, NDArray[np.int64]]:
    starts, names = np.array(list(materials)), list(materials.values())
    of_triangle = np.searchsorted(starts, places, side="right") - 1
    rows: dict[str, list[NDArray[np.int64]]] = {}
    for i in np.flatnonzero(np.bincount(of_triangle)):  # np.unique would sort, and import numpy.ma
        rows.setdefault(names[i], []).append(np.flatnonzero(of_triangle == i))
    return {name: np.concatenate(parts) for name, parts in rows.items()}


def _warnings(polygons: list[Any], corners: NDArray[np.int64]) -> list[str]:
    uvs, normals = (corners[:, :, k].min(axis=1) >= 0 for k in (1, 2))
    return [
        *["its faces with fewer than 3 corners are dropped"] * any(of.shape[1] < 3 for _, of in polygons),
        *["its texture coordinates do not cover every face"] * bool(uvs.any() > uvs.all()),
        *["its normals do not cover every face"] * bool(normals.any() > normals.all()),
    ]
