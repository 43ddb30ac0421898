"""Where a camera's rays start and go, in float64 and world units, and the matrices that say the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.geometry import unit
from pyrt.scene import Camera


@dataclass(frozen=True)
class FilmPlane:
    """The film, at distance 1 in front of the pinhole.

    The ray through film position (x, y), in pixels from the upper-left corner, runs along corner + x·dx + y·dy; the
    component of that along `forward` is 1. All are (3,) float64.
    """

    position: NDArray[np.float64]
    forward: NDArray[np.float64]
    corner: NDArray[np.float64]
    dx: NDArray[np.float64]
    dy: NDArray[np.float64]


def film_plane(camera: Camera, width: int, height: int) -> FilmPlane:
    """For a film of width × height pixels."""
    position = np.asarray(camera.position, np.float64)
    forward = unit(np.subtract(camera.look_at, position))
    right = unit(np.cross(forward, unit(np.asarray(camera.up, np.float64))))
    up = np.cross(right, forward)
    pixel = 2 * np.tan(np.radians(camera.fov) / 2) / height
    dx, dy = right * (pixel / camera.stretch), -up * pixel
    corner = forward - dx * (width * camera.center[0]) - dy * (height * camera.center[1])
    return FilmPlane(position, forward, corner, dx, dy)


def world_to_camera(plane: FilmPlane) -> NDArray[np.float64]:
    """(4, 4) M, used as [x y z 1]·M: x runs to the right, y upwards, and z forward from the pinhole."""
    axes = np.stack([plane.dx / np.linalg.norm(plane.dx), -plane.dy / np.linalg.norm(plane.dy), plane.forward], axis=1)
    return _affine(axes, -plane.position @ axes)


def world_to_ndc(plane: FilmPlane, width: int, height: int) -> NDArray[np.float64]:
    """(4, 4) M, used as [x y z 1]·M and a division by the last component: (0, 0) is the film's upper-left corner and
    (1, 1) the lower-right one; the third component is 1 over the distance along the camera's axis."""
    film = np.linalg.inv(np.stack([plane.dx * width, plane.dy * height, plane.corner]))
    out = np.zeros((4, 4))
    out[:, [0, 1, 3]] = _affine(film, -plane.position @ film)[:, :3]
    out[3, 2] = 1.0
    return out


def _affine(linear: NDArray[np.float64], offset: NDArray[np.float64]) -> NDArray[np.float64]:
    out = np.eye(4)
    out[:3, :3], out[3, :3] = linear, offset
    return out
