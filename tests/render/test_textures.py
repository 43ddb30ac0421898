"""Textured planes under a pinhole, pixel by pixel: place, orientation, wrapping and interpolation of texels."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pyrt.scene import Camera, CheckerboardTexture, ConstantTexture, ImageTexture, Mesh, PointLight, Rectangle, Texture
from tests.reference import analytic
from tests.reference.analytic import Array
from tests.reference.rendering import assert_renders, make_scene, replicates
from tests.reference.tracer import pixel_average, texture_color

# The film shows exactly this square; s grows to the right and t upwards, because v does.
SQUARE = Rectangle(name="square", center=(0, 0, 0), edge1=(2, 0, 0), edge2=(0, 2, 0), material=0)
CAMERA = Camera((0, 0, 2), (0, 0, 0), (0, 1, 0), math.degrees(2 * math.atan(0.5)))
LIGHT = PointLight((0.3, 0.2, 1.5), (9.0, 9.0, 9.0))
SIZE, FINE = (24, 24), (48, 48)


def image(width: int, height: int) -> ImageTexture:
    pixels = np.random.default_rng(width * 100 + height).random((height, width, 3))
    return ImageTexture(pixels.astype(np.float32))


def picture(texture: Texture, uv_of_st: Array, size: tuple[int, int] = SIZE) -> Array:
    """Closed form of the square's picture; uv_of_st (3, 2) maps (x, y, 1) in [0, 1]² to texture coordinates.

    Every kink of the texture must fall on a pixel's edge, where Gauss's quadrature allows for it.
    """

    def radiance(origins: Array, directions: Array) -> Array:
        points = origins + directions * (-origins[:, 2:] / directions[:, 2:])
        place = np.append(points[:, :2] / 2 + 0.5, np.ones((len(points), 1)), 1)
        normals = np.broadcast_to((0.0, 0.0, 1.0), points.shape)
        light = analytic.point_irradiance(points, normals, LIGHT.position, LIGHT.flux)
        return texture_color(texture, place @ uv_of_st) / np.pi * light

    return pixel_average(CAMERA, size, radiance)


IDENTITY = np.array([(1.0, 0.0), (0.0, 1.0), (0.0, 0.0)])
MAPPED = {
    "plain": {},
    "repeated": {"scale": (2.0, 3.0)},
    "mirrored": {"scale": (-1.0, 1.0)},
    "shifted": {"delta": (0.25, 0.125)},
    "shifted below zero": {"scale": (1.0, 2.0), "delta": (-7.25, -1.5)},
}


TEXTURES = {
    "constant": ConstantTexture((0.2, 0.4, 0.6)),
    "checkerboard": CheckerboardTexture((1.0, 0.5, 0.2), (0.1, 0.2, 0.9)),
    "4x4": image(4, 4),
    "1x1": image(1, 1),
    "3x2": image(3, 2),
}


@pytest.mark.parametrize("mapping", MAPPED)
@pytest.mark.parametrize("texture", TEXTURES.values(), ids=TEXTURES.keys())
def test_textured_plane_under_a_pinhole(texture, mapping):
    if not isinstance(texture, ConstantTexture):
        texture = replace(texture, **MAPPED[mapping])
    scene = make_scene(SQUARE, camera=CAMERA, lights=(LIGHT,), textures=(texture,))
    assert_renders(scene, picture(texture, IDENTITY, FINE), spp=16, bias=1e-4, rounding=1e-5)


def test_origin_is_the_upper_left_corner_of_the_first_row():
    """s runs along a row and t down the rows; here t grows upwards, so that row 0 is at the bottom."""
    pixels = np.zeros((4, 4, 3), np.float32)
    pixels[0, 0, 0] = pixels[0, 3, 1] = pixels[3, 0, 2] = 1
    scene = make_scene(SQUARE, camera=CAMERA, lights=(LIGHT,), textures=(ImageTexture(pixels),))
    lit = replicates(scene, 16, (4, 4), 1)[0]
    brightest = [np.unravel_index(lit[..., channel].argmax(), (4, 4)) for channel in range(3)]
    assert brightest == [(3, 0), (3, 3), (0, 0)]


UVS = {
    "identity": (IDENTITY, image(2, 4)),
    "turned": (np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0)]), image(2, 4)),
    "sheared across the seam": (np.array([(2.0, 1.0), (0.0, 1.0), (-1.0, -1.0)]), image(2, 1)),
}
CORNERS = np.array([(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)])


@pytest.mark.parametrize("name", UVS)
def test_texture_coordinates_of_a_mesh_are_interpolated(name):
    uv_of_st, texture = UVS[name]
    faces = np.array([(0, 1, 2), (0, 2, 3)], np.int32)
    uvs = np.append(CORNERS[:, :2] / 2 + 0.5, np.ones((4, 1)), 1) @ uv_of_st
    mesh = Mesh(name="quad", material=0, vertices=CORNERS, triangles=faces, uvs=uvs[faces].astype(np.float32))
    scene = make_scene(mesh, camera=CAMERA, lights=(LIGHT,), textures=(texture,))
    assert_renders(scene, picture(texture, uv_of_st, FINE), spp=16, bias=1e-4, rounding=1e-5)


@pytest.mark.parametrize(("face", "name"), [((0, 1, 2), "identity"), ((1, 2, 3), "turned")])
def test_mesh_without_texture_coordinates_gives_each_triangle_the_same_half_square(face, name):
    """Its corners get (0, 0), (1, 0), (1, 1)."""
    texture = image(2, 2)
    mesh = Mesh(name="half", material=0, vertices=CORNERS, triangles=np.array([face], np.int32))
    scene = make_scene(mesh, camera=CAMERA, lights=(LIGHT,), textures=(texture,))
    row, column = np.indices(SIZE)
    inside = row + column > 23 if name == "identity" else column > row
    lit = replicates(scene, 64, SIZE, 1)[0]
    np.testing.assert_allclose(lit[inside], picture(texture, UVS[name][0])[inside], rtol=5e-3)
