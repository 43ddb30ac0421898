"""Pictures of model files and by calibrated cameras: light from infinity, colours at vertices, the place of a point."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyrt
from pyrt.image_io import write_image
from tests.gltf_files import GltfFile

CAMERA = {"type": "perspective", "perspective": {"yfov": 2 * math.atan(0.4), "aspectRatio": 1}}
SQUARE = [[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]


def lit_square(
    tmp_path: Path, intensity: float, texture: dict[str, Any] | None = None, **attributes: Any
) -> np.ndarray:
    """A square that fills the picture, under a directional light at 45 degrees: white, or a texture of square.png."""
    light = {"type": "directional", "intensity": intensity}
    angle = math.pi / 8
    file = GltfFile(
        cameras=[CAMERA],
        extensions={"KHR_lights_punctual": {"lights": [light]}},
        nodes=[
            {"mesh": 0},
            {"camera": 0, "translation": [0, 0, 2.5]},
            {"extensions": {"KHR_lights_punctual": {"light": 0}}, "rotation": [math.sin(angle), 0, 0, math.cos(angle)]},
        ],
    )
    if texture is not None:
        file.tree["images"], file.tree["textures"] = [{"uri": "square.png"}], [{"source": 0}]
        pbr = {"baseColorTexture": {"index": 0, "extensions": {"KHR_texture_transform": texture}}, "metallicFactor": 0}
        file.tree["materials"] = [{"pbrMetallicRoughness": pbr}]
        attributes["material"] = 0
    file.mesh(SQUARE, [0, 1, 2, 0, 2, 3], **attributes)
    return pyrt.render(file.save(tmp_path / "square.glb"), spp=4, size=(16, 16)).image


def test_a_directional_light(tmp_path: Path) -> None:
    """L = E·cosθ/π for a white surface, everywhere."""
    image = lit_square(tmp_path, 3.0)
    np.testing.assert_allclose(image, 3 * math.sqrt(0.5) / math.pi, rtol=1e-4)


def test_vertex_colours(tmp_path: Path) -> None:
    """A colour that is linear over the square is so in the picture, across the edge between the triangles too."""
    colors = (np.array(SQUARE, float)[:, [0, 1, 0]] + 1) / 2
    image = lit_square(tmp_path, math.pi * math.sqrt(2), COLOR_0=colors)
    ramp = (np.arange(16) + 0.5) / 16
    expected = np.stack([np.tile(ramp, (16, 1)), np.tile(ramp[::-1, None], (1, 16)), np.tile(ramp, (16, 1))], axis=2)
    # 4 stratified samples leave a fraction of a pixel's ramp of 1/16
    np.testing.assert_allclose(image, expected, atol=0.25 / 16)


def test_a_texture_transform_shows_the_part_that_its_specification_says(tmp_path: Path) -> None:
    """The example of KHR_texture_transform: the lower left quadrant of the image, rotated clockwise by 90 degrees."""
    patches = np.linspace(0.1, 0.9, 48).reshape(4, 4, 3).astype(np.float32)
    write_image(tmp_path / "square.png", patches.repeat(16, axis=0).repeat(16, axis=1))
    transform = {"offset": [0, 1], "rotation": math.pi / 2, "scale": [0.5, 0.5]}
    uvs = [[0, 1], [1, 1], [1, 0], [0, 0]]  # the image upright: its upper left corner is the square's
    image = lit_square(tmp_path, math.pi * math.sqrt(2), transform, TEXCOORD_0=uvs)
    clockwise = np.rot90(patches[2:, :2], -1)
    np.testing.assert_allclose(image[[4, 11]][:, [4, 11]], clockwise, atol=5e-3)  # 8 bits on the sRGB curve
    for other in (np.rot90(patches[2:, :2], 1), np.rot90(patches[:2, 2:], 1), np.rot90(patches[:2, 2:], -1)):
        assert np.abs(clockwise - other).max() > 0.05


@pytest.mark.parametrize("stretch", [1.0, 2.0])
def test_a_calibrated_camera_sees_a_point_where_k_says(stretch: float) -> None:
    fx, fy, cx, cy = 30.0 * stretch, 30.0, 20.0, 40.0
    point = np.array([0.3, -0.4, 2.0])  # in OpenCV's axes
    scene = {
        "film": {"resolution": [64, 48]},
        "camera": {
            "matrix": np.eye(4),
            "convention": "opencv",
            "intrinsics": {"K": [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]},
        },
        "objects": [{"type": "sphere", "center": point, "radius": 0.05, "light": {"radiance": [1, 1, 1]}}],
    }
    weights = pyrt.render(scene, spp=64).image[..., 0]
    rows, columns = np.indices(weights.shape) + 0.5
    found = [(weights * columns).sum() / weights.sum(), (weights * rows).sum() / weights.sum()]
    expected = [fx * point[0] / point[2] + cx, fy * point[1] / point[2] + cy]
    np.testing.assert_allclose(found, expected, atol=0.03)


def test_a_model_gets_a_picture_that_is_neither_black_nor_white(tmp_path: Path) -> None:
    (tmp_path / "model.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    image = pyrt.render(tmp_path / "model.obj", spp=16, size=(32, 32)).image
    assert 0.1 < np.median(image) < 0.6
    assert image.max() < 1.2
    assert image.min() > 0.001
