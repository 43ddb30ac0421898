"""The truth is tested too: closed forms against brute force and against each other."""

from __future__ import annotations

import numpy as np
import pytest

from pyrt.scene import (
    Camera,
    ConstantTexture,
    Dielectric,
    Diffuse,
    Mesh,
    PointLight,
    Rectangle,
    Refraction,
    Scene,
    Sphere,
)
from tests.reference import analytic, geometry, tracer
from tests.reference.statistics import Estimate, assert_agrees, gaussian, replicate, threshold, z_scores

SQUARE = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
CEILING = np.insert(SQUARE[::-1], 2, 1.0, 1)  # unit square at z = 1 that shines down
UP = np.array([0.0, 0.0, 1.0])


def floor_points(rng: np.random.Generator, count: int = 200) -> tuple[np.ndarray, np.ndarray]:
    points = np.append(rng.uniform(-1, 1, (count, 2)), np.zeros((count, 1)), 1)
    return points, np.broadcast_to(UP, points.shape)


def square_quadrature(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes (n, 2) on the square of side 1 around the origin, and weights that add up to 1."""
    x, w = np.polynomial.legendre.leggauss(order)
    return np.stack(np.meshgrid(x / 2, x / 2), 2).reshape(-1, 2), np.outer(w, w).ravel() / 4


def area_integral(points, normals, nodes, weights, area, front):
    """Irradiance by quadrature over a light, for comparison."""
    to_light = nodes - points[:, None]
    r2 = analytic.dot(to_light, to_light)
    cosines = np.maximum(analytic.dot(to_light, normals[:, None]), 0) * np.maximum(-to_light @ front, 0)
    return (cosines / r2**2) @ weights * area


# Lights ---------------------------------------------------------------------------------------------------------------


def test_lamberts_formula_is_the_integral_over_the_light():
    points, normals = floor_points(np.random.default_rng(1))
    nodes, weights = square_quadrature(24)
    expected = area_integral(points, normals, np.insert(nodes, 2, 1.0, 1), weights, 1.0, -UP)
    np.testing.assert_allclose(analytic.polygon_irradiance(points, normals, CEILING), expected, rtol=1e-12)


def test_lamberts_formula_clips_at_the_horizon():
    """A wall light from z = -1 to z = 1 counts for its upper half only; seen from behind, not at all."""
    wall = np.array([(0, -1, -1), (0, 1, -1), (0, 1, 1), (0, -1, 1.0)])  # shines towards +x
    above = np.array([(0, -1, 0), (0, 1, 0), (0, 1, 1), (0, -1, 1.0)])
    points, normals = floor_points(np.random.default_rng(2))
    clipped = analytic.polygon_irradiance(points, normals, wall)
    np.testing.assert_allclose(clipped, analytic.polygon_irradiance(points, normals, above), rtol=1e-12, atol=1e-15)
    assert (clipped[points[:, 0] > 0] > 0).all()
    assert (clipped[points[:, 0] < 0] == 0).all()


@pytest.mark.parametrize("solid_angle", [1e-3, 1e-6, 1e-9])
def test_small_lights_obey_the_inverse_square_law(solid_angle):
    size = np.sqrt(solid_angle)
    light = CEILING * (size, size, 1)
    irradiance = analytic.polygon_irradiance(np.zeros((1, 3)), UP[None], light)
    np.testing.assert_allclose(irradiance, solid_angle, rtol=max(solid_angle, 1e-6))


@pytest.mark.parametrize(
    ("receiver", "normal", "light", "expected"),
    [
        (np.insert(SQUARE, 2, 0.0, 1), UP, CEILING, analytic.FORM_FACTOR_PARALLEL),
        (
            np.insert(SQUARE + 0.5, 2, 0.0, 1),
            UP,
            np.insert(SQUARE[::-1] + 0.5, 1, 0.0, 1)[::-1],
            analytic.FORM_FACTOR_PERPENDICULAR,
        ),
    ],
    ids=["parallel", "perpendicular"],
)
def test_form_factors_of_unit_squares(receiver, normal, light, expected):
    if analytic.unit(np.cross(light[1] - light[0], light[2] - light[0])) @ (receiver.mean(0) - light.mean(0)) < 0:
        light = light[::-1]
    nodes, weights = square_quadrature(200)
    points = receiver.mean(0) + np.insert(nodes, 2, 0.0, 1)
    irradiance = analytic.polygon_irradiance(points, np.broadcast_to(normal, points.shape), light)
    assert irradiance @ weights / np.pi == pytest.approx(expected, abs=1e-6)


def test_sphere_light_is_a_cosine_weighted_cone():
    points, normals = floor_points(np.random.default_rng(3), 20)
    sphere = Sphere(name="", center=(0.2, 0.1, 1.0), radius=0.5, radiance=(1, 1, 1))
    at = tracer.Receivers(points, normals, normals)
    scene = Scene(shapes=(sphere,))
    world = tracer.World(scene, geometry.build(scene), np.array([-1]), 100, np.random.default_rng(4))
    expected = analytic.sphere_irradiance(points, normals, sphere.center, sphere.radius)
    np.testing.assert_allclose(tracer._sampled_sphere(world, at, sphere), expected, rtol=2e-3)


# Penumbrae ------------------------------------------------------------------------------------------------------------


def brute_force(points, normals, occluders, cells=160):
    """Unoccluded irradiance of CEILING by shadow rays to the centres of cells² squares."""
    grid = (np.arange(cells) + 0.5) / cells - 0.5
    nodes = np.insert(np.stack(np.meshgrid(grid, grid), 2).reshape(-1, 2), 2, 1.0, 1)
    targets = np.broadcast_to(nodes, (len(points), *nodes.shape)).reshape(-1, 3)
    mesh = Mesh(name="", vertices=occluders.reshape(-1, 3), triangles=np.arange(3 * len(occluders)).reshape(-1, 3))
    blocked = geometry.occluded(geometry.build(Scene(shapes=(mesh,))), np.repeat(points, len(nodes), 0), targets)
    to_light = targets - np.repeat(points, len(nodes), 0)
    value = to_light[:, 2] ** 2 / analytic.dot(to_light, to_light) ** 2 * ~blocked
    return value.reshape(len(points), -1).mean(1)


def test_penumbra_of_overlapping_triangles_is_what_shadow_rays_find():
    """Occluders reach below the receiver and behind the light, overlap each other and cross."""
    rng = np.random.default_rng(5)
    points, normals = floor_points(rng, 30)
    occluders = rng.uniform((-1, -1, -0.5), (1, 1, 1.4), (8, 3, 3))
    exact = analytic.visible_irradiance(points, normals, CEILING, occluders)
    assert (exact < 0.95 * analytic.polygon_irradiance(points, normals, CEILING)).mean() > 0.5
    np.testing.assert_allclose(exact, brute_force(points, normals, occluders), atol=3e-3)


def test_occluders_form_a_union():
    rng = np.random.default_rng(6)
    points, normals = floor_points(rng)
    occluders = rng.uniform((-1, -1, 0.1), (1, 1, 0.9), (3, 3, 3))
    once = analytic.visible_irradiance(points, normals, CEILING, occluders)
    again = analytic.visible_irradiance(points, normals, CEILING, np.concatenate([occluders[::-1], occluders[:, ::-1]]))
    np.testing.assert_allclose(again, once, atol=1e-12)


@pytest.mark.parametrize("height", [-0.5, 1.0, 1.5])
def test_what_is_not_between_receiver_and_light_hides_nothing(height):
    points, normals = floor_points(np.random.default_rng(7))
    plate = np.array([[(-9, -9, height), (9, -9, height), (0, 9, height)]])
    open_sky = analytic.polygon_irradiance(points, normals, CEILING)
    np.testing.assert_allclose(analytic.visible_irradiance(points, normals, CEILING, plate), open_sky, rtol=1e-12)


def test_half_plane_hides_half_of_a_light():
    half = np.array([[(0, -99, 0.5), (99, 0, 0.5), (0, 99, 0.5)]])
    seen = analytic.visible_irradiance(np.zeros((1, 3)), UP[None], CEILING, half)
    np.testing.assert_allclose(seen, analytic.polygon_irradiance(np.zeros((1, 3)), UP[None], CEILING) / 2, rtol=1e-12)


def test_unoccluded_is_a_proof():
    """No segment that it calls free is blocked, and it finds most of the free ones."""
    rng = np.random.default_rng(8)
    box = rng.uniform(-0.5, 0.5, (6, 3))
    hull = np.array([box[list(c)] for c in [(a, b, c) for a in range(6) for b in range(a) for c in range(b)]])
    mesh = Mesh(name="", vertices=hull.reshape(-1, 3), triangles=np.arange(hull.size // 3).reshape(-1, 3))
    a, b = rng.uniform(-1, 1, (2, 2000, 3))
    blocked = geometry.occluded(geometry.build(Scene(shapes=(mesh,))), a, b)
    outside = ~geometry.occluded(geometry.build(Scene(shapes=(mesh,))), a, a + np.array([9, 0, 0]))
    free = analytic.unoccluded(box, a[:, None], b[:, None])
    assert not (free & blocked).any()
    assert free[~blocked & outside].mean() > 0.9


# Refraction -----------------------------------------------------------------------------------------------------------


def incoming(theta: np.ndarray) -> np.ndarray:
    return np.stack([np.sin(theta), np.zeros_like(theta), -np.cos(theta)], -1)


@pytest.mark.parametrize("eta", [0.5, 1 / 1.5, 1.0, 1.33, 2.0])
def test_refraction_obeys_snell_and_can_be_reversed(eta):
    theta = np.linspace(0.01, 1.5, 40)
    theta = theta[np.sin(theta) * eta < 1]
    normals = np.broadcast_to(UP, (len(theta), 3))
    bent = analytic.refract(incoming(theta), normals, eta)
    np.testing.assert_allclose(bent[:, 0], eta * np.sin(theta), rtol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(bent, axis=1), 1, rtol=1e-12)
    np.testing.assert_allclose(analytic.refract(-bent, normals, 1 / eta), -incoming(theta), atol=1e-12)


def test_total_internal_reflection_mirrors():
    theta = np.linspace(0.6, 1.5, 10)
    mirrored = analytic.refract(incoming(theta), np.broadcast_to(-UP, (10, 3)), 2.0)
    np.testing.assert_allclose(mirrored, incoming(theta) * (1, 1, -1), atol=1e-12)


def test_slab_shifts_a_ray_and_keeps_its_direction():
    theta, ior, thickness = np.linspace(0.1, 1.4, 10), 1.5, 0.3
    normals = np.broadcast_to(UP, (10, 3))
    inside = analytic.refract(incoming(theta), normals, 1 / ior)
    leaving = analytic.refract(inside, normals, ior)
    exit_point = inside * (thickness / -inside[:, 2:])
    shift = np.linalg.norm(np.cross(exit_point, leaving), axis=1)
    np.testing.assert_allclose(leaving, incoming(theta), atol=1e-12)
    np.testing.assert_allclose(shift, analytic.slab_shift(theta, thickness, ior), rtol=1e-12)


def test_prism_deviates_by_the_sum_of_its_angles():
    theta, apex, ior = np.linspace(0.5, 1.2, 10), 0.9, 1.5
    normal = np.broadcast_to(UP, (10, 3))
    second = np.broadcast_to((-np.sin(apex), 0, -np.cos(apex)), (10, 3))
    leaving = analytic.refract(analytic.refract(incoming(-theta), normal, 1 / ior), second, ior)
    turned = np.arccos(analytic.dot(leaving, incoming(-theta)))
    np.testing.assert_allclose(turned, np.abs(analytic.prism_deviation(theta, apex, ior)), rtol=1e-9)


def test_ball_lens_deviates_by_twice_the_difference_of_its_angles():
    offset, radius, ior = np.linspace(0.01, 0.9, 10), 1.0, 1.5
    start = np.stack([offset, np.zeros(10), np.full(10, 5.0)], 1)
    scene = Scene(shapes=(Sphere(name="", center=(0, 0, 0), radius=radius),))
    rays = start, np.broadcast_to(-UP, start.shape)
    for eta in (1 / ior, ior):
        hits = geometry.closest(geometry.build(scene), *rays)
        rays = hits.point, analytic.refract(rays[1], hits.normal, eta)
    np.testing.assert_allclose(np.arccos(-rays[1][:, 2]), analytic.ball_lens_deviation(offset, radius, ior), rtol=1e-9)


def test_fresnel_at_normal_brewster_and_critical_angles():
    ior = 1.5
    assert analytic.fresnel(1.0, 1 / ior) == pytest.approx(0.04, rel=1e-12)
    brewster, transmitted = np.arctan(ior), np.arctan(1 / ior)
    half = np.sin(brewster - transmitted) ** 2 / np.sin(brewster + transmitted) ** 2 / 2
    assert analytic.fresnel(np.cos(brewster), 1 / ior) == pytest.approx(half, rel=1e-12)
    assert analytic.fresnel(np.cos(np.arcsin(1 / ior) + 1e-6), ior) == 1.0
    assert analytic.fresnel(0.3, 1 / ior) == pytest.approx(analytic.fresnel(np.sqrt(1 - 0.91 / ior**2), ior), rel=1e-12)


# Tracer ---------------------------------------------------------------------------------------------------------------


def test_sampled_and_exact_area_lights_agree(monkeypatch):
    block = Rectangle(name="", center=(0.2, 0, 0.5), edge1=(0.6, 0, 0.2), edge2=(0, 0.7, 0), material=0)
    floor = Rectangle(name="", center=(0, 0, 0), edge1=(3, 0, 0), edge2=(0, 3, 0), material=0)
    lamp = Rectangle(name="", center=(0, 0, 1), edge1=(0, 1, 0), edge2=(1, 0, 0), radiance=(1, 2, 3))
    scene = Scene(
        camera=Camera((3, -3, 2), (0, 0, 0), (0, 0, 1), 45),
        textures=(ConstantTexture((0.5, 0.6, 0.7)),),
        materials=(Diffuse(0),),
        shapes=(floor, block, lamp),
    )
    exact = tracer.reference_image(scene, (8, 8), 3)
    monkeypatch.setattr(tracer, "EXACT_TRIANGLES", 0)
    sampled = tracer.reference_image(scene, (8, 8), 3, seed=1)
    assert_agrees(z_scores(exact, sampled))


@pytest.mark.parametrize("material", [Refraction(2.0), Refraction(0.7), Dielectric(1.5, 1.0)], ids=str)
def test_nothing_lossless_is_visible_in_a_furnace(material):
    """Inside a closed box that shines with radiance 1 everywhere, glass looks like nothing at all."""
    corners = np.array(np.meshgrid(*3 * [(-1.0, 1.0)], indexing="ij")).reshape(3, -1).T
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((c, b, a), (d, c, a))], np.int32)
    box = Mesh(name="", vertices=corners, triangles=faces, radiance=(1, 1, 1))
    ball = Sphere(name="", center=(0, 0, 0), radius=0.5, material=0)
    scene = Scene(camera=Camera((0, 0, 0.9)), materials=(material,), shapes=(box, ball), max_depth=64)
    np.testing.assert_allclose(tracer.reference_image(scene, (6, 6), 2).mean, 1.0, rtol=1e-5)


def test_many_triangles_are_found_as_among_few(monkeypatch):
    rng = np.random.default_rng(9)
    corners = rng.uniform(-1, 1, (500, 1, 3)) + rng.uniform(-0.1, 0.1, (500, 3, 3))
    mesh = Mesh(name="", vertices=corners.reshape(-1, 3), triangles=np.arange(1500, dtype=np.int32).reshape(-1, 3))
    origins, targets = rng.uniform(-1, 1, (2, 500, 3))
    found = []
    for size in (10, 1000):
        monkeypatch.setattr(geometry, "CLUSTER_SIZE", size)
        world = geometry.build(Scene(shapes=(mesh,)))
        hits = geometry.closest(world, origins, analytic.unit(targets - origins))
        found.append((hits.shape, hits.point, geometry.occluded(world, origins, targets)))
    for few, many in zip(*found, strict=True):
        np.testing.assert_array_equal(few, many)
    assert 0.1 < found[0][2].mean() < 0.9


def test_point_light_on_a_plane_is_the_closed_form():
    floor = Rectangle(name="", center=(0, 0, 0), edge1=(9, 0, 0), edge2=(0, 9, 0), material=0)
    light = PointLight((0.3, 0.2, 1.0), (5.0, 6.0, 7.0))
    camera = Camera((0, 0, 2), (0, 0, 0), (0, 1, 0), 45)
    texture = ConstantTexture((0.5, 0.5, 0.5))
    scene = Scene(camera=camera, textures=(texture,), materials=(Diffuse(0),), shapes=(floor,), lights=(light,))
    film = np.random.default_rng(10).random((50, 2)) * 8
    origins, directions = tracer.camera_rays(camera, (8, 8), film)
    points = origins + directions * (2 / -directions[:, 2:])
    half = np.tan(np.radians(22.5)) * 2
    np.testing.assert_allclose(points[:, :2], (film / 4 - 1) * (half, -half), atol=1e-12)
    seen = tracer.radiance(scene, origins, directions, 1, np.random.default_rng(0))
    normals = np.broadcast_to(UP, points.shape)
    expected = 0.5 / np.pi * analytic.point_irradiance(points, normals, light.position, light.flux)
    np.testing.assert_allclose(seen, expected, rtol=1e-9)


# Statistics -----------------------------------------------------------------------------------------------------------


def test_threshold_is_the_normal_quantile():
    assert threshold(1, 0.05) == pytest.approx(1.95996, abs=1e-5)
    assert threshold(1000, 1e-3) == pytest.approx(4.8916, abs=1e-4)


@pytest.mark.parametrize(("freedom", "quantile"), [(5, 2.5706), (15, 2.1314), (31, 2.0395)])
def test_students_t_becomes_normal(freedom, quantile):
    assert gaussian(quantile, freedom) == pytest.approx(1.96, rel=0.01)


def test_bias_is_found_and_noise_is_not():
    rng = np.random.default_rng(11)
    estimate = replicate(rng.normal(3.0, 0.1, (64, 20, 20)))
    assert_agrees(z_scores(estimate, 3.0))
    with pytest.raises(AssertionError, match=r"\|z\|"):
        assert_agrees(z_scores(Estimate(estimate.mean + 0.05, estimate.variance), 3.0))


def test_exact_zero_must_be_met_exactly():
    assert z_scores(Estimate(np.zeros(1), np.zeros(1)), 0.0) == 0
    assert z_scores(Estimate(np.full(1, 1e-12), np.zeros(1)), 0.0) == np.inf
