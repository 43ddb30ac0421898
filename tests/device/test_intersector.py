"""The drop-in for trimesh: the same answers as trimesh's own engines, where those are right."""

from __future__ import annotations

import copy
import pickle
import warnings

import numpy as np
import pytest
import trimesh

import pyrt
from tests.meshes import Floats


def replaced(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    mesh.ray = pyrt.RayMeshIntersector(mesh)
    return mesh


@pytest.fixture(scope="module")
def sphere() -> trimesh.Trimesh:
    return replaced(trimesh.creation.icosphere(subdivisions=3))


def rays(count: int, seed: int = 0) -> tuple[Floats, Floats]:
    random = np.random.default_rng(seed)
    return random.normal(size=(count, 3)), random.normal(size=(count, 3))


# Shapes and types -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("count", [0, 1, 50])
def test_shapes_and_types(sphere, count):
    o, d = rays(count)
    assert [(a.shape[1:], a.dtype) for a in sphere.ray.intersects_id(o, d)] == [((), np.int64)] * 2
    locations, index_ray, index_tri = sphere.ray.intersects_location(o, d)
    assert (locations.shape, locations.dtype) == ((len(index_ray), 3), np.float64)
    assert len(index_tri) == len(index_ray)
    first, found = sphere.ray.intersects_first(o, d), sphere.ray.intersects_any(o, d)
    assert (first.shape, first.dtype) == ((count,), np.int32)
    assert (found.shape, found.dtype) == ((count,), np.bool_)
    assert np.array_equal(found, first >= 0)


def test_rays_that_miss(sphere):
    o, d = np.tile([[0.0, 0.0, -5.0]], (10, 1)), np.tile([[0.0, 1.0, 0.0]], (10, 1))
    d[0], d[1], o[2] = 0.0, np.nan, np.inf
    assert [a.shape for a in sphere.ray.intersects_id(o, d, return_locations=True)] == [(0,), (0,), (0, 3)]
    assert (sphere.ray.intersects_first(o, d) == -1).all()


@pytest.mark.parametrize("shapes", [((2, 3), (1, 3)), ((3,), (3,)), ((2, 2), (2, 2))])
def test_rays_that_do_not_fit_are_refused_as_trimesh_does(sphere, shapes):
    with pytest.raises(ValueError, match="rays: expected origins and directions of shape"):
        sphere.ray.intersects_id(*map(np.ones, shapes))


# Hits -------------------------------------------------------------------------------------------------------------


def test_hits_come_nearest_first_and_then_by_ray(sphere):
    o, d = np.array([[0.1, 0.2, -3.0]] * 3), np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 0.01]])
    locations, index_ray, _ = sphere.ray.intersects_location(o, d)
    assert list(index_ray) == [0, 2, 0, 2]
    assert np.array_equal(locations[:, 2] < 0, [True, True, False, False])
    assert np.array_equal(locations[:, :2], [[0.1, 0.2]] * 4)


def test_max_hits_and_the_first_hit(sphere):
    o, d = rays(500)
    every = sphere.ray.intersects_id(o, d, return_locations=True)
    nearest = sphere.ray.intersects_id(o, d, multiple_hits=False, return_locations=True)
    one = sphere.ray.intersects_id(o, d, max_hits=1, return_locations=True)
    for a, b, c in zip(every, nearest, one, strict=True):
        assert np.array_equal(b, c)
        assert np.array_equal(a[: len(b)], b)
    assert len(every[0]) > len(nearest[0])


def test_hits_on_corners_of_a_box_count_once():
    box = replaced(trimesh.creation.box())
    origins = np.zeros_like(box.vertices)
    assert box.ray.intersects_any(origins, box.vertices).all()
    assert np.array_equal(box.ray.intersects_location(origins, box.vertices)[1], np.arange(8))


def test_a_grid_over_a_box():
    """Its borders run along the sides of the box."""
    box = replaced(trimesh.creation.box())
    origins = np.column_stack([trimesh.util.grid_linspace([[-0.5, -0.5], [0.5, 0.5]], 33), np.full(33**2, -100.0)])
    locations, index_ray, _ = box.ray.intersects_location(origins, np.tile([0.0, 0.0, 1.0], (33**2, 1)))
    assert (np.bincount(index_ray) == 2).all()
    assert np.array_equal(locations[:, :2], origins[index_ray, :2])
    assert np.array_equal(np.abs(locations[:, 2]), np.full(2 * 33**2, 0.5))


def test_a_large_box_from_its_face_and_a_small_one_from_afar():
    large = replaced(trimesh.creation.box().apply_scale(10_000.0))
    assert len(large.ray.intersects_id([[0.0, 0.0, 5000.0]], [[0.0, 0.0, -1.0]])[0]) == 1
    small = replaced(trimesh.creation.box(extents=[1e-3] * 3))
    locations = small.ray.intersects_location([[1e-4, 0.0, 1e4]], [[0.0, 0.0, -1.0]])[0]
    assert np.allclose(locations, [[1e-4, 0, 5e-4], [1e-4, 0, -5e-4]], rtol=0, atol=1e-11)


def test_layers_at_any_distance_are_apart():
    """Embree's loop steps a millionth of the mesh's size past a hit, and so over layers closer than that."""
    layers = [trimesh.Trimesh([[0, 0, z], [1, 0, z], [0, 1, z]], [[0, 1, 2]]) for z in (0.0, 1e-7, 2e-7)]
    mesh = replaced(trimesh.util.concatenate(layers))
    assert list(mesh.ray.intersects_id([[0.2, 0.2, 1.0]], [[0.0, 0.0, -1.0]])[0]) == [2, 1, 0]


# What trimesh does with it ----------------------------------------------------------------------------------------


def test_a_changed_mesh_is_noticed():
    box = replaced(trimesh.creation.box())
    ray = [[0.0, 0.0, -5.0]], [[0.0, 0.0, 1.0]]
    assert box.ray.intersects_location(*ray)[0][0, 2] == -0.5
    tracer = box.ray.tracer
    assert box.ray.tracer is tracer
    box.apply_scale(2.0)
    assert box.ray.intersects_location(*ray)[0][0, 2] == -1.0
    box.vertices[:, 2] += 1.0
    assert box.ray.intersects_location(*ray)[0][0, 2] == 0.0
    box.update_faces(np.abs(box.face_normals[:, 2]) < 0.5)
    assert not box.ray.intersects_any(*ray).any()


def test_copies_and_pickles(sphere):
    expected = sphere.ray.intersects_first(*rays(100))
    for each in (copy.copy(sphere.ray), copy.deepcopy(sphere.ray), pickle.loads(pickle.dumps(sphere)).ray):
        assert isinstance(each, pyrt.RayMeshIntersector)
        assert np.array_equal(each.intersects_first(*rays(100)), expected)


def test_contains():
    cavity = trimesh.creation.icosphere(radius=0.5)
    cavity.invert()
    mesh = replaced(trimesh.util.concatenate([trimesh.creation.icosphere(), cavity]))
    points = np.random.default_rng(0).uniform(-1.1, 1.1, (5000, 3))
    radius = np.linalg.norm(points, axis=1)
    sure = (np.abs(radius - 1.0) > 0.02) & (np.abs(radius - 0.5) > 0.02)
    expected = (radius < 1.0) & (radius > 0.5)
    assert np.array_equal(mesh.contains(points)[sure], expected[sure])
    assert not mesh.ray.contains_points([[9.0, 9.0, 9.0]]).any()


def test_samples_and_thickness_and_visibility():
    mesh = replaced(trimesh.creation.box())
    samples = trimesh.sample.volume_mesh(mesh, 200)
    assert len(samples) > 0
    assert (np.abs(samples) <= 0.5).all()
    lengths = trimesh.proximity.longest_ray(mesh, [[0.0, 0.0, 0.0], [3.0, 0, 0]], [[0.0, 0.0, 2.0], [1.0, 0, 0]])
    assert np.array_equal(lengths, [0.5, np.inf])


def test_signed_distance():
    pytest.importorskip("rtree", reason="trimesh needs rtree for distances")
    mesh = replaced(trimesh.creation.icosphere())
    points = np.random.default_rng(0).uniform(-1.2, 1.2, (200, 3))
    distance = trimesh.proximity.signed_distance(mesh, points)
    assert np.allclose(distance, 1 - np.linalg.norm(points, axis=1), atol=0.02)


# Beside trimesh's engines -----------------------------------------------------------------------------------------


def meshes_and_rays(count: int) -> list[tuple[trimesh.Trimesh, Floats, Floats]]:
    knot = trimesh.util.concatenate([trimesh.creation.torus(1.0, r) for r in (0.2, 0.3, 0.4)])
    corners = np.random.default_rng(99).normal(size=(300, 3))
    soup = trimesh.Trimesh(corners, np.arange(300).reshape(-1, 3))
    return [(mesh, *rays(count, seed)) for seed, mesh in enumerate((knot, soup, trimesh.creation.icosphere()))]


def each_ray_in_order(hits: tuple[Floats, ...], chosen: Floats) -> list[Floats]:
    """The hits of the chosen rays, ray by ray. Embree's loop puts rays that were stuck on a triangle last."""
    order = np.argsort(hits[1], kind="stable")
    return [column[order][chosen[hits[1][order]]] for column in hits]


def test_as_embree():
    """The same hits in the same order along each ray; where float32 leaves a choice, one in a thousand may differ."""
    pytest.importorskip("embreex", reason="embreex is not installed")
    from trimesh.ray.ray_pyembree import RayMeshIntersector

    for mesh, o, d in meshes_and_rays(5000):
        theirs, ours = RayMeshIntersector(mesh), pyrt.RayMeshIntersector(mesh)
        same = theirs.intersects_first(o, d) == ours.intersects_first(o, d)
        assert same.mean() > 0.999
        assert (theirs.intersects_any(o, d) == ours.intersects_any(o, d)).mean() > 0.999
        expected, found = (each.intersects_id(o, d, return_locations=True) for each in (theirs, ours))
        assert [a.dtype for a in expected] == [a.dtype for a in found]
        alike = np.bincount(expected[1], minlength=len(o)) == np.bincount(found[1], minlength=len(o))
        assert alike.mean() > 0.999
        a, b = (each_ray_in_order(each, alike) for each in (expected, found))
        assert np.array_equal(a[1], b[1])
        agree = a[0] == b[0]
        assert agree.mean() > 0.999
        assert np.abs(a[2] - b[2])[agree].max() < 1e-4


def test_as_the_triangle_engine():
    """It computes in float64; only a ray within float32's reach of an edge could find another triangle."""
    pytest.importorskip("rtree", reason="trimesh's triangle engine needs rtree")
    from trimesh.ray.ray_triangle import RayMeshIntersector

    for mesh, o, d in meshes_and_rays(400):
        d /= np.linalg.norm(d, axis=1, keepdims=True)
        theirs, ours = RayMeshIntersector(mesh), pyrt.RayMeshIntersector(mesh)
        assert np.array_equal(theirs.intersects_first(o, d), ours.intersects_first(o, d))
        assert np.array_equal(theirs.intersects_any(o, d), ours.intersects_any(o, d))
        expected, found = (each.intersects_location(o, d) for each in (theirs, ours))
        orders = [np.lexsort((each[2], each[1])) for each in (expected, found)]
        for a, b in zip(expected, found, strict=True):
            assert np.allclose(a[orders[0]], b[orders[1]], rtol=0, atol=1e-9)


def test_no_ray_is_lost_where_engines_lose_some():
    """From inside at corners and along axes; their share of misses is what the benchmark prints."""
    mesh = replaced(trimesh.creation.icosphere(subdivisions=4))
    o = np.random.default_rng(0).uniform(-0.3, 0.3, mesh.vertices.shape)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert mesh.ray.intersects_any(o, mesh.vertices - o).all()
        assert np.array_equal(mesh.ray.intersects_id(o, mesh.vertices - o)[1], np.arange(len(o)))
