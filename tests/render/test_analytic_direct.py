"""Direct light against closed forms in every pixel: point, rectangle, mesh and sphere lights, and what hides them."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from pyrt.scene import Camera, ConstantTexture, Diffuse, Mesh, PointLight, Rectangle, Scene, Sphere, SpotLight
from tests.reference import analytic
from tests.reference.analytic import Array, unit
from tests.reference.rendering import ALBEDO, assert_renders, make_scene, replicates
from tests.reference.statistics import replicate
from tests.reference.tracer import pixel_average

SIZE = (8, 8)
UP = np.array([0.0, 0.0, 1.0])
RADIANCE = (1.0, 2.0, 3.0)
FLOOR = Rectangle(name="floor", center=(0, 0, 0), edge1=(40, 0, 0), edge2=(0, 40, 0), material=0)
CAMERA = Camera((0, -0.5, 0.7), (0, 0, 0), (0, 0, 1), 60)
BULB = PointLight((0.3, 0.4, 1.5), (5.0, 6.0, 7.0))
LAMP = Rectangle(name="lamp", center=(0.2, 0.1, 2), edge1=(1, 0, 0), edge2=(0, -1, 0), radiance=RADIANCE)


def corners(rectangle: Rectangle) -> Array:
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    return np.array(rectangle.center) + square @ np.array([rectangle.edge1, rectangle.edge2])


def floor_image(irradiance: Callable[[Array, Array], Array], camera: Camera = CAMERA, order: int = 4) -> Array:
    """Picture of the floor z = 0 under a closed form of (points, normals); one value is for radiance RADIANCE."""

    def radiance(origins: Array, directions: Array) -> Array:
        points = origins + directions * (-origins[:, 2:] / directions[:, 2:])
        value = irradiance(points, np.broadcast_to(UP, points.shape))
        return np.array(ALBEDO) / np.pi * (value if value.ndim == 2 else value[:, None] * RADIANCE)

    return pixel_average(camera, SIZE, radiance, order)


# Point lights ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("height", [1e-3, 1.0, 1e3])
def test_point_light_on_a_plane(height):
    """From a millimetre to a kilometre, and no closer to the light than the picture is wide."""
    light = PointLight((0.3 * height, 0.4 * height, 1.5 * height), BULB.flux)
    camera = Camera((0, -0.5 * height, 0.7 * height), (0, 0, 0), (0, 0, 1), 60)
    floor = replace(FLOOR, edge1=(40 * height, 0, 0), edge2=(0, 40 * height, 0))
    truth = floor_image(lambda p, n: analytic.point_irradiance(p, n, light.position, light.flux), camera)
    assert_renders(make_scene(floor, camera=camera, lights=(light,)), truth, spp=1024, bias=2e-6)


def test_spot_light_on_a_plane():
    """Its rim lies in the picture, and all that it lights is nearer to the axis than 25 degrees."""
    axis = unit(np.array([-0.2, -0.4, -1.5]))
    light = SpotLight(BULB.position, tuple(axis), (5.0, 6.0, 7.0), inner=5, outer=25)
    truth = floor_image(lambda p, n: analytic.spot_irradiance(p, n, light), order=64)
    assert (truth == 0).any()
    assert_renders(make_scene(FLOOR, camera=CAMERA, lights=(light,)), truth, spp=1024)


def test_point_light_far_from_the_origin():
    """A room of half-size 1e-2 at 1e5 keeps what float64 coordinates say of it."""
    place = np.array([1e5, -2e5, 3e5])
    truth = floor_image(lambda p, n: analytic.point_irradiance(p, n, np.array(BULB.position), BULB.flux))
    scene = make_scene(
        replace(FLOOR, center=tuple(place)),
        camera=replace(CAMERA, position=tuple(CAMERA.position + place), look_at=tuple(CAMERA.look_at + place)),
        lights=(replace(BULB, position=tuple(BULB.position + place)),),
    )
    assert_renders(scene, truth, spp=1024, bias=2e-6)


def test_lights_add_up():
    """Two point lights, a rectangle, a mesh and a sphere light one floor together."""
    other = PointLight((-1, 0.5, 0.8), (1.0, 0.0, 3.0))
    lamp = replace(LAMP, center=(3, 0, 1.5))
    ball = Sphere(name="ball", center=(-1.5, 1, 2), radius=0.3, radiance=RADIANCE)

    def irradiance(p: Array, n: Array) -> Array:
        points = sum(analytic.point_irradiance(p, n, x.position, x.flux) for x in (BULB, other))
        area = analytic.polygon_irradiance(p, n, corners(lamp)) + folded_irradiance(p, n)
        return points + (area + analytic.sphere_irradiance(p, n, ball.center, ball.radius))[:, None] * RADIANCE

    scene = make_scene(FLOOR, lamp, ball, FOLDED, camera=CAMERA, lights=(BULB, other))
    assert_renders(scene, floor_image(irradiance), spp=1024, bias=1e-3)


# Area lights ----------------------------------------------------------------------------------------------------------


def lamp_of(solid_angle: float) -> Rectangle:
    edge = 2 * math.sqrt(solid_angle)
    return replace(LAMP, center=(0, 0, 2), edge1=(edge, 0, 0), edge2=(0, -edge, 0))


LAMPS = {
    "overhead": LAMP,
    "wide": replace(LAMP, center=(0, 0, 1.2), edge1=(9, 0, 0), edge2=(0, -9, 0)),
    "tilted": replace(LAMP, center=(1.5, 0, 1.5), edge1=(1, 0, -1), edge2=(0, -1, 0)),
    "through the horizon": replace(LAMP, center=(2, 0, 0), edge1=(0, 0, 3), edge2=(0, 2, 0)),
    "grazing": replace(LAMP, center=(19, 0, 0.3), edge1=(0, 0, 0.5), edge2=(0, 8, 0)),
    "needle": replace(LAMP, edge1=(6, 0, 0), edge2=(0, -1e-3, 0)),
    **{f"{omega:g} sr": lamp_of(omega) for omega in (1.0, 1e-3, 1e-6, 1e-9)},
}


# Bias that 2^20 samples can resolve, where it is not 1e-5.
PRECISION = {"through the horizon": 4e-4, "needle": 1e-4, "tilted": 5e-5, "1 sr": 3e-5}


@pytest.mark.parametrize("name", LAMPS)
def test_rectangle_light_is_lamberts_formula(name):
    truth = floor_image(lambda p, n: analytic.polygon_irradiance(p, n, corners(LAMPS[name])), order=6)
    assert_renders(make_scene(FLOOR, LAMPS[name], camera=CAMERA), truth, spp=1024, bias=PRECISION.get(name, 1e-5))


@pytest.mark.slow
@pytest.mark.parametrize("name", LAMPS)
def test_rectangle_light_has_no_bias_that_64_times_the_samples_find(name):
    truth = floor_image(lambda p, n: analytic.polygon_irradiance(p, n, corners(LAMPS[name])), order=10)
    bias = PRECISION.get(name, 1e-5) / 5
    assert_renders(make_scene(FLOOR, LAMPS[name], camera=CAMERA), truth, spp=1 << 16, bias=bias, rounding=5e-6)


FOLDED = Mesh(  # three triangles of very different size that bulge downwards, so that none hides another
    name="folded",
    radiance=RADIANCE,
    vertices=np.array([(-1, 0, 1.9), (0.2, -0.3, 1.7), (0.1, 0.8, 1.8), (1.5, 0, 2.0), (0.3, 0.6, 1.8)]),
    triangles=np.array([(1, 0, 2), (1, 2, 4), (1, 4, 3)], np.int32),
)


def folded_irradiance(points: Array, normals: Array) -> Array:
    return sum(analytic.polygon_irradiance(points, normals, part) for part in FOLDED.vertices[FOLDED.triangles])


def test_mesh_light_is_the_sum_of_its_triangles():
    assert_renders(make_scene(FLOOR, FOLDED, camera=CAMERA), floor_image(folded_irradiance, order=6), 1024, bias=5e-4)


@pytest.mark.parametrize(("center", "radius"), [((0, 0, 2), 1.0), ((1, 1, 1.5), 1e-3), ((-3, 2, 1), 0.9)])
def test_sphere_light_is_a_cosine_weighted_cone(center, radius):
    ball = Sphere(name="ball", center=center, radius=radius, radiance=RADIANCE)
    truth = floor_image(lambda p, n: analytic.sphere_irradiance(p, n, center, radius), order=6)
    assert_renders(make_scene(FLOOR, ball, camera=CAMERA), truth, spp=1024, bias=5e-5)


@pytest.mark.parametrize("light", ["point", "sphere"])
@pytest.mark.parametrize("place", [0.0, 1e4])
def test_spherical_room_with_its_light_at_the_centre_is_evenly_lit(light, place):
    """Every point of the wall is as far from the centre, and faces it."""
    center = (place, -place, place)
    room = Sphere(name="room", center=center, radius=2, material=0)
    ball = Sphere(name="ball", center=center, radius=0.3, radiance=RADIANCE)
    bulb = PointLight(center, BULB.flux)
    camera = Camera((place + 1, -place, place), (place + 2, 0.5 - place, place), (0, 1, 0), 50)
    scene = make_scene(*([room, ball] if light == "sphere" else [room]), camera=camera)
    irradiance = np.pi * np.array(RADIANCE) * (0.3 / 2) ** 2
    if light == "point":
        scene, irradiance = replace(scene, lights=(bulb,)), np.array(BULB.flux) / (16 * np.pi)
    truth = np.broadcast_to(np.array(ALBEDO) / np.pi * irradiance, (8, 8, 3))
    assert_renders(scene, truth, spp=256, bias=1e-5)


# Form factors ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("light", "expected"),
    [
        (replace(LAMP, center=(0, 0, 1)), analytic.FORM_FACTOR_PARALLEL),
        (replace(LAMP, center=(0.5, 0, 0.5), edge1=(0, 0, 1), edge2=(0, 1, 0)), analytic.FORM_FACTOR_PERPENDICULAR),
    ],
    ids=["parallel", "perpendicular"],
)
def test_form_factor_of_unit_squares(light, expected):
    """The film shows exactly the receiving square, so the picture's mean is the form factor."""
    receiver = replace(FLOOR, edge1=(1, 0, 0), edge2=(0, 1, 0))
    camera = Camera((0, 0, 0.5), (0, 0, 0), (0, 1, 0), 90)
    white = (ConstantTexture((1.0, 1.0, 1.0)),)
    light = replace(light, radiance=(1.0, 1.0, 1.0))
    images = replicates(make_scene(receiver, light, camera=camera, textures=white), 64, (64, 64))
    mean = replicate(images.mean((1, 2, 3)))
    assert abs(mean.mean - expected) < 3 * math.sqrt(mean.variance) < 1e-4


# Penumbrae ------------------------------------------------------------------------------------------------------------

HALF_PLANE = np.array([[(0, -50, 1.0), (50, -50, 1), (0, 50, 1)], [(50, -50, 1), (50, 50, 1), (0, 50, 1.0)]])
TRIANGLE = np.array([[(-0.3, -0.2, 1.2), (0.4, 0.1, 1.0), (0.0, 0.5, 0.9)]])


UNDER = replace(CAMERA, fov=12)  # pixels much smaller than the penumbra


def occluded_scene(occluders: Array) -> tuple[Scene, Array]:
    mesh = Mesh(name="plate", vertices=occluders.reshape(-1, 3), triangles=np.arange(3 * len(occluders)).reshape(-1, 3))
    truth = floor_image(lambda p, n: analytic.visible_irradiance(p, n, corners(LAMP), occluders), UNDER, 8)
    return make_scene(FLOOR, LAMP, mesh, camera=UNDER), truth


@pytest.mark.parametrize("occluders", [HALF_PLANE, TRIANGLE], ids=["half-plane", "triangle"])
def test_penumbra_is_the_part_of_the_light_that_is_seen(occluders):
    scene, truth = occluded_scene(occluders)
    assert_renders(scene, truth, spp=1024, rounding=1e-4)


def test_penumbra_converges_faster_than_randomly():
    scene, truth = occluded_scene(TRIANGLE)
    spp = np.array([4, 16, 64])
    error = [math.sqrt(np.mean((replicates(scene, int(n), SIZE, 4) - truth) ** 2)) for n in spp]
    assert np.polyfit(np.log(spp), np.log(error), 1)[0] <= -1


@pytest.mark.parametrize("gap", [1e-1, 1e-3, 1e-5])
def test_umbra_is_black_however_close_the_occluder_is_to_the_light(gap):
    """N14: an opaque plate just under the lamp leaves nothing."""
    plate = replace(FLOOR, name="plate", center=(0, 0, 2 - 2 * gap))
    assert not replicates(make_scene(FLOOR, LAMP, plate, camera=CAMERA), 64, SIZE, 1).any()


# Sides ----------------------------------------------------------------------------------------------------------------


def seen(*shapes, camera: Camera, lights=(), twosided=True) -> Array:
    """(3,) what the middle of the picture shows."""
    scene = make_scene(*shapes, camera=camera, lights=lights, materials=(Diffuse(0, twosided),))
    return replicates(scene, 1, (1, 1), 1)[0, 0, 0]


ABOVE, BELOW = Camera((0, 0, 5), (0, 0, 0), (0, 1, 0), 1e-3), Camera((0, 0, -5), (0, 0, 0), (0, 1, 0), 1e-3)


@pytest.mark.parametrize("material", [None, 0])
def test_emitter_shows_its_radiance_in_front_and_is_black_behind(material):
    patch = replace(FLOOR, radiance=RADIANCE, material=material)
    np.testing.assert_array_equal(seen(patch, camera=ABOVE), RADIANCE)
    np.testing.assert_array_equal(seen(patch, camera=BELOW), 0)


def test_emitting_sphere_shines_outwards_only():
    ball = Sphere(name="ball", center=(0, 0, 0), radius=1, radiance=RADIANCE)
    np.testing.assert_array_equal(seen(ball, camera=ABOVE), RADIANCE)
    np.testing.assert_array_equal(seen(ball, camera=Camera((0, 0, 0.5))), 0)


def test_area_light_lights_nothing_behind_it():
    lamp = replace(LAMP, center=(0, 0, 1), edge2=(0, 1, 0))
    assert not seen(FLOOR, lamp, camera=replace(ABOVE, position=(0.8, 0, 5), look_at=(0.8, 0, 0))).any()


def test_black_body_reflects_nothing():
    assert not seen(replace(FLOOR, material=None), camera=ABOVE, lights=(BULB,)).any()


@pytest.mark.parametrize("twosided", [True, False])
@pytest.mark.parametrize("side", [1, -1])
def test_diffuse_surface_is_lit_on_the_side_that_is_seen(twosided, side):
    light = PointLight((0, 0, 2.0 * side), BULB.flux)
    camera = ABOVE if side > 0 else BELOW
    expected = np.array(ALBEDO) / np.pi * np.array(BULB.flux) / (16 * np.pi)
    lit = seen(FLOOR, camera=camera, lights=(light,), twosided=twosided)
    np.testing.assert_allclose(lit, expected if twosided or side > 0 else 0, rtol=1e-5)
    assert not seen(FLOOR, camera=BELOW if side > 0 else ABOVE, lights=(light,)).any()
