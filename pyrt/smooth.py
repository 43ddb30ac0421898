"""Shading normals for meshes that come without: smooth where faces meet at a small angle, sharp at edges."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from pyrt.mesh_data import MeshData, filled_normals, flat_normals, unit_vectors

_EDGE = 40.0  # degrees between faces from which an edge is sharp
_MAX_TRIANGLES = 1_000_000  # more are smaller than pixels, and need no smoothing
_MAX_NEIGHBOURS = 32  # faces that a corner takes account of before and behind its own


def smoothed(mesh: MeshData) -> MeshData:
    """The mesh with a normal at each corner: the mean of the faces around the vertex whose normals differ from the
    corner's own face by less than 40 degrees, weighted by their angles there. A mesh with normals stays as it is."""
    if mesh.normals is not None or len(mesh.triangles) > _MAX_TRIANGLES:
        return mesh
    faces = np.nan_to_num(flat_normals(mesh))[:, 0]
    weighted = _angles(mesh)[:, :, None] * faces[:, None]
    order, vertex = _by_position(mesh)
    own, weighted = np.repeat(faces, 3, axis=0)[order], weighted.reshape(-1, 3)[order]
    sums = weighted.copy()
    limit = np.cos(np.radians(_EDGE))
    for step in range(1, _MAX_NEIGHBOURS + 1):
        first = np.flatnonzero(vertex[:-step] == vertex[step:])
        if not len(first):
            break
        first = first[np.einsum("ij,ij->i", own[first], own[first + step]) > limit]
        sums[first] += weighted[first + step]
        sums[first + step] += weighted[first]
    normals = np.empty_like(sums)
    normals[order] = unit_vectors(sums)
    return mesh._replace(normals=filled_normals(normals.reshape(-1, 3, 3), mesh))


def _angles(mesh: MeshData) -> NDArray[np.float64]:
    """(m, 3) angles at the corners; 0 where there is none."""
    corners = mesh.vertices[mesh.triangles]
    edges = unit_vectors(np.roll(corners, -1, axis=1) - corners)
    cosines = -np.einsum("ijk,ijk->ij", edges, np.roll(edges, 1, axis=1))
    angles: NDArray[np.float64] = np.nan_to_num(np.arccos(np.clip(cosines, -1, 1)))
    return angles


def _by_position(mesh: MeshData) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Corners in an order in which those at equal positions are neighbours, and a number for the position of each."""
    bits = np.ascontiguousarray(mesh.vertices + 0.0).view(np.dtype((np.void, 24))).ravel()
    _, place = np.unique(bits, return_inverse=True)
    of_corner = place.ravel()[mesh.triangles.ravel()]
    order = np.argsort(of_corner, kind="stable")
    return order, of_corner[order]
