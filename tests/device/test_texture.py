"""Texture lookup at every kind of texture coordinate, against float64."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pyrt.layout import constants, dtypes
from tests.device.probe import evaluate
from tests.reference.analytic import Array

ODD = np.array([np.nan, np.inf, -np.inf, 1e7 + 0.3, -0.0, 0, -1e-9, 1 - 2.0**-24, 1, -1, 1e30, -1e30], np.float32)
GUARD = 1e30  # texels beside the image
SHAPES = [(1, 1), (1, 2), (3, 5), (64, 32)]


def look_up(texture: NDArray[Any], texels: Array, uv: Array) -> NDArray[np.float32]:
    """(n, 3) colours at uv (n, 2)."""
    code = """
        Scene scene = {0};
        scene.textures = textures;
        scene.texels = texels;
        vstore3(texture_color(&scene, 0, vload2(i, uv)), i, color);
    """
    inputs = {"textures": texture.reshape(1), "texels": texels.astype(np.float32), "uv": uv.astype(np.float32)}
    return evaluate("texture.h", code, len(uv), {"color": (np.float32, 3)}, **inputs)["color"]


def image_texture(pixels: Array, scale: tuple[float, float] = (1, 1), delta: tuple[float, float] = (0, 0)) -> Any:
    """The Texture, and the texels with guards on both sides."""
    texture = np.zeros((), dtypes()["Texture"])
    texture["kind"], texture["texels"] = constants()["TEXTURE_IMAGE"], 1
    texture["height"], texture["width"] = pixels.shape[:2]
    texture["scale_s"], texture["scale_t"] = scale
    texture["delta"] = delta
    return texture, np.concatenate([np.full(3, GUARD), pixels.ravel(), np.full(3, GUARD)])


def checkerboard(scale: tuple[float, float] = (1, 1)) -> NDArray[Any]:
    texture = np.zeros((), dtypes()["Texture"])
    texture["kind"] = constants()["TEXTURE_CHECKERBOARD"]
    texture["color0"], texture["color1"] = 0, 1
    texture["scale_s"], texture["scale_t"] = scale
    return texture


def bilinear(pixels: Array, uv: Array) -> Array:
    """Periodic bilinear interpolation between texel centres, in float64."""
    height, width = pixels.shape[:2]
    x, y = (uv - np.floor(uv)).T * [[width], [height]] - 0.5
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    fx, fy = (x - x0)[:, None], (y - y0)[:, None]
    rows = [pixels[j % height, x0 % width] * (1 - fx) + pixels[j % height, (x0 + 1) % width] * fx for j in (y0, y0 + 1)]
    return rows[0] * (1 - fy) + rows[1] * fy


def random_image(shape: tuple[int, int]) -> Array:
    return np.random.default_rng(0).random((*shape, 3)).astype(np.float32).astype(float)


@pytest.mark.parametrize("shape", SHAPES)
def test_image_is_periodic_and_bilinear(shape):
    """The error is that of the place: an ulp of coordinates up to 3, in texels, whose neighbours differ by up to 1."""
    uv = np.random.default_rng(1).uniform(-3, 3, (5000, 2)).astype(np.float32).astype(float)
    image = random_image(shape)
    assert np.abs(look_up(*image_texture(image), uv) - bilinear(image, uv)).max() < 4e-7 * max(shape)


@pytest.mark.parametrize("shape", SHAPES)
def test_texel_centres_are_exact(shape):
    """Where the coordinate of a centre is a float; elsewhere the next texel may weigh a rounding error."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    image = random_image(shape)
    for period in (0, -1, 5):
        uv = np.stack([(x + 0.5) / shape[1], (y + 0.5) / shape[0]], -1).reshape(-1, 2) + period
        error = np.abs(look_up(*image_texture(image), uv) - image.reshape(-1, 3))
        assert error.max() <= (0 if not any(n & (n - 1) for n in shape) else 4e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_odd_coordinates_find_a_texel(shape):
    """NaN, infinite and huge coordinates stay within the image; numbers are wrapped as float64 does it."""
    uv = np.stack(np.meshgrid(ODD, ODD), -1).reshape(-1, 2).astype(float)
    image = random_image(shape)
    color = look_up(*image_texture(image), uv)
    assert ((color >= image.min((0, 1)) - 1e-6) & (color <= image.max((0, 1)) + 1e-6)).all()
    finite = np.isfinite(uv).all(1)
    assert np.abs(color[finite] - bilinear(image, uv[finite])).max() < 4e-7 * max(shape)


def test_a_constant_image_is_constant():
    uv = np.random.default_rng(1).uniform(-1e4, 1e4, (5000, 2))
    color = look_up(*image_texture(np.full((3, 5, 3), np.float32(0.7))), uv)
    assert (color == np.float32(0.7)).all()


def test_scale_and_delta():
    uv = np.random.default_rng(1).uniform(-1, 1, (1000, 2)).astype(np.float32).astype(float)
    image, scale, delta = random_image((8, 4)), (2.5, -1.25), (0.375, 10.0)
    st = uv * scale + delta
    assert np.abs(look_up(*image_texture(image, scale, delta), uv) - bilinear(image, st)).max() < 1e-5


@pytest.mark.parametrize("scale", [(1, 1), (-3, 0.25)])
def test_checkerboard_is_the_parity_of_the_cell(scale):
    """Exact at every float: no seam at negative coordinates, none at huge ones."""
    edges = np.arange(-8, 9) / 4
    steps = [np.nextafter(np.float32(e), np.float32(side)) for e in edges for side in (-9, e, 9)]
    u = np.concatenate([steps, ODD[np.isfinite(ODD)], np.random.default_rng(0).uniform(-50, 50, 40)]).astype(np.float32)
    uv = np.stack(np.meshgrid(u, u), -1).reshape(-1, 2).astype(float)
    uv = uv[np.abs(uv * scale).max(1) < 1.7e38]
    parity = np.mod(np.floor(2 * np.float32(uv * scale).astype(float)), 2).sum(1) % 2
    assert (look_up(checkerboard(scale), np.zeros(3), uv)[:, 0] == parity).all()


def test_checkerboard_at_numbers_that_are_none():
    uv = np.array([(a, b) for a in (np.nan, np.inf, -np.inf, 0.25) for b in (np.nan, np.inf)])
    assert (look_up(checkerboard(), np.zeros(3), uv) == 0).all()
