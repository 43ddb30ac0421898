"""Cameras by matrix and by calibration: known points land on known pixels, and contradictions are named."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pyrt.camera import film_plane, world_to_ndc
from pyrt.errors import SceneError
from pyrt.scene import Scene
from pyrt.scene_io import load_scene

SPHERE = {"type": "sphere", "center": [0, 0, 0], "radius": 1, "light": {"radiance": [1, 1, 1]}}
K = [[800.0, 0.0, 310.0], [0.0, 750.0, 250.0], [0.0, 0.0, 1.0]]


def load(camera: dict[str, Any], size: tuple[int, int] = (640, 480)) -> Scene:
    return load_scene({"film": {"resolution": size}, "camera": camera, "objects": [SPHERE]})


def projected(scene: Scene, points: Any) -> np.ndarray:
    """Film positions in pixels, from the upper-left corner."""
    size = scene.film.width, scene.film.height
    plane = film_plane(scene.camera, *size)
    homogeneous = np.c_[np.asarray(points, float), np.ones(len(points))] @ world_to_ndc(plane, *size)
    return homogeneous[:, :2] / homogeneous[:, 3:] * size


def rotation(seed: int) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    return q * np.sign(np.linalg.det(q))


def pose(axes: Any, position: Any) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes, position
    return matrix


@pytest.mark.parametrize(
    ("convention", "right", "up", "ahead"),
    [
        ("opengl", [1, 0, 0], [0, 1, 0], [0, 0, -1]),
        ("opencv", [1, 0, 0], [0, -1, 0], [0, 0, 1]),
        # a camera of Blender's at rest looks down: its world's z is up
        ("blender", [1, 0, 0], [0, 0, -1], [0, -1, 0]),
    ],
)
def test_axes_of_the_identity(convention: str, right: Any, up: Any, ahead: Any) -> None:
    scene = load({"matrix": np.eye(4), "convention": convention, "fov": 90})
    points = np.array(ahead) + np.array([np.zeros(3), 0.5 * np.array(right), 0.5 * np.array(up)])
    # at fov 90, half the film's height is one distance
    np.testing.assert_allclose(projected(scene, points), [[320, 240], [440, 240], [320, 120]], atol=1e-9)


def test_blenders_world_is_turned() -> None:
    position = load({"matrix": pose(np.eye(3), [1, 2, 3]), "convention": "blender"}).camera.position
    assert position == (1, 3, -2)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("far", [0.0, 1e6])
def test_a_matrix_and_k_project_as_opencv_does(seed: int, far: float) -> None:
    random = np.random.default_rng(seed)
    axes, position = rotation(seed), random.standard_normal(3) + far
    local = np.c_[random.uniform(-1, 1, (20, 2)), random.uniform(2, 5, 20)]
    pixels = local @ np.transpose(K)
    scene = load({"matrix": pose(axes, position), "convention": "opencv", "intrinsics": {"K": K}})
    # float64 holds points a million units away to 1e-10 of a unit, and 800 pixels are a unit
    np.testing.assert_allclose(
        projected(scene, local @ axes.T + position), pixels[:, :2] / pixels[:, 2:], atol=1e-9 if far == 0 else 1e-5
    )


def test_the_other_conventions_are_the_same_camera() -> None:
    axes, position = rotation(7), np.array([1.0, 2.0, 3.0])
    opencv = load({"matrix": pose(axes, position), "convention": "opencv"}).camera
    opengl = load({"matrix": pose(axes * [1, -1, -1], position), "convention": "opengl"}).camera
    z_up = np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0]])
    blender = load({"matrix": pose(z_up @ axes * [1, -1, -1], z_up @ position), "convention": "blender"}).camera
    for other in (opengl, blender):
        np.testing.assert_allclose(np.array(other.position), opencv.position, atol=1e-15)
        np.testing.assert_allclose(np.array(other.look_at), opencv.look_at, atol=1e-15)
        np.testing.assert_allclose(np.array(other.up), opencv.up, atol=1e-15)


def test_look_at_is_the_same_as_its_matrix() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (10, 3))
    looking = load({"position": [0, 0, 5], "look_at": [0, 0, 0], "fov": 40})
    matrix = load({"matrix": pose(np.eye(3), [0, 0, 5]), "convention": "opengl", "fov": 40})
    np.testing.assert_allclose(projected(looking, points), projected(matrix, points), atol=1e-9)


def test_intrinsics_by_name_default_to_square_pixels_in_the_middle() -> None:
    by_name = load({"intrinsics": {"fx": 700}}).camera
    by_k = load({"intrinsics": {"K": [[700, 0, 320], [0, 700, 240], [0, 0, 1]]}}).camera
    assert by_name == by_k
    assert (by_name.center, by_name.stretch) == ((0.5, 0.5), 1)
    assert load({"intrinsics": {"fx": 800, "fy": 750, "cx": 310, "cy": 250}}) == load({"intrinsics": {"K": K}})


def test_intrinsics_go_with_the_size_that_they_were_measured_at() -> None:
    points = [[0.2, -0.1, 0], [-0.1, 0.2, 0.1]]
    whole = load({"intrinsics": {"K": K, "size": [640, 480]}})
    half = load({"intrinsics": {"K": K, "size": [640, 480]}}, (320, 240))
    np.testing.assert_allclose(projected(whole, points), 2 * projected(half, points))


@pytest.mark.parametrize(
    ("camera", "sentence"),
    [
        (
            {"matrix": np.eye(4), "convention": "opencv", "look_at": [1, 0, 0]},
            'camera: expected either "matrix" or "look_at", found both',
        ),
        ({"matrix": np.eye(4)}, 'camera: "matrix" needs "convention" beside it'),
        ({"convention": "opengl"}, 'camera: "convention" needs "matrix" beside it'),
        (
            {"matrix": np.eye(4), "convention": "nerf"},
            'camera.convention: expected "opengl", "opencv" or "blender", got "nerf"',
        ),
        ({"matrix": np.eye(3), "convention": "opengl"}, "camera.matrix: expected 4 rows of 4 numbers, got [["),
        (
            {"matrix": np.diag([1, 1, 1.1, 1]), "convention": "opengl"},
            "camera.matrix: expected a rotation, 3 perpendicular columns of length 1, got [[",
        ),
        (
            {"matrix": np.diag([1.0, 1, -1, 1]), "convention": "opengl"},
            "camera.matrix: expected a rotation, not a mirror image of one, got [[",
        ),
        (
            {"matrix": pose(np.eye(3), [1.0, 2, 3]).T, "convention": "opengl"},
            "camera.matrix: expected a matrix whose last row is 0, 0, 0, 1, got [[",
        ),
        ({"intrinsics": {"K": K}, "fov": 30}, 'camera: expected either "intrinsics" or "fov", found both'),
        ({"intrinsics": {}}, 'camera.intrinsics: expected either "K" or "fx", found neither'),
        ({"intrinsics": {"K": K, "fx": 3}}, 'camera.intrinsics: expected either "K" or "fx", found both'),
        ({"intrinsics": {"K": K, "cx": 3}}, 'camera.intrinsics: expected no "fy", "cx" or "cy" beside "K"'),
        (
            {"intrinsics": {"K": [[800, 1, 320], *K[1:]]}},
            "camera.intrinsics.K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]] with positive fx and fy, got [[",
        ),
        ({"intrinsics": {"fx": 0}}, "camera.intrinsics.fx: expected a number from 1e-6 to 1e6, got 0"),
        ({"intrinsics": {"fx": 1, "cx": 1e9}}, "camera.intrinsics.cx: expected a number from -1e6 to 1e6, got 1"),
        ({"intrinsics": {"K": [[1e7, 0, 0], *K[1:]]}}, "camera.intrinsics.K: expected focal lengths from 1e-6 to 1e6"),
    ],
)
def test_contradictions_are_named(camera: dict[str, Any], sentence: str) -> None:
    with pytest.raises(SceneError) as error:
        load(camera)
    assert len(error.value.problems) == 1
    assert error.value.problems[0].startswith(f"scene: {sentence}")
