"""The float64 pictures that pyrt's bias is measured with: they are true, and a small bias does not escape them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import pyrt
from bench import bias
from pyrt.scene import PointLight, Rectangle, Scene
from tests.reference.pictures import Pictures
from tests.reference.statistics import Estimate, assert_agrees, gaussian, replicate, z_scores
from tests.reference.tracer import reference_image
from tests.render.everything import everything

SIZE = 16
SEEDS = 12


def scene_of_points_and_rectangles() -> Scene:
    scene = everything()
    shapes = (shape for shape in scene.shapes if shape.radiance is None or isinstance(shape, Rectangle))
    lights = (light for light in scene.lights if isinstance(light, PointLight))
    return replace(scene, shapes=tuple(shapes), lights=tuple(lights))


SCENE = scene_of_points_and_rectangles()


@pytest.fixture(scope="module")
def pictures() -> Pictures:
    return Pictures(SCENE)


@pytest.mark.parametrize("uniform", [False, True])
def test_they_are_what_the_plain_tracer_shows(pictures, uniform):
    """Textures, glass, smooth normals, spheres and all, with either choice of points on lights."""
    found = replicate(np.array([pictures.render((64,), seed, SIZE, uniform)[64] for seed in range(SEEDS)]))
    truth = reference_image(SCENE, (SIZE, SIZE), 3, 2)
    assert_agrees(gaussian(z_scores(found, truth), SEEDS - 1))
    found, truth = (Estimate(x.mean.mean((0, 1)), x.variance.mean((0, 1)) / SIZE**2) for x in (found, truth))
    assert_agrees(z_scores(found, truth))


def test_they_take_the_samples_that_pyrt_takes(pictures):
    """Else the noise of lights would be in the differences, a thousand times as large."""
    truth = pictures.render((64,), 5, SIZE)[64]
    error = np.abs(pyrt.Renderer(SCENE, lines=False).render(64, 5, (SIZE, SIZE)).image - truth) / truth.mean()
    assert np.median(error) < 1e-6
    assert (error < 1e-4).mean() > 0.9


@pytest.mark.parametrize(("change", "is_seen"), [(0.0, False), (3e-5, True)])
def test_a_bias_above_the_limit_is_seen(change, is_seen, monkeypatch):
    monkeypatch.setattr(bias, "SIZE", SIZE)
    scene = pyrt.load_scene("example:cornell")
    lamp = scene.lights[0]
    brighter = replace(scene, lights=(replace(lamp, flux=tuple(flux * (1 + change) for flux in lamp.flux)),))
    found = bias.compare(brighter, *bias.references(scene, (16, 64)), (16, 64))
    assert (found.rounding_floor > bias.LIMIT) == is_seen
    assert (found.median > 1e-6) == is_seen
