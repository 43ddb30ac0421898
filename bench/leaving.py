"""Rays that leave surfaces: pyrt's kernels, and Mitsuba's `spawn_ray`, `spawn_ray_to` and `ray_test`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import peers_mitsuba
from pyrt.procedural import icosphere
from pyrt.scene import Mesh
from tests import meshes, stress

Array = NDArray[np.float64]
Triangles = tuple[Array, NDArray[np.int64]]

PLACES = tuple((place, 1.0) for place in (1e3, 1e5, 1e7))
SIZES = tuple((0.0, 10.0**j) for j in (-6, -4, -2, 2, 4, 6))


@dataclass(frozen=True)
class Walker:
    """What a renderer does with rays that leave surfaces; all counts are of paths.

    Attributes:
        walk: (mesh, origins, directions, steps, both sides?) → those that hit again what they had just left, and
            those that got out.
        sees: (mesh, origins, directions, targets) → those whose first hit is not shadowed from the target.
    """

    walk: Callable[[Triangles, Array, Array, int, bool], tuple[int, int]]
    sees: Callable[[Triangles, Array, Array, Array], int]


def walkers() -> dict[str, Walker]:
    """pyrt, and Mitsuba where it is installed with its LLVM mode."""
    found = {"pyrt": Walker(_our_walk, _our_sight)}
    return found | ({"Mitsuba": Walker(_their_walk, _their_sight)} if peers_mitsuba.is_vectorised() else {})


def _our_walk(mesh: Triangles, origins: Array, directions: Array, steps: int, both_sides: bool) -> tuple[int, int]:
    """The offset alone: without the skip of the own primitive."""
    vertices, triangles = mesh
    shape = Mesh(name="mesh", vertices=vertices, triangles=triangles.astype(np.int32), material=0)
    counts = stress.bounces(shape, origins, directions, steps, "no id skip", both_sides=both_sides)
    return counts.again, counts.escaped


def _our_sight(mesh: Triangles, origins: Array, directions: Array, targets: Array) -> int:
    tracer = pyrt.RayTracer(*mesh)
    hits = tracer.closest(origins, directions)
    points = origins + hits.t[:, None] * directions
    return int((~tracer.occluded(points, targets - points, 1.0)).sum())


def _their_walk(mesh: Triangles, origins: Array, directions: Array, steps: int, both_sides: bool) -> tuple[int, int]:
    random = np.random.default_rng(0)
    vertices, triangles = mesh
    scene = peers_mitsuba.ray_scene(vertices, triangles.astype(np.int32))
    found = peers_mitsuba.surface(scene, peers_mitsuba.rays(origins, directions))
    inside = np.array(found.is_valid())
    directions, left, again = directions, np.array(found.prim_index), np.zeros(len(origins), bool)
    escaped = ~inside & (steps > 1)
    for _ in range(steps):
        normals = np.array(found.n, np.float64).T
        normals *= -np.sign((normals * directions).sum(axis=1))[:, None]
        if both_sides:
            normals *= random.choice([-1.0, 1.0], (len(normals), 1))
        directions = _leaving(random, normals)
        found = peers_mitsuba.surface(scene, found.spawn_ray(peers_mitsuba.vectors(directions)))
        hit, index = np.array(found.is_valid()), np.array(found.prim_index)
        again |= inside & hit & (index == left)
        escaped |= inside & ~hit
        inside, left = inside & hit, index
    return int(again.sum()), int(escaped.sum())


def _leaving(random: np.random.Generator, normals: Array) -> Array:
    """A unit direction on the side of each normal, half of them grazing, none lower than 2^-18 (as bounce.cl)."""
    u = random.random((3, len(normals)))
    z = np.where(u[0] < 0.5, 2.0 ** (-18 * u[1]), np.maximum(u[1], 2.0**-18))
    helper = np.where(np.abs(normals[:, :1]) < 0.5, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    s = np.cross(normals, helper)
    s /= np.maximum(np.linalg.norm(s, axis=1)[:, None], 1e-30)  # a miss has no normal
    turn, r = 2 * np.pi * u[2], np.sqrt(1 - z * z)
    ring = np.cos(turn)[:, None] * s + np.sin(turn)[:, None] * np.cross(normals, s)
    return np.asarray(ring * r[:, None] + normals * z[:, None])


def _their_sight(mesh: Triangles, origins: Array, directions: Array, targets: Array) -> int:
    vertices, triangles = mesh
    scene = peers_mitsuba.ray_scene(vertices, triangles.astype(np.int32))
    found = peers_mitsuba.surface(scene, peers_mitsuba.rays(origins, directions))
    shadow = found.spawn_ray_to(peers_mitsuba.vectors(targets))
    return int((~np.array(peers_mitsuba.occluded(scene, shadow))).sum())


# Cases ----------------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Case:
    """One row: `measure` takes a walker and how many paths to spend."""

    name: str
    measures: str
    measure: Callable[[Walker, int], float]


def _own_triangle(walker: Walker, count: int) -> float:
    """Both for triangles of about one size and for sizes and places of 1e-8 … 1."""
    each = max(count // 2000, 1)
    found = (walker.walk(*stress.rays_at_random_triangles(scale, each), 1, True) for scale in (0.0, 8.0))
    return float(sum(again for again, _ in found))


def _rooms(walker: Walker, count: int, placements: tuple[tuple[float, float], ...]) -> float:
    """Share of the paths of 20 bounces that get out of a cube or a ball."""
    random, lost, share = np.random.default_rng(0), 0, count // (2 * len(placements))
    for vertices, triangles in (meshes.cube(), icosphere(3)):
        for place, scale in placements:
            origins = place + scale * meshes.points_inside(random, share, 0.9)
            mesh = (place + scale * vertices, triangles.astype(np.int64))
            lost += walker.walk(mesh, origins, random.normal(size=(share, 3)), 20, False)[1]
    return lost / (2 * share * len(placements))


def _plate(walker: Walker, count: int) -> float:
    """Share of shadow rays from a floor to points 10 above it that do not see a plate close below these."""
    random, seen, gaps = np.random.default_rng(1), 0, (1e-1, 1e-2, 1e-3, 1e-4, 1e-5)
    for gap in gaps:
        square = np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        floor, plate = (np.column_stack([half * square, np.full(4, z)]) for half, z in ((8, 0.0), (6, 10 - 10 * gap)))
        mesh = (np.concatenate([floor, plate]), np.array([(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)]))
        origins = np.column_stack([random.uniform(-4, 4, (count // 5, 2)), np.ones(count // 5)])
        targets = np.column_stack([random.uniform(-1, 1, (count // 5, 2)), np.full(count // 5, 10.0)])
        seen += walker.sees(mesh, origins, np.tile((0.0, 0.0, -1.0), (count // 5, 1)), targets)
    return seen / (count // 5 * 5)


CASES = (
    Case("N12", "rays that leave 2,000 triangles: hit them again", _own_triangle),
    Case("N13", "20 bounces in rooms at 1e3, 1e5, 1e7: got out", lambda walker, count: _rooms(walker, count, PLACES)),
    Case("N13", "20 bounces in rooms of size 1e-6 … 1e6: got out", lambda walker, count: _rooms(walker, count, SIZES)),
    Case("N14", "shadow rays past a plate 1e-1 … 1e-5 before their end", _plate),
)
