"""The camera's matrices say where its rays go."""

from __future__ import annotations

import numpy as np

from pyrt.camera import film_plane, world_to_camera, world_to_ndc
from pyrt.scene import Camera
from tests.reference.tracer import camera_rays

SIZE = (16, 9)
CAMERA = Camera(position=(1, 2, -3), look_at=(-2, 2.5, 4), up=(0.1, 1, 0), fov=55)


def seen():
    """Film positions (k, 2) and points (k, 3) somewhere on the rays through them, by the reference."""
    rng = np.random.default_rng(0)
    film = rng.random((50, 2)) * SIZE
    origins, directions = camera_rays(CAMERA, SIZE, film)
    return film, origins + rng.uniform(0.5, 9, (50, 1)) * directions


def test_the_film_plane_holds_the_rays():
    film, points = seen()
    plane = film_plane(CAMERA, *SIZE)
    directions = plane.corner + film[:, :1] * plane.dx + film[:, 1:] * plane.dy
    np.testing.assert_allclose(directions @ plane.forward, 1, rtol=1e-14)
    np.testing.assert_allclose(np.cross(directions, points - plane.position), 0, atol=1e-13)


def test_world_to_camera_is_a_rotation_with_z_forward():
    _, points = seen()
    plane = film_plane(CAMERA, *SIZE)
    matrix = world_to_camera(plane)
    np.testing.assert_allclose(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3), atol=1e-14)
    there = np.c_[points, np.ones(len(points))] @ matrix
    np.testing.assert_allclose(there[:, 2], (points - CAMERA.position) @ plane.forward, rtol=1e-13)
    above = np.array([*(np.array(CAMERA.position) + CAMERA.up), 1]) @ matrix
    right = np.array([*(np.array(CAMERA.position) + plane.dx), 1]) @ matrix
    assert above[1] > 0.9
    assert right[0] > 0
    assert np.abs(right[1:3]).max() < 1e-13


def test_world_to_ndc_projects_onto_the_film():
    film, points = seen()
    plane = film_plane(CAMERA, *SIZE)
    there = np.c_[points, np.ones(len(points))] @ world_to_ndc(plane, *SIZE)
    np.testing.assert_allclose(there[:, :2] / there[:, 3:], film / SIZE, rtol=1e-12)
    depth = (points - CAMERA.position) @ plane.forward
    np.testing.assert_allclose(there[:, 3] / there[:, 2], depth, rtol=1e-12)
