"""The tree finds what brute force finds, for any rays and any triangles (N4, N5, N8, N9, N11 and N29 for rays)."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from unittest.mock import patch

import numpy as np
import pytest

import pyrt
from pyrt.device import Device
from pyrt.layout import constants
from pyrt.procedural import icosphere
from pyrt.rays import Rays
from pyrt.tree import build_tree
from tests import meshes
from tests.controls import edited
from tests.meshes import Floats, Mesh
from tests.reference.rays import farthest_hit, hit_errors
from tests.stress import disagreements, in_plane_rays

INFINITE = np.array([np.nan, np.inf, -np.inf])


@pytest.fixture(scope="module")
def brute_force() -> Iterator[Path]:
    with edited("brute force", "every ray alone") as folder:
        yield folder


def assert_true_hits(mesh: Mesh, origins: Floats, directions: Floats) -> None:
    """Every hit is one, and no ray passes a triangle that it meets by more than the rounding."""
    hits = pyrt.RayTracer(*mesh).closest(origins, directions)
    assert hit_errors(*mesh, origins, directions, hits).max() < 1
    limit = farthest_hit(mesh[0][mesh[1]], origins, directions)
    assert np.isfinite(limit).any()
    assert (hits.t <= limit).all()


def lattice_rays(random: np.random.Generator, mesh: Mesh, count: int) -> tuple[Floats, Floats]:
    """Rays that start at corners, on edges or on planes of boxes, and run along axes, faces or to other corners."""
    vertices = mesh[0]
    corner = vertices[random.integers(0, len(vertices), count)]
    plane = np.where(random.random((count, 3)) < 0.4, random.integers(-32, 32, (count, 3)) / 32, corner)
    origins = np.where(random.random((count, 1)) < 0.5, corner, plane)
    axis = np.where(random.random((count, 3)) < 0.5, 0.0, random.choice([-1.0, -0.0, 1.0], (count, 3)))
    axis[~axis.any(axis=1), random.integers(0, 3)] = 1.0
    to_corner = vertices[random.integers(0, len(vertices), count)] - origins
    to_corner[~to_corner.any(axis=1), 0] = 1.0
    return origins, np.where(random.random((count, 1)) < 0.6, axis, to_corner)


@pytest.mark.parametrize("seed", [0, 1, *(pytest.param(s, marks=pytest.mark.slow) for s in range(2, 20))])
def test_rays_in_the_planes_of_boxes(seed, brute_force):
    random = np.random.default_rng(seed)
    mesh = meshes.boxes(random, 100)
    origins, directions = lattice_rays(random, mesh, 50_000)
    assert disagreements(brute_force, mesh, origins, directions) == 0
    hits = pyrt.RayTracer(*mesh).closest(origins, directions)
    assert hit_errors(*mesh, origins, directions, hits).max() < 1


@pytest.mark.parametrize("seed", range(3))
def test_rays_in_the_plane_of_triangles_meet_only_those_before_them(seed):
    mesh, origins, directions = in_plane_rays(seed)
    hits = pyrt.RayTracer(*mesh).closest(origins, directions)
    assert (hits.triangle >= 0).sum() > 1000
    assert hit_errors(*mesh, origins, directions, hits).max() < 1


COMPONENTS = [0.0, -0.0, 5e-324, 1e-310, 1e-38, 1e-20, 1e-8, 1.0]


@pytest.mark.parametrize("length", [1e-300, 1e-30, 1.0, 1e30, 1e300])
def test_direction_components_of_any_size(length, brute_force):
    """t·length within 4 ulp of float32, for rays that meet the surface within 25° of its normal."""
    vertices, triangles = icosphere(4)
    patterns = np.array([p for p in product(COMPONENTS, repeat=3) if any(p)])
    signs = np.array(list(product([-1.0, 1.0], repeat=3)))
    directions = (patterns[:, None] * signs).reshape(-1, 3)
    directions /= np.abs(directions).max(axis=1, keepdims=True)
    random = np.random.default_rng(0)
    origins = meshes.points_inside(random, len(directions), 0.4)
    tracer = pyrt.RayTracer(vertices, triangles)
    hits = tracer.closest(origins, directions * length)
    corners = vertices[triangles[hits.triangle]]
    assert (hits.triangle >= 0).all()
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    truth = ((corners[:, 0] - origins) * normal).sum(axis=1) / (directions * normal).sum(axis=1)
    assert (np.abs(hits.t * length - truth) <= 4 * np.spacing(truth.astype(np.float32))).all()
    if length == 1.0:
        assert disagreements(brute_force, (vertices, triangles), origins, directions) == 0


def test_origins_far_away():
    random = np.random.default_rng(0)
    mesh = meshes.soup(meshes.random_triangles(random, 100))
    targets = meshes.points_on_triangles(random, mesh[0][mesh[1]])[random.integers(0, 100, 20_000)]
    origins = targets + 10.0 ** random.uniform(-1, 9, (20_000, 1)) * meshes.points_inside(random, 20_000, 1.0)
    assert_true_hits(mesh, origins, targets - origins)


def nested_triangles(count: int, random: np.random.Generator) -> tuple[Mesh, Floats]:
    """Triangles across the x axis at ±2^-i, shuffled, and the place of each."""
    places = np.concatenate([s * 2.0 ** -np.arange(count) for s in (-1.0, 1.0)])
    random.shuffle(places)
    corners = np.zeros((len(places), 3, 3))
    corners[..., 0] = places[:, None]
    corners[..., 1:] = [(-1, -1), (1, -1), (0, 1)]
    return meshes.soup(corners), places


def depth(corners: Floats) -> int:
    return build_tree(corners.astype(np.float32), np.zeros(0)).depth


def test_nested_triangles():
    random = np.random.default_rng(0)
    mesh, places = nested_triangles(251, random)
    assert depth(mesh[0][mesh[1]]) <= constants()["BVH_MAX_DEPTH"]
    tracer = pyrt.RayTracer(*mesh)
    start = 2.0 ** -np.arange(120.0) * 1.5
    for sign in (-1.0, 1.0):
        origins = np.zeros((120, 3))
        origins[:, 0] = sign * start
        hits = tracer.closest(origins, np.tile((-sign, 0.0, 0.0), (120, 1)))
        assert np.array_equal(places[hits.triangle] * sign, start / 1.5)
        assert np.array_equal(hits.t, start / 3)


@pytest.mark.parametrize("count", [10_000, pytest.param(1_000_000, marks=pytest.mark.slow)])
@pytest.mark.parametrize("what", ["coincident", "concentric"])
def test_triangles_that_no_split_separates(count, what):
    random = np.random.default_rng(0)
    size = np.ones(count) if what == "coincident" else random.permutation(np.linspace(0.1, 1, count))
    shape = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (0.0, 2.0, 0.0)])
    corners = size[:, None, None] * shape
    assert depth(corners) <= constants()["BVH_MAX_DEPTH"]
    tracer = pyrt.RayTracer(*meshes.soup(corners))
    targets = shape[0] * np.linspace(-0.4, 0.98, 50)[:, None]
    hits = tracer.closest(targets + (0.0, 0.0, 3.0), np.tile((0.0, 0.0, -1.0), (50, 1)))
    reach = np.linspace(-0.4, 0.98, 50)
    lowest = [np.flatnonzero(size >= max(r, -2 * r))[0] for r in reach]
    assert np.array_equal(hits.triangle, lowest)


SOUPS = 8


@pytest.mark.parametrize(
    ("soups", "rays"), [(SOUPS, 8_000), pytest.param(100, 10_000, marks=pytest.mark.slow)], ids=["small", "large"]
)
def test_soups_against_brute_force(soups, rays, brute_force):
    for seed in range(soups):
        random = np.random.default_rng(seed)
        corners = meshes.nasty_soup(random, int(random.integers(12, 400)))
        mesh = meshes.soup(corners)
        origins = random.uniform(-1.5, 1.5, (rays, 3))
        targets = meshes.points_on_triangles(random, corners[random.integers(0, len(corners), rays)])
        limit = np.where(random.random(rays) < 0.7, np.inf, random.uniform(0, 2, rays))
        assert disagreements(brute_force, mesh, origins, targets - origins, limit) == 0
        assert_true_hits(mesh, origins[:500], (targets - origins)[:500])


def test_infinite_rays_miss_and_are_counted():
    mesh = meshes.cube()
    tracer = pyrt.RayTracer(*mesh)
    bad = [(o, d) for o in range(-1, 3) for d in range(-1, 3) if o >= 0 or d >= 0]
    origins, directions = np.zeros((2, len(bad) * 3, 3))
    directions[:, 2] = 1.0
    for i, ((o, d), value) in enumerate(product(bad, INFINITE)):
        origins[i, o], directions[i, d] = (value if o >= 0 else 0.0), (value if d >= 0 else 1.0)
    directions[-1], origins[-1] = 0.0, 0.0
    hits = tracer.closest(origins, directions)
    assert hits.invalid == len(origins)
    assert (hits.triangle == -1).all()
    assert (hits.t == np.inf).all()
    assert not hits.u.any()
    assert not hits.v.any()
    assert not tracer.occluded(origins, directions).any()
    assert tracer.closest(np.zeros((1, 3)), np.ones((1, 3)), np.nan).invalid == 1


def test_the_kernels_themselves_reject_what_is_not_finite():
    """Also rays that the host would have stopped; hidden lights and materials may make such."""
    with patch.object(Device, "has_double", False):
        tracer = pyrt.RayTracer(*meshes.cube())
    rows = [(c, value) for c in range(6) for value in INFINITE]
    batch = np.tile(np.float32([0.1, 0.2, 0.05, 0.3, 0.4, 1.0]), (len(rows) + 1, 1))
    for i, (component, value) in enumerate(rows):
        batch[i, component] = value
    batch[-1, 3:] = 0.0
    rays = Rays(np.ascontiguousarray(batch[:, :3]), np.ascontiguousarray(batch[:, 3:]), np.float32([np.inf]))
    ids, hidden = np.zeros(len(rays), np.int32), np.ones(len(rays), np.uint8)
    tracer._trace(
        "trace_closest", rays, *np.zeros((1, len(rays)), np.float32), ids, *np.zeros((2, len(rays)), np.float32)
    )
    tracer._trace("trace_any", rays, hidden)
    assert (ids == -1).all()
    assert not hidden.any()


EXTREMES = np.array([0.0, -0.0, 1.0, -1.0, 5e-324, 1e-310, -1e-38, 1e-30, 1e-8, 1e8, -1e29, 3e38, 1e300, *INFINITE])


@pytest.mark.parametrize("seed", [*range(6), *(pytest.param(s, marks=pytest.mark.slow) for s in range(6, 300))])
def test_extreme_meshes_and_rays(seed):
    """Whatever the numbers: no warning from the arithmetic, no NaN, no hit on what was dropped."""
    random = np.random.default_rng(seed)
    size = 10.0 ** random.integers(-3, 4)

    def numbers(*shape: int) -> Floats:
        usual = random.uniform(-size, size, shape)
        return np.where(random.random(shape) < 0.1 * (seed % 4), random.choice(EXTREMES, shape), usual)

    mesh = meshes.soup(numbers(60, 3, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        warnings.filterwarnings("ignore", message=".*triangles are not finite or have no area")
        tracer = pyrt.RayTracer(*mesh)
        origins, directions, t_max = numbers(3000, 3), numbers(3000, 3), 4 * np.abs(numbers(3000)) / size
        hits = tracer.closest(origins, directions, t_max)
        occluded = tracer.occluded(origins, directions, t_max)
    found = hits.triangle >= 0
    assert np.array_equal(found, occluded)
    assert not np.isnan([hits.t, hits.u, hits.v]).any()
    assert (hits.t[found] <= t_max[found]).all()
    assert (hits.t[~found] == np.inf).all()
    assert np.isfinite(mesh[0][mesh[1][hits.triangle[found]]]).all()
    if seed % 4 == 0:
        assert found.sum() > 100
