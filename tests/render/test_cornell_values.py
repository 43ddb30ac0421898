"""The Cornell box: the figures' own numbers, closed forms where nothing hides the light, the reference elsewhere."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import pyrt
from pyrt.scene import ConstantTexture, Rectangle, Refraction, Scene
from tests.reference import analytic
from tests.reference.analytic import Array
from tests.reference.rendering import assert_renders, replicates
from tests.reference.statistics import Estimate, z_scores
from tests.reference.tracer import camera_rays, pixel_average, reference_image

SCENES = Path(__file__).parents[2] / "scenes"
POINT_SCENES = ["cornell", "cornell_refraction", "cornell_textured"]
AREA_SCENES = ["cornell_area_light", "cornell_two_lights"]


@cache
def load(name: str) -> Scene:
    return pyrt.load_scene(SCENES / f"{name}.json")


# The numbers that the figures are known by ----------------------------------------------------------------------------


@pytest.fixture(scope="module")
def figure_2() -> Array:
    return pyrt.render(load("cornell"), spp=32).image.astype(float)


def test_mean_of_the_cornell_box(figure_2):
    assert figure_2.shape == (512, 512, 3)
    np.testing.assert_allclose(figure_2.mean((0, 1)), (0.11797, 0.07749, 0.02878), rtol=0.005)


@pytest.mark.parametrize(
    ("column", "row_from_below", "red"),
    [(256, 400, 0.1329), (256, 490, 1.2275), (30, 300, 0.2097), (256, 10, 0.1339)],
    ids=["back wall", "ceiling", "left wall", "floor"],
)
def test_pixels_of_the_cornell_box(figure_2, column, row_from_below, red):
    row = 511 - row_from_below
    patch = figure_2[row - 1 : row + 2, column - 1 : column + 2, 0]
    assert patch.mean() == pytest.approx(red, rel=0.01)


# Closed forms ---------------------------------------------------------------------------------------------------------

# Axis, place and inward normal of the first five objects: left, right, floor, back, ceiling. The boxes follow.
AXIS, PLACE = np.array([0, 0, 1, 2, 1]), np.array([-1.0, 1.0, 0.0, -1.0, 2.0])
NORMAL = np.eye(3)[AXIS] * np.array([1, -1, 1, 1, -1])[:, None]
BOXES = slice(5, 7)
DISC_RADIUS, DISC_ETA = 0.5, 2.0
DISC_INSIDE = DISC_RADIUS * np.cos(np.pi / 32)  # of the 32-gon's inscribed circle


@dataclass(frozen=True)
class View:
    """Where rays (n,) cross the plane z = 1, and which wall of the room they then meet where, boxes aside."""

    crossing: Array
    radius: Array  # from the centre of the disc; infinite where there is none
    wall: NDArray[np.intp]
    point: Array


def look(scene: Scene, origins: Array, directions: Array) -> View:
    crossing = origins + directions * ((1 - origins[:, 2:]) / directions[:, 2:])
    has_disc = any(isinstance(material, Refraction) for material in scene.materials)
    radius = np.linalg.norm(crossing - (0, 1, 1), axis=1) if has_disc else np.full(len(crossing), np.inf)
    bent = analytic.refract(directions, np.broadcast_to((0.0, 0.0, 1.0), directions.shape), DISC_ETA)
    onward = np.where((radius < DISC_RADIUS)[:, None], bent, directions)
    distance, speed = PLACE - crossing[:, AXIS], onward[:, AXIS]
    t = np.divide(distance, speed, out=np.full_like(distance, np.inf), where=distance * speed > 0)
    return View(crossing, radius, t.argmin(1), crossing + t.min(1, keepdims=True) * onward)


def albedos(scene: Scene) -> Array:
    """(5, 3) reflectance of the walls; NaN where it varies."""
    textures = [scene.textures[scene.materials[shape.material].texture] for shape in scene.shapes[:5]]
    return np.array([t.color if isinstance(t, ConstantTexture) else (np.nan,) * 3 for t in textures])


def lamps(scene: Scene) -> list[Array]:
    square = np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)])
    shapes = [shape for shape in scene.shapes if isinstance(shape, Rectangle)]
    return [np.array(shape.center) + square @ np.array([shape.edge1, shape.edge2]) for shape in shapes]


def closed_form(scene: Scene, size: tuple[int, int]) -> Array:
    """(height, width, 3) picture of the walls as if there were no boxes and no shadows."""

    def radiance(origins: Array, directions: Array) -> Array:
        view = look(scene, origins, directions)
        normals, total = NORMAL[view.wall], np.zeros((len(origins), 3))
        for light in scene.lights:
            total += analytic.point_irradiance(view.point, normals, light.position, light.flux)
        for lamp in lamps(scene):
            emitted = scene.shapes[-1].radiance
            total += analytic.polygon_irradiance(view.point, normals, lamp)[:, None] * np.array(emitted)
        return albedos(scene)[view.wall] / np.pi * total

    return pixel_average(scene.camera, size, radiance, 6)


def clear_pixels(scene: Scene, size: tuple[int, int]) -> NDArray[np.bool_]:
    """(height, width) whether a pixel shows one plain wall, and provably nothing hides it from eye or lights."""
    film = np.stack(np.meshgrid(np.arange(size[0]), np.arange(size[1])), 2).reshape(-1, 1, 2)
    corners = film + np.array([(0, 0), (1, 0), (1, 1), (0, 1)])
    view = look(scene, *camera_rays(scene.camera, size, corners.reshape(-1, 2).astype(float)))
    points, crossing = view.point.reshape(-1, 4, 3), view.crossing.reshape(-1, 4, 3)
    wall, radius = view.wall.reshape(-1, 4), view.radius.reshape(-1, 4)
    diagonal = np.linalg.norm(crossing[:, 2] - crossing[:, 0], axis=1)
    clear = (wall == wall[:, :1]).all(1) & np.isfinite(albedos(scene))[wall[:, 0], 0]
    clear &= (radius < DISC_INSIDE).all(1) | (radius.min(1) > DISC_RADIUS + diagonal)
    for occluder in [shape.vertices for shape in scene.shapes[BOXES]] + lamps(scene):
        clear &= analytic.unoccluded(occluder, crossing, points)
        for light in [np.array([light.position]) for light in scene.lights] + lamps(scene):
            if light.shape != occluder.shape:
                clear &= analytic.unoccluded(occluder, np.broadcast_to(light, (len(points), *light.shape)), points)
    return clear.reshape(size[::-1])


SIZE = (40, 40)


@cache
def plain_walls(name: str) -> tuple[Array, NDArray[np.bool_]]:
    """What is known of a scene's picture in closed form, and where."""
    return closed_form(load(name), SIZE), clear_pixels(load(name), SIZE)


@pytest.mark.parametrize(
    ("name", "clear", "bias"),
    [
        ("cornell", 0.5, 1e-5),
        ("cornell_refraction", 0.4, 1e-5),
        ("cornell_textured", 0.1, 1e-5),
        ("cornell_area_light", 0.4, 1e-4),
        ("cornell_two_lights", 0.4, 1e-4),
    ],
)
def test_plain_walls_in_full_light_are_the_closed_form(name, clear, bias):
    truth, where = plain_walls(name)
    assert where.mean() > clear
    assert_renders(load(name), truth, spp=256, bias=bias, where=where)


@pytest.mark.parametrize("name", ["cornell_refraction", "cornell_area_light", "cornell_two_lights"])
def test_closed_forms_are_met_through_the_disc_too(name):
    truth, where = plain_walls(name)
    row, column = np.indices(SIZE) - 19.5
    through = where & (np.hypot(row, column) < 8)
    assert through.sum() > 50
    assert_renders(load(name), truth, spp=256, where=through)


# The reported variance ------------------------------------------------------------------------------------------------


def test_errors_are_within_the_reported_variance():
    """N17: |z| < 4 by `result.variance` alone, in every pixel where the truth is known."""
    truth, where = plain_walls("cornell_area_light")
    result = pyrt.render(load("cornell_area_light"), spp=64, size=SIZE, seed=5)
    estimate = Estimate(result.image[where].astype(float), result.variance[where].astype(float))
    assert np.abs(z_scores(estimate, truth[where])).max() < 4


@pytest.mark.parametrize("name", ["cornell", "cornell_area_light"])
def test_reported_variance_is_an_upper_estimate(name):
    """It treats stratified samples as independent, so it is too large: here by a factor of 10 to 30."""
    scene, size = load(name), (24, 24)
    between = replicates(scene, 16, size, 32).var(0, ddof=1).mean()
    reported = np.mean([pyrt.render(scene, spp=16, size=size, seed=seed).variance for seed in range(4)])
    assert 0.01 * reported < between < 1.1 * reported


# Whole pictures -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", [*POINT_SCENES, *AREA_SCENES])
def test_whole_picture_agrees_with_the_reference(name):
    scene = load(name)
    assert_renders(scene, reference_image(scene, (20, 20)), spp=256)


@pytest.mark.slow
@pytest.mark.parametrize("name", [*POINT_SCENES, *AREA_SCENES])
def test_whole_picture_agrees_with_a_finer_reference(name):
    scene = load(name)
    assert_renders(scene, reference_image(scene, (32, 32), 8), spp=1024)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mesh_room", "showcase"])
def test_large_scene_agrees_with_the_reference(name):
    scene = load(name)
    assert_renders(scene, reference_image(scene, (8, 8), 3, 2), spp=64)
