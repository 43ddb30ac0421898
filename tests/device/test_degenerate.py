"""Thin, tiny, flat, infinite and duplicate triangles (N6, N7, N10)."""

from __future__ import annotations

import warnings
from unittest.mock import patch

import numpy as np
import pytest

import pyrt
from pyrt.procedural import icosphere
from pyrt.scene import Camera, ConstantTexture, Diffuse, Mesh, PointLight, Scene
from tests import meshes
from tests.meshes import Floats
from tests.reference.rays import farthest_hit, hit_errors
from tests.stress import SHEETS, sheet_rays

COUNT = pytest.mark.parametrize("count", [50_000, pytest.param(2_000_000, marks=pytest.mark.slow)])


@COUNT
@pytest.mark.parametrize("place", [0.0, 0.7, 1e5])
@pytest.mark.parametrize("name", SHEETS)
def test_sheets_of_thin_and_tiny_triangles_have_no_holes(name, place, count):
    """Also where float32 makes them collapse."""
    turn = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    vertices, triangles = SHEETS[name]
    moved = vertices @ turn + place
    with warnings.catch_warnings():
        warnings.simplefilter("error" if place == 0.0 else "ignore")  # 1e-12 vanishes beside 0.7 even in float64
        tracer = pyrt.RayTracer(moved, triangles)
    origins, directions = sheet_rays(name, count)
    origins, directions = origins @ turn + place, directions @ turn
    hits = tracer.closest(origins, directions)
    assert (hits.triangle >= 0).all()
    assert hit_errors(moved, triangles, origins, directions, hits).max() < 1


@pytest.mark.parametrize("exponent", range(2, 13, 2))
def test_triangles_of_any_size_are_hit_from_nearby(exponent):
    """Edges of 10^-exponent, around the middle of a mesh of size 1, seen from ten edges away."""
    random = np.random.default_rng(exponent)
    size = 10.0**-exponent
    corners = size * np.array([(1.0, 0.0, 0.1), (-0.5, 0.8, 0.0), (-0.5, -0.8, -0.1)])
    frame = np.array([((s, s, s), (s, -s, s), (s, s, -s)) for s in (-1.0, 1.0)])  # sets the size of the mesh
    tracer = pyrt.RayTracer(*meshes.soup(np.concatenate([corners[None], frame])))
    targets = meshes.points_on_triangles(random, np.broadcast_to(0.99 * corners, (20_000, 3, 3)))
    away = random.normal(size=(20_000, 3))
    away[:, 2] = np.copysign(np.abs(away[:, 2]) + 1, away[:, 2])
    hits = tracer.closest(targets + 10 * size * away, -away)
    assert (hits.triangle == 0).all()
    assert np.allclose(hits.t, 10 * size, rtol=4e-6, atol=0)


def test_needles_from_all_sides():
    random = np.random.default_rng(0)
    corners = meshes.needles(random, 300)
    mesh = meshes.soup(corners)
    origins = random.uniform(-1.5, 1.5, (4_000, 3))
    targets = meshes.points_on_triangles(random, corners[random.integers(0, 300, 4_000)])
    hits = pyrt.RayTracer(*mesh).closest(origins, targets - origins)
    assert hit_errors(*mesh, origins, targets - origins, hits).max() < 1
    limit = farthest_hit(corners, origins, targets - origins)
    assert np.isfinite(limit).sum() > 250
    assert (hits.t <= limit).all()


def contaminated(
    random: np.random.Generator, vertices: Floats, triangles: meshes.Ints
) -> tuple[meshes.Mesh, meshes.Ints]:
    """The mesh among as many triangles without area and 1 % not finite; and the new index of each of its triangles."""
    count = len(triangles)
    a, b = random.integers(0, len(vertices), (2, count))
    line = vertices[a] + np.linspace(-1, 2, count)[:, None] * (vertices[b] - vertices[a])
    line[::2] = 2 * vertices[b[::2]] - vertices[a[::2]]  # on one line exactly
    bad = random.choice([np.nan, np.inf, -np.inf, 3e38], (count // 100 + 3, 3))
    points = np.concatenate([vertices, line, bad])
    on_line = np.stack([a, b, len(vertices) + np.arange(count)], axis=1)[::2]
    twice, thrice = np.stack([a, a, b], axis=1)[1::4], np.stack([a, a, a], axis=1)[3::4]
    infinite = np.stack([a[: len(bad)], b[: len(bad)], len(vertices) + count + np.arange(len(bad))], axis=1)
    order = random.permutation(len(on_line) + len(twice) + len(thrice) + len(infinite) + count)
    mixed = np.concatenate([triangles, on_line, twice, thrice, infinite])[order]
    return (points, mixed), np.argsort(order)[:count]


def test_triangles_without_area_and_infinite_ones_change_nothing():
    random = np.random.default_rng(0)
    vertices, triangles = icosphere(3)
    vertices = np.round(vertices * 2**20) / 2**20
    mesh, place = contaminated(random, vertices, triangles)
    with pytest.warns(UserWarning, match="triangles are not finite or have no area") as caught:
        tracer = pyrt.RayTracer(*mesh)
    assert len(caught) == 1
    assert tracer.dropped == len(mesh[1]) - len(triangles)
    origins, directions = random.uniform(-1.5, 1.5, (2, 50_000, 3))
    dirty = tracer.closest(origins, directions)
    clean = pyrt.RayTracer(vertices, triangles).closest(origins, directions)
    for name in ("t", "u", "v"):
        assert np.array_equal(getattr(dirty, name), getattr(clean, name))
    found = clean.triangle >= 0
    assert np.array_equal(dirty.triangle[found], place[clean.triangle[found]])
    assert (dirty.triangle[~found] == -1).all()


def scene_of(*shapes: Mesh, colors: tuple[tuple[float, float, float], ...] = ((0.5, 0.5, 0.5),)) -> Scene:
    return Scene(
        camera=Camera(position=(0.3, 0.4, 4.0)),
        textures=tuple(ConstantTexture(color) for color in colors),
        materials=tuple(Diffuse(i) for i in range(len(colors))),
        shapes=shapes,
        lights=(PointLight((1.0, 2.0, 5.0), (500.0, 500.0, 500.0)),),
    )


def test_pictures_do_not_show_triangles_without_area():
    vertices, triangles = icosphere(2)
    (points, mixed), place = contaminated(np.random.default_rng(0), np.round(vertices * 2**20) / 2**20, triangles)
    clean = scene_of(Mesh(name="ball", vertices=points, triangles=mixed[np.sort(place)], material=0))
    dirty = scene_of(Mesh(name="ball", vertices=points, triangles=mixed, material=0))
    expected, result = (pyrt.Renderer(scene).render(spp=4, size=(48, 48)) for scene in (clean, dirty))
    assert expected.image.max() > 0.1
    assert np.array_equal(result.image, expected.image)
    assert result.stats["dropped"] == {"samples": 0, "triangles": len(mixed) - len(triangles)}


def test_triangles_without_area_that_are_kept_are_noticed():
    def finite(corners: Floats) -> np.ndarray:
        return (np.abs(corners) < 1e30).all(axis=(1, 2))

    with patch("pyrt.geometry.valid_triangles", finite), np.errstate(all="ignore"), pytest.raises(AssertionError):
        test_pictures_do_not_show_triangles_without_area()


def test_a_mesh_without_valid_triangles_is_never_hit():
    with pytest.warns(UserWarning, match="1 of 1 triangles"):
        tracer = pyrt.RayTracer(np.full((3, 3), np.nan), [[0, 1, 2]])
    hits = tracer.closest(np.zeros((5, 3)), np.ones((5, 3)))
    assert (hits.triangle == -1).all()
    assert not tracer.occluded(np.zeros((5, 3)), np.ones((5, 3))).any()


@pytest.mark.parametrize("seed", range(4))
def test_the_lowest_of_coincident_triangles_is_hit(seed):
    random = np.random.default_rng(seed)
    once = meshes.random_triangles(random, 300)
    order = random.permutation(np.repeat(np.arange(300), random.integers(1, 60, 300)))
    corners = once[order]
    targets = meshes.points_on_triangles(random, corners)
    origins = random.uniform(-1, 1, targets.shape)
    hits = pyrt.RayTracer(*meshes.soup(corners)).closest(origins, targets - origins)
    lowest = np.array([np.flatnonzero(order == which)[0] for which in range(300)])
    found = hits.triangle >= 0
    assert found.sum() > 500
    assert np.array_equal(hits.triangle[found], lowest[order[hits.triangle[found]]])


@pytest.mark.parametrize("seed", range(3))
def test_the_first_of_coincident_shapes_is_seen(seed):
    random = np.random.default_rng(seed)
    colors = ((0.9, 0.1, 0.1), (0.1, 0.9, 0.1), (0.1, 0.1, 0.9))
    vertices, triangles = icosphere(2)
    order = random.permutation(3)
    shapes = [
        Mesh(name=str(i), vertices=vertices, triangles=random.permutation(triangles), material=int(i)) for i in order
    ]
    image = pyrt.Renderer(scene_of(*shapes, colors=colors)).render(spp=4, size=(48, 48)).image
    alone = pyrt.Renderer(scene_of(shapes[0], colors=colors)).render(spp=4, size=(48, 48)).image
    assert image.max() > 0.1
    assert np.array_equal(image, alone)
