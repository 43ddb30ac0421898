"""Scaling a scene by a power of two, or moving it, changes no bit of the picture (N2)."""

from __future__ import annotations

import numpy as np
import pytest

import pyrt
from pyrt.procedural import icosphere
from pyrt.scene import Camera, Mesh, PointLight, Rectangle, Scene, Sphere
from tests.reference.analytic import Array
from tests.reference.rendering import make_scene


def scene_at(scale: float, move: float) -> Scene:
    """A floor, a mesh, a ball, a lamp and a point light, with coordinates that float64 holds exactly after the move."""

    def place(*point: float) -> tuple[float, ...]:
        return tuple(scale * (x + move) for x in point)

    vertices, triangles = icosphere(2)
    vertices = scale * (np.round(vertices * 2**12) / 2**13 + move)
    return make_scene(
        Rectangle(name="floor", center=place(0, -1, 0), edge1=(0, 0, 6 * scale), edge2=(6 * scale, 0, 0), material=0),
        Mesh(name="mesh", vertices=vertices, triangles=triangles, material=0),
        Sphere(name="ball", center=place(1, 0, 0.5), radius=0.375 * scale, material=0),
        Rectangle(
            name="lamp", center=place(0, 2, 0), edge1=(scale, 0, 0), edge2=(0, 0, scale), radiance=(4.0, 4.0, 4.0)
        ),
        camera=Camera(position=place(0.5, 1, 4), look_at=place(0, 0, 0)),
        lights=(PointLight(place(1, 1.5, 1), (20 * scale**2,) * 3),),
    )


def picture(scale: float, move: float) -> Array:
    return pyrt.Renderer(scene_at(scale, move)).render(spp=8, size=(32, 32)).image


@pytest.fixture(scope="module")
def here() -> Array:
    image = picture(1.0, 0.0)
    assert image.mean() > 0.01
    return image


@pytest.mark.parametrize("exponent", [-60, -20, -1, 3, 30, 60])
def test_scale(here, exponent):
    assert np.array_equal(picture(2.0**exponent, 0.0), here)


@pytest.mark.parametrize("move", [1.0, -3.5, 2.0**-6, 1e5, 2.0**20, 2.0**30])
def test_place(here, move):
    assert np.array_equal(picture(1.0, move), here)


def test_another_scale_is_another_picture(here):
    assert not np.array_equal(picture(1.5, 0.0), here)
