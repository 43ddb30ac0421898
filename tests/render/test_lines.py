"""Rectangle lights by whole lines: the same light as by points, with less noise."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import pyrt
from bench.scenes import without_disc
from pyrt.scene import Camera, Rectangle, Scene
from tests.controls import kernels
from tests.reference.statistics import assert_agrees, gaussian, replicate, z_scores
from tests.render.everything import everything

Array = NDArray[np.float64]

SIZE, SEEDS = (24, 18), 16


def replicates(scene: Scene, spp: int, size: tuple[int, int] = SIZE, seeds: int = SEEDS, **options: Any) -> Array:
    """(seeds, height, width) independent pictures, as a sum of channels."""
    renderer = pyrt.Renderer(scene, **options)
    return np.array([renderer.render(spp, seed, size).image.sum(2, dtype=np.float64) for seed in range(seeds)])


def scores(scene: Scene, spp: int = 256) -> Array:
    """How far pictures by lines are from pictures by points, in standard deviations of both."""
    found, truth = replicate(replicates(scene, spp)), replicate(replicates(scene, spp, lines=False))
    return gaussian(z_scores(found, truth), SEEDS - 1)


def rooms() -> dict[str, Scene]:
    """Lamps that are close, slanted, cut by horizons, not at right angles, partly behind things, or beside others."""
    room = pyrt.load_scene("example:cornell_area_light")
    lamp = next(shape for shape in room.shapes if shape.radiance is not None)
    assert isinstance(lamp, Rectangle)
    rest = tuple(shape for shape in room.shapes if shape is not lamp)

    def lit_by(**fields: Any) -> Scene:
        return replace(room, shapes=(*rest, replace(lamp, **fields)))

    return {
        "as shipped": room,
        "two": pyrt.load_scene("example:cornell_two_lights"),
        "everything": everything(),
        "on the floor": lit_by(center=(0.1, 0.02, 0.3), edge1=(1.6, 0, 0), edge2=(0, 0, -0.5)),
        "beside the wall": lit_by(center=(-0.97, 1.0, 0), edge1=(0, 1.5, 0.3), edge2=(0, -0.2, 1.4)),
        "in a slant through the boxes": lit_by(center=(0, 0.6, 0), edge1=(0.9, 0.9, 0), edge2=(0.4, 0.1, 0.5)),
        "a thin one": lit_by(center=(0, 1.9, 0), edge1=(1.9, 0, 0), edge2=(0, 0, 1e-3)),
        "a small one": lit_by(center=(0, 1.9, 0), edge1=(1e-3, 0, 0), edge2=(0, 0, 1e-3)),
    }


ROOMS = rooms()
USUAL = ("as shipped", "everything", "beside the wall")


def marked(name: str) -> Any:
    return pytest.param(name, marks=() if name in USUAL else pytest.mark.slow)


@pytest.mark.parametrize("name", [marked(name) for name in ROOMS])
def test_they_give_the_light_that_points_give(name):
    """Next to a lamp few points count for much: from fewer than 1024 no deviation could be told."""
    assert_agrees(scores(ROOMS[name], 1024 if name == "on the floor" else 256))


@pytest.mark.parametrize("control", ["lines of equal weight", "lamps' lines too long"])
def test_the_comparison_notices_wrong_light(control):
    with kernels(control):
        found = scores(ROOMS["as shipped"])
    with pytest.raises(AssertionError):
        assert_agrees(found)


def test_the_variance_is_a_third_at_most():
    """Of nine tenths of the pixels: the others show edges, of the lamp above all."""
    room = without_disc("cornell_area_light")
    pictures = (replicates(room, 16, (128, 128), 6, lines=lines) for lines in (True, False))
    by_lines, by_points = (np.sort(picture.var(0).ravel())[: int(0.9 * 128**2)].sum() for picture in pictures)
    assert by_lines < by_points / 3


def test_they_do_not_depend_on_what_else_is_rendered():
    """A line is chosen where the beam knows the triangles; so all pixels must see the beam of the whole picture."""
    renderer = pyrt.Renderer(ROOMS["as shipped"])
    whole = renderer.render(3, 1, (37, 29))
    part = renderer.render(3, 1, (37, 29), crop=(5, 6, 30, 23))
    np.testing.assert_array_equal(part.image, whole.image[6:23, 5:30])


def test_umbra_stays_black_behind_many_small_triangles():
    """Neighbours' shadows meet without a gap on every line."""
    floor = Rectangle(name="floor", center=(0, 0, 0), edge1=(2, 0, 0), edge2=(0, 2, 0), material=0)
    lamp = Rectangle(name="lamp", center=(0.013, 0.007, 2), edge1=(0, 0.5, 0), edge2=(0.5, 0, 0), radiance=(1, 1, 1))
    xs = np.linspace(-1.013, 1.007, 4)
    grid = np.array([(x, y, 0.9 + 0.01 * np.sin(9 * x + y)) for y in xs for x in xs])
    quads = [4 * j + i for j in range(3) for i in range(3)]
    faces = np.array([face for q in quads for face in ((q, q + 1, q + 5), (q, q + 5, q + 4))])
    plate = pyrt.scene.Mesh(name="plate", vertices=grid, triangles=faces, material=0)
    base = ROOMS["as shipped"]
    camera = Camera((0, 0, 0.5), (0, 0, 0), (0, 1, 0), 60)
    scene = replace(base, shapes=(floor, lamp, plate), lights=(), camera=camera)
    result = pyrt.Renderer(scene).render(64, 0, SIZE)
    assert result.stats["rays"]["shadow"] > 0
    assert not result.image.any()
    with kernels("shadows that do not meet"):
        assert pyrt.Renderer(scene).render(64, 0, SIZE).image.any()
