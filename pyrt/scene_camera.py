"""Cameras as a scene file gives them → the renderer's one pinhole."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from pyrt import scene
from pyrt.schema_camera import Camera, Intrinsics
from pyrt.schema_types import sine

_FLIP_YZ = np.diag([1.0, -1.0, -1.0])  # between OpenCV's camera axes and OpenGL's
_Z_UP_TO_Y_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def camera_from(given: Camera, film: scene.Film) -> scene.Camera:
    """The camera of a scene file, which says what it needs in one of several forms."""
    camera = scene.Camera(given.position, given.look_at, given.ref_up, given.fov)
    if given.matrix is not None:
        position, look_at, up = pose_from_matrix(np.array(given.matrix), given.convention or "opengl")
        camera = replace(camera, position=position, look_at=look_at, up=up)
    if given.intrinsics is not None:
        fov, center, stretch = _projection(given.intrinsics, film)
        camera = replace(camera, fov=fov, center=center, stretch=stretch)
    return camera


def camera_faults(camera: scene.Camera) -> Iterator[tuple[str, str]]:
    """Fields of the scene file that leave the camera without a direction or an upright, and a sentence for each."""
    if camera.look_at == camera.position:
        yield "look_at", f"expected another point than the camera's position, got {_numbers(camera.look_at)}"
    elif sine(camera.up, _vec3(np.subtract(camera.look_at, camera.position))) < 1e-9:
        yield "ref_up", f"expected a direction that is not parallel to the line of sight, got {_numbers(camera.up)}"


def pose_from_matrix(matrix: NDArray[np.float64], convention: str) -> tuple[scene.Vec3, scene.Vec3, scene.Vec3]:
    """Position, look_at and up of a camera-to-world matrix (4, 4).

    The camera's axes are OpenGL's (+x right, +y up, looking along -z), or OpenCV's (+y down, looking along +z). Blender
    has OpenGL's, in a world whose z is up: its (x, y, z) are pyrt's (x, z, -y).
    """
    axes, position = matrix[:3, :3], matrix[:3, 3]
    if convention == "opencv":
        axes = axes @ _FLIP_YZ
    elif convention == "blender":
        axes, position = _Z_UP_TO_Y_UP @ axes, _Z_UP_TO_Y_UP @ position
    # a point ahead, so far away that adding it to the position keeps the direction's digits
    ahead = position - axes[:, 2] * max(1.0, float(np.abs(position).max()))
    return _vec3(position), _vec3(ahead), _vec3(axes[:, 1])


def _projection(given: Intrinsics, film: scene.Film) -> tuple[float, scene.Vec2, float]:
    """fov, center and stretch of x = fx·X/Z + cx, y = fy·Y/Z + cy, in the camera's axes of OpenCV."""
    width, height = given.size or (film.width, film.height)
    if given.K is not None:
        (fx, _, cx), (_, fy, cy), _ = given.K
    else:
        assert given.fx is not None
        fx, fy = given.fx, given.fy or given.fx
        cx = width / 2 if given.cx is None else given.cx
        cy = height / 2 if given.cy is None else given.cy
    fov = 2 * np.degrees(np.arctan(height / (2 * fy)))
    return float(fov), (cx / width, cy / height), fx / fy


def _vec3(vector: NDArray[np.float64]) -> scene.Vec3:
    return (float(vector[0]), float(vector[1]), float(vector[2]))


def _numbers(vector: scene.Vec3) -> str:
    return f"[{', '.join(f'{x:g}' for x in vector)}]"
