"""Reads triangle meshes: PLY, STL, OFF, GLB and glTF by trimesh, OBJ without it.

A file's parts are joined into one mesh in the file's world space. Texture coordinates are taken as they are stored; the
file's materials, colours, lights and cameras are not used, and a warning names them.
"""

from __future__ import annotations

import io
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrt.errors import SceneError
from pyrt.files import read_bytes
from pyrt.mesh_gltf import UV_ATTRIBUTE, prepare_gltf
from pyrt.mesh_obj import read_obj

FORMATS = ("obj", "ply", "stl", "off", "glb", "gltf")
_DEFAULT_UVS = np.array([[0, 0], [1, 0], [1, 1]], np.float32)
_FLIP = [0, 2, 1]


class MeshData(NamedTuple):
    """Triangles with optional texture coordinates and unit shading normals per corner."""

    vertices: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    uvs: NDArray[np.float32] | None = None  # (m, 3, 2)
    normals: NDArray[np.float32] | None = None  # (m, 3, 3)
    warnings: tuple[str, ...] = ()  # what the file holds and pyrt does not use


def load_mesh(path: str | os.PathLike[str]) -> MeshData:
    """Reads a mesh file; its extension tells the format.

    Vertices at equal positions in the file stay bit-equal, so that a closed mesh stays closed. Degenerate triangles and
    non-finite vertices are kept. Where only some parts of a file have texture coordinates, the others get (0,0), (1,0),
    (1,1); where only some have normals, the others are flat. An OBJ file's parts are its triangles.

    Raises:
        SceneError: the file cannot be read, is not of its format, or holds no triangle.
    """
    extension = Path(path).suffix.lower().removeprefix(".")
    if extension not in FORMATS:
        raise SceneError(f"{path}: expected a mesh file ending in {', '.join('.' + f for f in FORMATS)}")
    content = read_bytes(path)
    try:
        with np.errstate(all="ignore"):  # what is not finite is dropped later, and counted
            mesh = _from_obj(content) if extension == "obj" else _parse(content, extension, path)
    except Exception as error:  # on malformed files trimesh raises whatever comes up
        reason = str(error).strip().split("\n")[0] or type(error).__name__
        raise SceneError(f"{path}: not a readable {extension.upper()} mesh: {reason}") from None
    if len(mesh.triangles) == 0:
        raise SceneError(f"{path}: the mesh has no triangle")
    return mesh._replace(warnings=tuple(f"{path}: {warning}" for warning in mesh.warnings))


def transformed(mesh: MeshData, matrix: ArrayLike) -> MeshData:
    """The mesh under an invertible affine 4×4 matrix, for column vectors; normals by the inverse transpose.

    A mirroring matrix also swaps two corners of each triangle, so that the outside of a closed mesh stays its front.
    """
    matrix = np.asarray(matrix, np.float64)
    linear = matrix[:3, :3]
    order = _FLIP if np.linalg.det(linear) < 0 else [0, 1, 2]
    normals = mesh.normals
    if normals is not None:
        normals = _unit(_apply(np.linalg.inv(linear).T, normals[:, order].astype(np.float64))).astype(np.float32)
    return mesh._replace(
        vertices=_apply(linear, mesh.vertices) + matrix[:3, 3],
        triangles=mesh.triangles[:, order],
        uvs=None if mesh.uvs is None else mesh.uvs[:, order],
        normals=normals,
    )


def _from_obj(content: bytes) -> MeshData:
    data = read_obj(content)
    triangles, uv_index, normal_index = data.corners.transpose(2, 0, 1)
    has_uvs, has_normals = ((index >= 0).all(axis=1)[:, None, None] for index in (uv_index, normal_index))
    mesh = MeshData(data.positions, triangles.astype(np.int32), warnings=data.warnings)
    if has_uvs.any():
        uvs = np.where(has_uvs, data.uvs[uv_index], _DEFAULT_UVS)
        mesh = mesh._replace(uvs=uvs.astype(np.float32))
    if has_normals.any():
        normals = np.where(has_normals, _unit(data.normals)[normal_index], np.nan)
        mesh = mesh._replace(normals=_filled(normals, mesh))
    return mesh


def _parse(content: bytes, extension: str, path: str | os.PathLike[str]) -> MeshData:
    from trimesh import Trimesh, load_scene
    from trimesh.resolvers import FilePathResolver

    warnings: list[str] = []
    if extension in ("glb", "gltf"):
        content, warnings = prepare_gltf(content, extension)
    resolver = FilePathResolver(os.fspath(path))
    scene = load_scene(io.BytesIO(content), extension, resolver=resolver, process=False, skip_materials=True)
    parts = []
    for node in scene.graph.nodes_geometry:
        matrix, name = scene.graph[node]
        geometry = scene.geometry[name]
        if not isinstance(geometry, Trimesh):
            warnings.append("its points and lines are not used")
            continue
        if getattr(geometry.visual, "kind", None) in ("vertex", "face"):
            warnings.append("its colours are not used")
        part = _part(geometry)
        parts.append(part if np.array_equal(matrix, np.eye(4)) else transformed(part, matrix))
    return _joined(parts)._replace(warnings=tuple(dict.fromkeys(warnings)))


def _part(geometry: Any) -> MeshData:
    vertices = np.array(geometry.vertices, np.float64)
    triangles = np.array(geometry.faces, np.int32).reshape(-1, 3)
    if len(triangles) and not 0 <= triangles.min() <= triangles.max() < len(vertices):
        raise ValueError(f"a face refers to a vertex that is not there, there are {len(vertices)}")
    mesh = MeshData(vertices, triangles)
    uvs = geometry.vertex_attributes.get(UV_ATTRIBUTE, getattr(geometry.visual, "uv", None))
    if uvs is not None:
        uvs = np.asarray(uvs)
        scale = 1 / np.iinfo(uvs.dtype).max if uvs.dtype.kind == "u" else 1.0
        mesh = mesh._replace(uvs=(uvs * scale).astype(np.float32)[triangles])
    # trimesh computes normals that are asked for; only those from the file are in its cache by now
    if "vertex_normals" in geometry._cache:
        normals = _unit(np.asarray(geometry.vertex_normals, np.float64))[triangles]
        mesh = mesh._replace(normals=_filled(normals, mesh))
    return mesh


def _joined(parts: list[MeshData]) -> MeshData:
    if not parts:
        return MeshData(np.empty((0, 3)), np.empty((0, 3), np.int32))
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return MeshData(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + np.int32(n) for part, n in zip(parts, first, strict=False)]),
        _joined_corners(parts, [part.uvs for part in parts], lambda part: _DEFAULT_UVS),
        _joined_corners(parts, [part.normals for part in parts], _flat_normals),
    )


def _joined_corners(
    parts: list[MeshData], corners: list[NDArray[np.float32] | None], default: Callable[[MeshData], NDArray[Any]]
) -> NDArray[np.float32] | None:
    """Joins what each part has per corner; None if none has any."""
    given = [c for c in corners if c is not None]
    if not given:
        return None
    shape = given[0].shape[1:]
    filled = [
        np.broadcast_to(default(part), (len(part.triangles), *shape)) if c is None else c
        for part, c in zip(parts, corners, strict=True)
    ]
    return np.concatenate(filled).astype(np.float32)


def _apply(linear: NDArray[np.float64], vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3) times each of (..., 3). By elementwise operations, so that equal vectors give equal bits, unlike BLAS."""
    x, y, z = linear.T
    result: NDArray[np.float64] = vectors[..., :1] * x + vectors[..., 1:2] * y + vectors[..., 2:] * z
    return result


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors, of vectors of any length; NaN for those without a direction."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
        unit: NDArray[np.float64] = scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)
    return unit


def _filled(normals: NDArray[np.float64], mesh: MeshData) -> NDArray[np.float32]:
    """The normals (m, 3, 3) with the triangle's own in place of those that are not finite."""
    finite = np.isfinite(normals).all(axis=2, keepdims=True)
    return np.where(finite, normals, _flat_normals(mesh)).astype(np.float32)


def _flat_normals(mesh: MeshData) -> NDArray[np.float64]:
    """(m, 1, 3) unit normals of the triangles; NaN for degenerate ones."""
    v0, v1, v2 = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    return _unit(np.cross(v1 - v0, v2 - v0))[:, None]
