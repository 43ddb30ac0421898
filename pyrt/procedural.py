"""Meshes that are computed instead of read."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Points = NDArray[np.float64]
Triangles = NDArray[np.int32]

_WAVES = 8  # sine waves per octave


def icosphere(subdivisions: int) -> tuple[Points, Triangles]:
    """A unit icosphere of (10·4^k + 2, 3) vertices and (20·4^k, 3) triangles that share them.

    Each of the k subdivisions splits every edge at its middle, moved onto the sphere. Counter-clockwise from outside.
    """
    vertices, triangles = _icosahedron()
    for _ in range(subdivisions):
        vertices, triangles = _subdivided(vertices, triangles)
    return vertices, triangles


def noise(points: Points, frequency: float, octaves: int, seed: int) -> Points:
    """Smooth noise in [-1, 1] at (n, 3) points: octaves of plane sine waves in random directions.

    An octave is the mean of 8 waves; each has double the frequency (waves per unit of length) and half the weight of
    the one before. The same seed gives the same noise.
    """
    random = np.random.Generator(np.random.PCG64(seed))
    total = np.zeros(len(points))
    for octave in range(octaves):
        directions = random.standard_normal((_WAVES, 3))
        directions *= 2 * np.pi * frequency * 2**octave / np.linalg.norm(directions, axis=1, keepdims=True)
        phases = random.uniform(0, 2 * np.pi, _WAVES)
        waves = directions @ points.T
        waves += phases[:, None]
        total += np.sin(waves, out=waves).sum(axis=0) / (_WAVES * 2**octave)
    return total / (2 - 2.0 ** (1 - octaves))


def vertex_normals(vertices: Points, triangles: Triangles) -> Points:
    """(n, 3) unit normals: the area-weighted mean of the adjacent triangles' normals."""
    corners = np.ascontiguousarray(triangles.T)
    v0, v1, v2 = np.ascontiguousarray(vertices.T)[:, corners].transpose(1, 0, 2)
    doubled_areas = np.cross(v1 - v0, v2 - v0, axis=0)
    sums = [np.bincount(corners.ravel(), np.tile(component, 3), len(vertices)) for component in doubled_areas]
    normals = np.stack(sums, axis=1)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True), np.float64)


def _icosahedron() -> tuple[Points, Triangles]:
    golden = (1 + 5**0.5) / 2
    corners = [(sign, long, 0.0) for sign in (-1.0, 1.0) for long in (golden, -golden)]
    vertices = np.array([np.roll(corner, shift) for shift in range(3) for corner in corners])
    # the faces are the triples at mutual distance 2, turned outwards
    near = np.linalg.norm(vertices[:, None] - vertices, axis=2) < 2.1
    i, j, k = np.ogrid[:12, :12, :12]
    faces = np.argwhere((i < j) & (j < k) & near[i, j] & near[j, k] & near[i, k])
    inwards = np.linalg.det(vertices[faces]) < 0
    faces[inwards] = faces[inwards][:, ::-1]
    return vertices / np.hypot(1, golden), faces.astype(np.int32)


def _subdivided(vertices: Points, triangles: Triangles) -> tuple[Points, Triangles]:
    count = len(vertices)
    a, b, c = triangles.T.astype(np.int64)
    ends = np.sort(np.stack([np.concatenate([a, b, c]), np.concatenate([b, c, a])]), axis=0)
    edges, middle = np.unique(ends[0] * count + ends[1], return_inverse=True)
    middles = vertices[edges // count] + vertices[edges % count]
    middles /= np.linalg.norm(middles, axis=1, keepdims=True)
    ab, bc, ca = (count + middle).reshape(3, -1)
    corners = [a, ab, ca, b, bc, ab, c, ca, bc, ab, bc, ca]
    split = np.stack(corners, axis=1).reshape(-1, 3).astype(np.int32)
    return np.concatenate([vertices, middles]), split
