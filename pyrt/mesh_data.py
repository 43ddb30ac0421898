"""Triangle meshes as every reader gives them, their transforms, and the joining of several into one."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

DEFAULT_UVS = np.array([[0, 0], [1, 0], [1, 1]], np.float32)  # at a triangle's corners
_FLIP = [0, 2, 1]


class MeshData(NamedTuple):
    """Triangles with optional texture coordinates and unit shading normals per corner."""

    vertices: NDArray[np.float64]  # (n, 3)
    triangles: NDArray[np.int32]  # (m, 3)
    uvs: NDArray[np.float32] | None = None  # (m, 3, 2)
    normals: NDArray[np.float32] | None = None  # (m, 3, 3)
    warnings: tuple[str, ...] = ()  # what the file holds and pyrt does not use


def transformed(mesh: MeshData, matrix: ArrayLike) -> MeshData:
    """The mesh under an invertible affine 4×4 matrix, for column vectors; normals by the inverse transpose.

    A mirroring matrix also swaps two corners of each triangle, so that the outside of a closed mesh stays its front.
    """
    return instances(mesh, np.asarray(matrix, np.float64)[None])[0]


def instances(mesh: MeshData, matrices: NDArray[np.float64]) -> list[MeshData]:
    """The mesh under each of (k, 4, 4) matrices, as `transformed` makes it. They share what they have in common."""
    linear = matrices[:, :3, :3]
    vertices = _apply(linear[:, None], mesh.vertices) + matrices[:, None, :3, 3]
    mirrored = np.linalg.det(linear) < 0
    swapped = mesh._replace(triangles=mesh.triangles[:, _FLIP], uvs=None if mesh.uvs is None else mesh.uvs[:, _FLIP])
    normals: Iterable[NDArray[np.float32] | None] = [None] * len(matrices)
    if mesh.normals is not None:
        across = np.asarray(np.linalg.inv(linear).transpose(0, 2, 1), np.float64)
        turned = unit_vectors(_apply(across[:, None, None], mesh.normals.astype(np.float64))).astype(np.float32)
        turned[mirrored] = turned[mirrored][:, :, _FLIP]
        normals = turned
    each = zip(mirrored, vertices, normals, strict=True)
    return [(swapped if flip else mesh)._replace(vertices=v, normals=n) for flip, v, n in each]


def joined(parts: list[MeshData]) -> MeshData:
    if not parts:
        return MeshData(np.empty((0, 3)), np.empty((0, 3), np.int32))
    if len(parts) == 1:
        return parts[0]._replace(warnings=())
    first = np.cumsum([0, *(len(part.vertices) for part in parts)])
    return MeshData(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.triangles + np.int32(n) for part, n in zip(parts, first, strict=False)]),
        _joined_corners(parts, [part.uvs for part in parts], lambda part: DEFAULT_UVS),
        _joined_corners(parts, [part.normals for part in parts], flat_normals),
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
    """(..., 3, 3) times (..., 3). By elementwise operations, so that equal vectors give equal bits, unlike BLAS."""
    x, y, z = linear[..., 0], linear[..., 1], linear[..., 2]
    result: NDArray[np.float64] = vectors[..., :1] * x + vectors[..., 1:2] * y + vectors[..., 2:] * z
    return result


def unit_vectors(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    """Unit vectors, of vectors of any length; NaN for those without a direction."""
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = vectors / np.abs(vectors).max(axis=-1, keepdims=True)
        unit: NDArray[np.float64] = scaled / np.linalg.norm(scaled, axis=-1, keepdims=True)
    return unit


def filled_normals(normals: NDArray[np.float64], mesh: MeshData) -> NDArray[np.float32]:
    """The normals (m, 3, 3) with the triangle's own in place of those that are not finite."""
    finite = np.isfinite(normals).all(axis=2, keepdims=True)
    return np.where(finite, normals, flat_normals(mesh)).astype(np.float32)


def flat_normals(mesh: MeshData) -> NDArray[np.float64]:
    """(m, 1, 3) unit normals of the triangles; NaN for degenerate ones."""
    v0, v1, v2 = mesh.vertices[mesh.triangles].transpose(1, 0, 2)
    return unit_vectors(np.cross(v1 - v0, v2 - v0))[:, None]
