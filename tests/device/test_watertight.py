"""A closed mesh has no holes, wherever it is and however large, for rays at its vertices and edges (N1 – N3)."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest

import pyrt
from pyrt.procedural import icosphere
from tests import meshes
from tests.reference.rays import hit_errors
from tests.stress import TARGETS, inside_rays, misses

SPHERE = icosphere(4)
RAYS = 200_000


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("count", [1_000_000, pytest.param(10_000_000, marks=pytest.mark.slow)])
def test_no_ray_leaves_a_sphere(target, count):
    tracer = pyrt.RayTracer(*SPHERE)
    step = 2_000_000
    for seed in range(-(-count // step)):
        assert misses(tracer, *inside_rays(SPHERE, target, min(count, step), seed)) == 0


@pytest.mark.parametrize("target", TARGETS)
def test_hits_lie_on_the_sphere(target):
    origins, directions = inside_rays(SPHERE, target, RAYS)
    hits = pyrt.RayTracer(*SPHERE).closest(origins, directions)
    assert hit_errors(*SPHERE, origins, directions, hits).max() < 1


PLACES = [(148376.0, 1234.0, -223423.0), *((x, -x, x / 3) for x in (1e4, 1e6, 1e8, 1e10, 1e12))]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("target", TARGETS)
def test_no_ray_leaves_a_distant_sphere(place, target):
    vertices, triangles = SPHERE[0] + place, SPHERE[1]
    random = np.random.default_rng(1)
    origins = meshes.points_inside(random, RAYS // 4, 0.98) + place
    directions = TARGETS[target](random, (vertices, triangles), len(origins)) - origins
    assert misses(pyrt.RayTracer(vertices, triangles), origins, directions) == 0


@pytest.mark.parametrize("exponent", range(-6, 7, 3))
def test_no_ray_leaves_a_sphere_of_any_size(exponent):
    origins, directions = inside_rays(SPHERE, "edge points", RAYS // 4)
    size = 10.0**exponent
    assert misses(pyrt.RayTracer(SPHERE[0] * size, SPHERE[1]), origins * size, directions * size) == 0


def assert_same_hits(hits: pyrt.Hits, other: pyrt.Hits, factor: float = 1.0) -> None:
    assert np.array_equal(hits.triangle, other.triangle)
    assert np.array_equal(hits.t * factor, other.t)
    assert np.array_equal(hits.u, other.u)
    assert np.array_equal(hits.v, other.v)


@pytest.mark.parametrize("exponent", [-900, -60, -31, -1, 1, 17, 60, 90])
def test_scaling_by_a_power_of_two_changes_no_bit(exponent):
    origins, directions = inside_rays(SPHERE, "edge points", RAYS // 4)
    hits = pyrt.RayTracer(*SPHERE).closest(origins, directions)
    size = 2.0**exponent
    scaled = pyrt.RayTracer(SPHERE[0] * size, SPHERE[1])
    assert_same_hits(hits, scaled.closest(origins * size, directions * size))
    assert_same_hits(hits, scaled.closest(origins * size, directions), size)


@pytest.mark.parametrize("move", [1.0, 3.5, 2.0**-8, 2.0**20 + 1, 2.0**30])
def test_moving_a_mesh_changes_no_bit(move):
    """If the moved coordinates are exact. The odd box has its middle between two points of coarse grids."""
    lattice = np.array([1.0, 1.0, 0.5]) + np.round(SPHERE[0] * 2**16) / 2**16
    random = np.random.default_rng(2)
    origins = np.round(meshes.points_inside(random, RAYS // 4, 0.9) * 2**16) / 2**16
    directions = random.normal(size=origins.shape)
    hits = pyrt.RayTracer(lattice, SPHERE[1]).closest(origins, directions)
    assert_same_hits(hits, pyrt.RayTracer(lattice + move, SPHERE[1]).closest(origins + move, directions))


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_axis_parallel_rays_on_the_lines_of_a_grid(axis, sign):
    lines = np.arange(-32, 33) / 32
    vertices, triangles = meshes.grid(lines, lines)
    vertices = np.roll(vertices, axis, axis=1)  # the sheet's normal is axis (2 + axis) % 3
    tracer = pyrt.RayTracer(vertices, triangles)
    halves = np.arange(-64, 65) / 64  # lines, nodes and the points halfway
    x, y = (a.ravel() for a in np.meshgrid(halves, halves))
    on_line = (x * 32 == np.round(x * 32)) | (y * 32 == np.round(y * 32))
    targets = np.roll(np.stack([x, y, np.zeros_like(x)], axis=1)[on_line], axis, axis=1)
    for zeros in product([0.0, -0.0], repeat=2):
        direction = np.roll([*zeros, sign], axis)
        directions = np.broadcast_to(direction, targets.shape)
        for distance in (0.25, 3.0, 1000.0):
            origins = targets - distance * directions
            hits = tracer.closest(origins, directions)
            assert (hits.t == distance).all()
            assert tracer.occluded(origins, directions).all()
