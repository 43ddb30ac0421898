"""Meshes that are hard to trace: (vertices (n, 3) float64, triangles (m, 3) int) unless told otherwise."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Mesh = tuple[Floats, Ints]


def soup(corners: Floats) -> Mesh:
    """(m, 3, 3) corners as a mesh that shares no vertices."""
    return corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3)


def grid(lines_x: Floats, lines_y: Floats) -> Mesh:
    """A sheet in z = 0: one rectangle, cut along its diagonal, between neighbouring lines."""
    x, y = np.meshgrid(lines_x, lines_y, indexing="ij")
    vertices = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    node = np.arange(x.size).reshape(x.shape)
    a, b, c, d = node[:-1, :-1], node[1:, :-1], node[1:, 1:], node[:-1, 1:]
    return vertices, np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def cube() -> Mesh:
    """[-1, 1]^3, closed, each side cut into two triangles, seen counter-clockwise from outside."""
    vertices = np.array([(x, y, z) for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
    sides = np.array([(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)])
    return vertices, sides[:, [0, 1, 2, 0, 2, 3]].reshape(-1, 3)


def lens(angle: float, sectors: int) -> Mesh:
    """Two cones of radius 1, closed, that meet at z = 0 under so many degrees; seen counter-clockwise from outside."""
    turn = 2 * np.pi * np.arange(sectors) / sectors
    height = np.tan(np.radians(angle) / 2)
    rim = np.stack([np.cos(turn), np.sin(turn), np.zeros(sectors)], axis=1)
    a, top = np.arange(sectors), np.full(sectors, sectors)
    b = np.roll(a, -1)
    triangles = np.concatenate([np.stack([a, b, top], axis=1), np.stack([b, a, top + 1], axis=1)])
    return np.concatenate([rim, [(0, 0, height), (0, 0, -height)]]), triangles


def subdivided(mesh: Mesh, times: int) -> Mesh:
    """Each triangle cut into four, so many times; the new vertices are shared too."""
    vertices, triangles = mesh
    for _ in range(times):
        sides = np.sort(triangles[:, [(0, 1), (1, 2), (2, 0)]], axis=2).reshape(-1, 2)
        edges, which = np.unique(sides, axis=0, return_inverse=True)
        (a, b, c), (ab, bc, ca) = triangles.T, (len(vertices) + which.reshape(-1, 3)).T
        vertices = np.concatenate([vertices, vertices[edges].mean(axis=1)])
        parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
        triangles = np.concatenate([np.stack(part, axis=1) for part in parts])
    return vertices, triangles


def funnel(radii: Floats, sectors: int) -> Mesh:
    """Rings around the origin in z = 0, joined by triangles: of any size, if the radii span many powers of ten."""
    angle = 2 * np.pi * np.arange(sectors) / sectors
    circle = np.stack([np.cos(angle), np.sin(angle), np.zeros(sectors)], axis=1)
    node = np.arange(len(radii) * sectors).reshape(len(radii), sectors)
    a, b = node[:-1], node[1:]
    c, d = np.roll(b, -1, axis=1), np.roll(a, -1, axis=1)
    return (radii[:, None, None] * circle).reshape(-1, 3), np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3)


def boxes(random: np.random.Generator, count: int) -> Mesh:
    """Axis-aligned boxes with corners on a coarse lattice, and single sides of others."""
    low = random.integers(-8, 8, (count, 1, 3)) / 8
    size = random.integers(1, 4, (count, 1, 3)) / 8
    vertices, triangles = cube()
    corners = low + size * (vertices + 1) / 2
    faces = triangles + 8 * np.arange(count)[:, None, None]
    return corners.reshape(-1, 3), np.concatenate([faces[::2, :2].reshape(-1, 3), faces[1::2].reshape(-1, 3)])


def random_triangles(random: np.random.Generator, count: int) -> Floats:
    """(count, 3, 3): sizes from 1e-4 to 1 in the cube [-1, 1]^3."""
    size = 10.0 ** random.uniform(-4, 0, (count, 1, 1))
    return random.uniform(-1, 1, (count, 1, 3)) + size * random.uniform(-1, 1, (count, 3, 3))


def needles(random: np.random.Generator, count: int) -> Floats:
    """(count, 3, 3): triangles of length about 1 and aspect 1e2 … 1e7."""
    corners = random.uniform(-1, 1, (count, 3, 3))
    width = 10.0 ** -random.uniform(2, 7, (count, 1))
    corners[:, 2] = corners[:, 1] + width * random.uniform(-1, 1, (count, 3))
    return corners


def nasty_soup(random: np.random.Generator, count: int) -> Floats:
    """(count, 3, 3), a mixture: any size, needles, coincident, in one tilted plane, in one axis-aligned plane."""
    part = count // 6
    tilted = random.uniform(-0.7, 0.7, (part, 3, 3))
    tilted[..., 2] = 0.3 * tilted[..., 0] - 0.6 * tilted[..., 1]
    flat = random.integers(-8, 9, (part, 1, 3)) / 8 + random.choice([-1, 1], (part, 3, 1)) * [
        (0, 0, 0),
        (1, 0, 0),
        (0, 0, 1),
    ]
    flat[..., 1] = 0.25
    once = random_triangles(random, count - 5 * part)
    parts = [once, needles(random, part), tilted, flat, tilted.copy(), np.repeat(once[:1], part, axis=0)]
    return random.permutation(np.concatenate(parts))


def points_inside(random: np.random.Generator, count: int, radius: float) -> Floats:
    """(count, 3) uniform in a ball around the origin."""
    points = random.normal(size=(count, 3))
    return points * (radius * random.random(count) ** (1 / 3) / np.linalg.norm(points, axis=1))[:, None]


def points_on_edges(random: np.random.Generator, mesh: Mesh, share: Floats) -> Floats:
    """(k, 3): on randomly chosen edges, the given (k,) shares of the way along."""
    vertices, triangles = mesh
    face = random.integers(0, len(triangles), len(share))
    side = random.integers(0, 3, len(share))
    a, b = vertices[triangles[face, side]], vertices[triangles[face, (side + 1) % 3]]
    return a + share[:, None] * (b - a)


def points_on_triangles(random: np.random.Generator, corners: Floats) -> Floats:
    """(m, 3): a uniform point of each of the (m, 3, 3) triangles."""
    weights = random.dirichlet((1, 1, 1), len(corners))
    return np.einsum("ij,ijk->ik", weights, corners)
