"""Refraction against closed paths: what is seen through discs, slabs, prisms and balls, and how bright it is."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pyrt.scene import (
    Camera,
    Dielectric,
    Diffuse,
    ImageTexture,
    Material,
    Mesh,
    PointLight,
    Rectangle,
    Refraction,
    Scene,
    Shape,
    Sphere,
)
from tests.reference import analytic
from tests.reference.analytic import Array
from tests.reference.rendering import assert_renders, make_scene, replicates
from tests.reference.tracer import pixel_average

SIZE = (8, 8)
UP = np.array([0.0, 0.0, 1.0])
LIGHT = PointLight((0.3, 0.2, 0.5), (9.0, 9.0, 9.0))
SCREEN = Rectangle(name="screen", center=(0, 0, 0), edge1=(16, 0, 0), edge2=(0, 16, 0), material=0)
PANE = Rectangle(name="pane", center=(0, 0, 1), edge1=(16, 0, 0), edge2=(0, 16, 0), material=1)
GLASS = Refraction(2.0)
CAMERA = Camera((0.1, -0.3, 3), (0.2, 0.1, 0), (0, 1, 0), 20)

# Bilinear interpolation makes a 2×2 image a linear function of place between its texel centres: colour tells where.
RAMP = ImageTexture(np.array([[(0.1, 0.1, 0.5), (0.9, 0.1, 0.5)], [(0.1, 0.9, 0.5), (0.9, 0.9, 0.5)]], np.float32))


def screen_radiance(points: Array) -> Array:
    st = points[:, :2] / 16 + 0.5
    assert (np.abs(st - 0.5) < 0.25).all()
    ramp = 0.1 + 1.6 * (st - 0.25)
    albedo = np.append(ramp, np.full((len(st), 1), 0.5), 1)
    normals = np.broadcast_to(UP, points.shape)
    return albedo / np.pi * analytic.point_irradiance(points, normals, LIGHT.position, LIGHT.flux)


def to_plane(origins: Array, directions: Array, height: float) -> Array:
    return origins + directions * ((height - origins[:, 2:]) / directions[:, 2:])


def glass_scene(*shapes: Shape, material: Material = GLASS, camera: Camera = CAMERA, max_depth: int = 16) -> Scene:
    """The screen, lit by LIGHT, and shapes of which material 1 is `material`."""
    materials, textures = (Diffuse(0), material), (RAMP,)
    return make_scene(
        SCREEN, *shapes, camera=camera, lights=(LIGHT,), materials=materials, textures=textures, max_depth=max_depth
    )


def through(path: Callable[[Array, Array], Array], camera: Camera = CAMERA) -> Array:
    """Picture of the screen where `path` says at which points camera rays end."""
    return pixel_average(camera, SIZE, lambda o, d: screen_radiance(path(o, d)))


# Perfect refraction ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("eta", [2.0, 1 / 1.5, 1.0, 1 + 1e-6, 0.25])
@pytest.mark.parametrize("side", ["front", "back"])
def test_flat_disc_bends_once_by_snells_law(eta, side):
    """The disc is a single surface: entering its front multiplies the sine by eta, entering its back divides by it."""
    ratio = eta if side == "front" else 1 / eta
    camera = replace(CAMERA, fov=20 if ratio <= 2 else 6, look_at=CAMERA.look_at if ratio <= 2 else (0.1, -0.3, 0))

    def path(origins: Array, directions: Array) -> Array:
        bent = analytic.refract(directions, np.broadcast_to(UP, directions.shape), ratio)
        assert (bent[:, 2] < 0).all()
        return to_plane(to_plane(origins, directions, 1), bent, 0)

    pane = PANE if side == "front" else replace(PANE, edge2=(0, -16, 0))
    assert_renders(glass_scene(pane, material=Refraction(eta), camera=camera), through(path, camera), 256, bias=1e-5)


def test_total_internal_reflection_mirrors():
    """Beyond 30° a pane of eta 2 sends all light back: the screen below is seen from below the pane, by reflection."""
    camera = Camera((-2, 0, 0.3), (-1, 0, 1), (0, 0, 1), 10)
    pane = replace(PANE, edge2=(0, -16, 0))

    def path(origins: Array, directions: Array) -> Array:
        assert (2 * np.hypot(directions[:, 0], directions[:, 1]) > 1).all()
        return to_plane(to_plane(origins, directions, 1), directions * (1, 1, -1), 0)

    assert_renders(glass_scene(pane, camera=camera), through(path, camera), spp=256, bias=1e-5)


@pytest.mark.parametrize("ior", [1.01, 1.5, 4.0])
def test_slab_shifts_the_picture(ior):
    """The ray leaves parallel to itself, shifted by t sinθ (1 − cosθ / √(n² − sin²θ)) towards the plate's normal."""
    slab = [replace(PANE, center=(0, 0, 1.5)), replace(PANE, edge2=(0, -16, 0))]
    camera = replace(CAMERA, position=(0.6, -1.5, 3))

    def path(origins: Array, directions: Array) -> Array:
        cosine = -directions[:, 2]
        along = directions[:, :2] / np.linalg.norm(directions[:, :2], axis=1, keepdims=True)
        moved = analytic.slab_shift(np.arccos(cosine), 0.5, ior) / cosine
        return to_plane(origins, directions, 0) - np.append(along * moved[:, None], np.zeros((len(moved), 1)), 1)

    scene = glass_scene(*slab, material=Refraction(1 / ior), camera=camera)
    assert_renders(scene, through(path, camera), spp=256, bias=1e-5)


def test_prism_turns_the_view():
    """Two faces at 0.3 rad; both are crossed by every ray."""
    apex, ior = 0.3, 1.5
    lower = np.array([-math.sin(apex), 0.0, -math.cos(apex)])
    slanted = replace(PANE, edge1=(2 * math.cos(apex), 0, -2 * math.sin(apex)), edge2=(0, -2, 0))
    prism = [replace(PANE, center=(0, 0, 1.5), edge1=(2, 0, 0), edge2=(0, 2, 0)), slanted]
    camera = replace(CAMERA, look_at=(0.1, -0.3, 0))

    def path(origins: Array, directions: Array) -> Array:
        entry = to_plane(origins, directions, 1.5)
        inside = analytic.refract(directions, np.broadcast_to(UP, entry.shape), 1 / ior)
        leave = entry + inside * (((np.array(slanted.center) - entry) @ lower) / (inside @ lower))[:, None]
        return to_plane(leave, analytic.refract(inside, np.broadcast_to(lower, entry.shape), ior), 0)

    scene = glass_scene(*prism, material=Refraction(1 / ior), camera=camera)
    assert_renders(scene, through(path, camera), spp=256, bias=1e-5)


@pytest.mark.parametrize("ior", [1.1, 1.5, 2.0])
def test_ball_lens_turns_the_view(ior):
    """Every ray turns by 2(θ_i − θ_t) in the plane of the ball's centre, halfway at each surface."""
    center, radius = np.array([0.1, -0.3, 1.6]), 0.5
    ball = Sphere(name="ball", center=tuple(center), radius=radius, material=1)
    camera = Camera((0.1, -0.3, 3), (0.1, -0.3, 0), (0, 1, 0), 20)

    def path(origins: Array, directions: Array) -> Array:
        closest = origins + directions * ((center - origins) * directions).sum(1, keepdims=True) - center
        offset = np.linalg.norm(closest, axis=1, keepdims=True)
        axis = -closest / offset
        turn = analytic.ball_lens_deviation(offset, radius, ior)
        out = np.cos(turn) * directions + np.sin(turn) * axis
        # By symmetry the leaving ray passes the centre at the same distance, on the side turned with it.
        nearest = center - offset * (np.cos(turn) * axis - np.sin(turn) * directions)
        return to_plane(nearest, out, 0)

    scene = glass_scene(ball, material=Refraction(1 / ior), camera=camera)
    assert_renders(scene, through(path, camera), spp=256, bias=1e-5)


@pytest.mark.parametrize(
    ("test", "form"),
    [(test_slab_shifts_the_picture, "slab_shift"), (test_ball_lens_turns_the_view, "ball_lens_deviation")],
)
def test_a_path_that_is_off_by_a_thousandth_is_noticed(test, form, monkeypatch):
    right = getattr(analytic, form)
    monkeypatch.setattr(analytic, form, lambda *arguments: right(*arguments) * 1.001)
    with pytest.raises(AssertionError):
        test(1.5)


@pytest.mark.parametrize("material", [Refraction(1.0), Dielectric(1.5, 1.5)], ids=["refraction", "dielectric"])
def test_glass_of_the_same_index_is_invisible(material):
    ball = Sphere(name="ball", center=(0.2, 0, 1.6), radius=0.3, material=1)
    truth = through(lambda o, d: to_plane(o, d, 0))
    assert_renders(glass_scene(ball, material=material), truth, spp=256, bias=1e-5)


@pytest.mark.parametrize("lean", [30, 85])
def test_glass_bends_by_its_shading_normal_unless_that_faces_away(lean):
    """One normal for all of a pane; leaning by 85° it faces away from the camera, and the geometric one stands in."""
    normal = np.array([-math.sin(math.radians(lean)), 0.0, math.cos(math.radians(lean))])
    pane = Mesh(
        name="pane",
        material=1,
        vertices=np.array([(-9.0, -9.0, 1.0), (9.0, -9.0, 1.0), (0.0, 9.0, 1.0)]),
        triangles=np.array([(0, 1, 2)], np.int32),
        normals=np.broadcast_to(normal.astype(np.float32), (1, 3, 3)),
    )
    camera = Camera((1, 0, 3), (0, 0, 1), (0, 1, 0), 6)
    bending = normal if lean == 30 else UP

    def path(origins: Array, directions: Array) -> Array:
        assert (directions @ normal < 0).all() == (lean == 30)
        bent = analytic.refract(directions, np.broadcast_to(bending, directions.shape), 1 / 1.5)
        return to_plane(to_plane(origins, directions, 1), bent, 0)

    scene = glass_scene(pane, material=Refraction(1 / 1.5), camera=camera)
    assert_renders(scene, through(path, camera), spp=256, bias=1e-5)


@pytest.mark.parametrize("max_depth", [0, 1, 3, 4, 16])
def test_path_ends_black_after_max_depth_events(max_depth):
    panes = [replace(PANE, center=(0, 0, 1 + 0.2 * i)) for i in range(4)]
    scene = glass_scene(*panes, material=Refraction(1.0), max_depth=max_depth)
    truth = through(lambda o, d: to_plane(o, d, 0)) if max_depth >= 4 else np.zeros((8, 8, 3))
    assert_renders(scene, truth, spp=256)


def test_emitter_keeps_its_radiance_behind_refraction():
    lamp = replace(SCREEN, material=None, radiance=(1.0, 2.0, 3.0))
    scene = make_scene(lamp, PANE, camera=CAMERA, materials=(Diffuse(0), Refraction(2.0)))
    np.testing.assert_array_equal(replicates(scene, 16, SIZE, 1)[0], np.broadcast_to((1.0, 2.0, 3.0), (8, 8, 3)))


# Dielectric -----------------------------------------------------------------------------------------------------------

QUANTUM = 2e-4  # stratified samples choose between two rays so evenly that only whole samples are left of the noise


@pytest.mark.parametrize("ior", [1.1, 1.5, 2.4])
@pytest.mark.parametrize("tilt", [0.0, 2.0, 9.0])
def test_glass_plate_transmits_what_fresnel_says(ior, tilt):
    """(1 − R) / (1 + R) of the radiance behind it: all orders of reflection between its faces together."""
    lamp = replace(SCREEN, material=None, radiance=(1.0, 2.0, 3.0), edge1=(99, 0, 0), edge2=(0, 99, 0))
    wide = {"edge1": (99.0, 0.0, 0.0)}
    plate = [replace(PANE, center=(0, 0, 1.1), **wide), replace(PANE, edge2=(0, -16, 0), **wide)]
    camera = Camera((tilt, 0, 3), (0, 0, 0), (0, 1, 0), 10)
    scene = make_scene(lamp, *plate, camera=camera, materials=(Diffuse(0), Dielectric(ior, 1.0)), max_depth=64)
    truth = pixel_average(
        camera, SIZE, lambda o, d: analytic.slab_transmittance(d[:, 2], ior)[:, None] * np.array((1.0, 2.0, 3.0))
    )
    assert_renders(scene, truth, spp=1024, rounding=QUANTUM)


@pytest.mark.parametrize("material", [Refraction(2.0), Refraction(0.7), Dielectric(1.5, 1.0)], ids=str)
def test_nothing_lossless_is_visible_in_a_furnace(material):
    """Inside a closed box that shines with radiance 1 everywhere, a ball of glass looks like nothing at all."""
    corners = np.array(np.meshgrid(*3 * [(-1.0, 1.0)], indexing="ij")).reshape(3, -1).T
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([t for a, b, c, d in quads for t in ((c, b, a), (d, c, a))], np.int32)
    box = Mesh(name="box", vertices=corners, triangles=faces, radiance=(1.0, 1.0, 1.0))
    ball = Sphere(name="ball", center=(0, 0, 0), radius=0.5, material=1)
    scene = make_scene(box, ball, camera=Camera((0, 0, 0.9)), materials=(Diffuse(0), material), max_depth=64)
    np.testing.assert_allclose(replicates(scene, 256, (16, 16), 1), 1.0, rtol=1e-6)


def test_emitter_inside_glass_is_dimmed_by_the_square_of_the_index():
    """Radiance over n² is what a ray conserves, so glass around a lamp shows T / n² of it head on."""
    lamp = replace(SCREEN, material=None, radiance=(1.0, 2.0, 3.0))
    camera = Camera((0, 0, 3), (0, 0, 0), (0, 1, 0), 1e-2)
    scene = make_scene(lamp, PANE, camera=camera, materials=(Diffuse(0), Dielectric(1.5, 1.0)))
    truth = np.broadcast_to(0.96 / 1.5**2 * np.array((1.0, 2.0, 3.0)), (8, 8, 3))
    assert_renders(scene, truth, spp=1024, rounding=QUANTUM)
