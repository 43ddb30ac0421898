"""Lists of all hits: complete, in order, each passage once."""

from __future__ import annotations

from itertools import product
from unittest.mock import patch

import numpy as np
import pytest

import pyrt
from pyrt.device import Device
from pyrt.layout import kernel_dir
from pyrt.procedural import icosphere
from tests import meshes
from tests.controls import kernels
from tests.meshes import Floats, Mesh


def counts(hits: pyrt.AllHits, rays: int) -> np.ndarray:
    return np.bincount(hits.ray, minlength=rays)


def bits(hits: pyrt.AllHits) -> list[bytes | int]:
    return [hits.ray.tobytes(), hits.triangle.tobytes(), hits.t.tobytes(), hits.invalid]


def without_double(mesh: Mesh) -> pyrt.RayTracer:
    with patch.object(Device, "has_double", False):
        return pyrt.RayTracer(*mesh)


def brute_force(mesh: Mesh, o: Floats, d: Floats) -> tuple[np.ndarray, np.ndarray]:
    """(k, m): the distances at which rays meet the planes of triangles, inf where they pass by; and how narrowly."""
    a, b, c = mesh[0][mesh[1]].transpose(1, 0, 2)
    n = np.cross(b - a, c - a)
    det = -d @ n.T
    to = o[:, None] - a
    across = np.cross(to, d[:, None])
    u, v = ((c - a) * across).sum(axis=2) / det, -((b - a) * across).sum(axis=2) / det
    t = (to * n).sum(axis=2) / det
    weights = np.stack([u, v, 1 - u - v, t])
    return np.where((weights > 0).all(axis=0), t, np.inf), np.abs(weights).min(axis=0)


@pytest.mark.parametrize("seed", range(3))
def test_as_brute_force(seed):
    random = np.random.default_rng(seed)
    mesh = meshes.soup(meshes.random_triangles(random, 60))
    o, d = random.normal(size=(2, 2000, 3))
    t, margin = brute_force(mesh, o, d)
    clear = ((margin > 1e-4) & (np.abs(t - 1) > 1e-4)).all(axis=1)
    assert clear.mean() > 0.5
    o, d, t = o[clear], d[clear], t[clear]
    for limit, most in ((np.inf, None), (1.0, None), (np.inf, 2)):
        hits = pyrt.RayTracer(*mesh).all_hits(o, d, limit, most)
        inside = np.where(t < limit, t, np.inf)
        order = np.argsort(inside, axis=1)
        expected = [
            (depth, ray, order[ray, depth])
            for depth in range(most or 60)
            for ray in np.flatnonzero(np.isfinite(inside).sum(axis=1) > depth)
        ]
        assert [*zip(hits.ray, hits.triangle, strict=True)] == [(ray, triangle) for _, ray, triangle in expected]
        assert np.isclose(hits.t, inside[hits.ray, hits.triangle], rtol=1e-4, atol=1e-6).all()


def octahedron(levels: int) -> Mesh:
    """|x| + |y| + |z| = 1 with 4^levels triangles a face, watertight, and all its corners exact."""
    corners = np.array([np.diag(sign)[:: int(np.prod(sign))] for sign in product((1.0, -1.0), repeat=3)])
    for _ in range(levels):
        a, b, c = corners.transpose(1, 0, 2)
        ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
        corners = np.concatenate([np.stack(t, axis=1) for t in ((a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca))])
    vertices, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    return vertices, index.reshape(-1, 3)


def rays_on_edges(outside: bool) -> tuple[Mesh, Floats, Floats]:
    """Rays that meet corners and middles of edges of an octahedron exactly, along few directions."""
    vertices, triangles = octahedron(3)
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    targets = np.concatenate([vertices, vertices[edges].mean(axis=1)])
    directions = np.array(list(product((-1.0, -0.5, 0.0, 0.25, 1.0), repeat=3)))
    directions = directions[(directions @ np.array(list(product((1, -1), repeat=3))).T != 0).all(axis=1)]  # in no plane
    o = (targets[:, None] - (4.0 if outside else 0.25) * directions).reshape(-1, 3)
    d = np.tile(directions, (len(targets), 1))
    place = np.abs(o).sum(axis=1)
    kept = place > 1 if outside else place < 1
    return (vertices, triangles), o[kept], d[kept]


def test_a_passage_through_an_edge_or_a_corner_is_one_hit():
    mesh, o, d = rays_on_edges(outside=False)
    assert len(o) > 10_000
    assert (counts(pyrt.RayTracer(*mesh).all_hits(o, d), len(o)) == 1).all()


def test_rays_from_outside_hit_twice_even_where_they_only_graze_the_outline():
    mesh, o, d = rays_on_edges(outside=True)
    number = counts(pyrt.RayTracer(*mesh).all_hits(o, d), len(o))
    assert (number == 2).all()


def test_unmerged_hits_are_seen():
    text = (kernel_dir() / "all_hits.h").read_text(encoding="utf-8")
    assert text.count("return list->edges ?") == 1
    with kernels(files={"all_hits.h": text.replace("return list->edges ?", "return false ?")}):
        mesh, o, d = rays_on_edges(outside=False)
        assert (counts(pyrt.RayTracer(*mesh).all_hits(o, d), len(o)) > 1).mean() > 0.5


def patch_of_squares(side: int) -> Mesh:
    """The unit square at z = 0 as 2·side² triangles."""
    y, x = np.divmod(np.arange((side + 1) ** 2), side + 1)
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).ravel()
    squares = np.stack([corner, corner + 1, corner + side + 2, corner + side + 1], axis=1)
    return np.stack([x / side, y / side, 0 * x], axis=1), squares[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3)


def test_a_grid_of_rays_on_edges_and_borders_of_an_open_mesh():
    mesh = patch_of_squares(8)
    places = np.stack(np.meshgrid(*[np.linspace(0, 1, 65)] * 2), axis=-1).reshape(-1, 2)
    o = np.column_stack([places, np.ones(len(places))])
    hits = pyrt.RayTracer(*mesh).all_hits(o, np.tile([0.0, 0.0, -1.0], (len(o), 1)))
    assert np.array_equal(hits.ray, np.arange(len(o)))


def shells(count: int) -> Mesh:
    vertices, triangles = icosphere(1)
    radii = np.linspace(0.1, 1, count)
    return (radii[:, None, None] * vertices).reshape(-1, 3), np.concatenate(
        [triangles + i * len(vertices) for i in range(count)]
    )


def shell_rays(mesh: Mesh, count: int) -> tuple[Floats, Floats]:
    """Half of them to corners, so that most need the second pass and many meet edges."""
    random = np.random.default_rng(0)
    o, d = random.normal(size=(2, count, 3))
    d[::2] = mesh[0][random.integers(0, len(mesh[0]), len(d[::2]))] - o[::2]
    return o, d


def test_the_parity_of_hits_tells_inside_from_outside():
    mesh = shells(30)
    o, d = shell_rays(mesh, 2000)
    tracer = pyrt.RayTracer(*mesh)
    parity = counts(tracer.all_hits(o, d), len(o)) % 2
    assert np.array_equal(parity, counts(tracer.all_hits(o, np.tile([0.3, 0.5, 0.7], (len(o), 1))), len(o)) % 2)
    assert 0.05 < parity.mean() < 0.95


def test_batches_and_precision_of_the_device_change_nothing():
    mesh = shells(20)
    o, d = shell_rays(mesh, 600)
    o[7], d[9] = np.nan, 0.0
    tracer = pyrt.RayTracer(*mesh)
    for most in (None, 1, 3, 10, 1000):
        hits = tracer.all_hits(o, d, np.inf, most)
        assert hits.invalid == 2
        number = counts(hits, len(o))
        assert number.max() == 40 if most in (None, 1000) else (number <= most).all()
        assert np.array_equal(hits.ray, np.concatenate([np.flatnonzero(number > i) for i in range(number.max())]))
        assert bits(without_double(mesh).all_hits(o, d, np.inf, most)) == bits(hits)
        with patch("pyrt.rays.BATCH", 131), patch("pyrt.tracer._CROWD", 300):
            assert bits(tracer.all_hits(o, d, np.inf, most)) == bits(hits)


def test_the_first_of_all_hits_is_the_closest():
    mesh = shells(5)
    o, d = shell_rays(mesh, 2000)
    tracer = pyrt.RayTracer(*mesh)
    closest, hits = tracer.closest(o, d), tracer.all_hits(o, d, max_hits=1)
    assert np.array_equal(hits.ray, np.flatnonzero(closest.triangle >= 0))
    assert np.array_equal(hits.triangle, closest.triangle[hits.ray])
    assert np.array_equal(hits.t, closest.t[hits.ray])


def test_a_thousand_triangles_in_one_place():
    mesh = meshes.soup(np.tile([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], (1000, 1, 1)))
    hits = pyrt.RayTracer(*mesh).all_hits([[0.2, 0.3, 1]], [[0, 0, -1]])
    assert np.array_equal(hits.triangle, np.arange(1000))


def test_dropped_triangles_leave_the_numbers_of_the_others():
    corners = np.array([[[0, 0, z], [1, 0, z], [0, 1, z]] for z in (0.0, np.nan, 2.0, 3.0)])
    corners[2, 2] = corners[2, 1]
    with pytest.warns(UserWarning, match="2 of 4 triangles"):
        tracer = pyrt.RayTracer(*meshes.soup(corners))
    o, d = [[0.2, 0.3, 4.0]], [[0.0, 0.0, -2.0]]
    hits = tracer.all_hits(o, d)
    assert (list(hits.triangle), list(hits.t)) == ([3, 0], [0.5, 2.0])
    assert np.array_equal(tracer.locate(o, d, hits.ray, hits.triangle), [[0.2, 0.3, 3.0], [0.2, 0.3, 0.0]])


@pytest.mark.parametrize("place", [0.0, 1e6])
def test_located_points_lie_on_ray_and_plane(place):
    random = np.random.default_rng(0)
    mesh = meshes.soup(meshes.random_triangles(random, 60) + place)
    o, d = random.normal(size=(2, 3000, 3))
    o, d = o + place, d * 10.0 ** random.uniform(-200, 200, (3000, 1))
    tracer = pyrt.RayTracer(*mesh)
    hits = tracer.all_hits(o, d)
    points = tracer.locate(o, d, hits.ray, hits.triangle)
    assert np.array_equal(points, without_double(mesh).locate(o, d, hits.ray, hits.triangle))
    axis = d[hits.ray] / np.abs(d[hits.ray]).max(axis=1, keepdims=True)
    axis /= np.linalg.norm(axis, axis=1, keepdims=True)
    rounding = 8 * np.spacing(np.abs(points).max())
    assert np.linalg.norm(np.cross(points - o[hits.ray], axis), axis=1).max() < rounding
    a, b, c = (mesh[0][mesh[1]] - place)[hits.triangle].transpose(1, 0, 2)
    n = np.cross(b - a, c - a)
    n /= np.linalg.norm(n, axis=1, keepdims=True)
    slope = 1 / np.abs((axis * n).sum(axis=1))
    assert (np.abs(((points - place - a) * n).sum(axis=1)) < rounding * np.maximum(slope, 1)).all()


def test_a_ray_in_the_plane_of_a_triangle_is_located_on_it():
    tracer = pyrt.RayTracer([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    points = tracer.locate([[-1.0, 0.25, 0]], [[1.0, 0, 0]], np.zeros(1, np.int64), np.zeros(1, np.int64))
    assert np.isfinite(points).all()
    assert 0 <= points[0, 0] <= 1


def test_points_are_located_by_indices_of_any_kind():
    tracer = pyrt.RayTracer([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    o, d = [[0.2, 0.3, 1.0]] * 2, [[0.0, 0, -1]] * 2
    hits = tracer.closest(o, d)
    for ray in ([1, 0], np.uint8([1, 0]), np.arange(4)[1::-1]):
        assert np.array_equal(tracer.locate(o, d, ray, hits.triangle), [[0.2, 0.3, 0.0]] * 2)
    assert tracer.locate(o, d, [], []).shape == (0, 3)


@pytest.mark.parametrize(
    ("ray", "triangle", "message"),
    [
        ([0, 1], [0, -1], "triangle: expected indices from 0 to 0, got -1 to 0"),
        ([0, 2], [0, 0], "ray: expected indices from 0 to 1, got 0 to 2"),
        ([0, 1], [0], "triangle: expected as many as in ray, 2, got 1"),
        ([0.0], [0], r"ray: expected an integer array of shape \(h,\), got float64 \(1,\)"),
    ],
)
def test_points_that_there_are_not_are_refused(ray, triangle, message):
    tracer = pyrt.RayTracer([[0.0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(pyrt.UsageError, match=message):
        tracer.locate([[0.2, 0.3, 1.0]] * 2, [[0.0, 0, -1]] * 2, ray, triangle)
