"""A camera, a floor and lamps for models that bring none: a picture without a scene file.

The camera looks from the front right and above, so near that the model just fits into the film. A soft key light shines
from the camera's upper left, a fill light from its right, and a large one from above lights the floor behind.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrt.geometry import unit, valid_triangles
from pyrt.scene import Camera, ConstantTexture, Diffuse, Film, Mesh, PointLight, Rectangle, Scene, Sphere, Vec3

FOV = 28.0  # degrees
_AZIMUTH, _ELEVATION = 30.0, 24.0  # degrees, of the camera from the model's front
_MARGIN = 1.12  # room around the model

_FLOOR_COLOR = (0.5, 0.5, 0.5)
_FLOOR_SIZE = 60.0  # radii of the model
# azimuth from the camera, elevation, distance and side in radii of the model, and the irradiance at the model
_LAMPS = ((-50.0, 45.0, 5.0, 3.5, 2.9), (60.0, 25.0, 6.0, 4.0, 0.45), (180.0, 50.0, 14.0, 18.0, 1.25))
_WARM, _COOL = (1.0, 0.97, 0.92), (0.93, 0.97, 1.0)


class _Frame(NamedTuple):
    """Axes to build the studio on: the model's centre and radius, and unit vectors to its right, up and front."""

    center: NDArray[np.float64]
    radius: float
    right: NDArray[np.float64]
    up: NDArray[np.float64]
    front: NDArray[np.float64]

    def direction(self, azimuth: float, elevation: float) -> NDArray[np.float64]:
        """Unit vector at angles in degrees: from the front to the right, and upwards."""
        a, e = np.radians(azimuth), np.radians(elevation)
        level = np.cos(a) * self.front + np.sin(a) * self.right
        direction: NDArray[np.float64] = np.cos(e) * level + np.sin(e) * self.up
        return direction


def completed(scene: Scene, given: set[str], has_camera: bool, has_lights: bool) -> Scene:
    """The scene with what it lacks.

    Args:
        scene: of a model.
        given: fields of the camera that the model or the user sets; the others are chosen.
        has_camera: whether the model has a camera, and so no floor.
        has_lights: whether the scene's own lights are to stay the only ones.
    """
    points = _points(scene)
    frame = _frame(points, np.asarray(scene.camera.up))
    if "matrix" not in given:
        camera = scene.camera if "fov" in given or "intrinsics" in given else replace(scene.camera, fov=FOV)
        scene = replace(scene, camera=_framed(camera, scene.film, points, frame, given))
    if has_lights:
        return scene
    inside = np.all((points.min(axis=0) < scene.camera.position) & (scene.camera.position < points.max(axis=0)))
    if has_camera and inside:
        return replace(scene, lights=(_headlight(scene.camera, frame),))
    shapes = (*_lamps(scene.camera, frame), *(() if has_camera else (_floor(points, frame, len(scene.materials)),)))
    return replace(
        scene,
        lights=(),
        shapes=(*scene.shapes, *shapes),
        textures=(*scene.textures, ConstantTexture(_FLOOR_COLOR)),
        materials=(*scene.materials, Diffuse(len(scene.textures))),
    )


def _points(scene: Scene) -> NDArray[np.float64]:
    """Points that span the scene, (n, 3)."""
    parts = [np.zeros((0, 3))]
    for shape in scene.shapes:
        if isinstance(shape, Mesh):
            used = np.zeros(len(shape.vertices), bool)
            used[shape.triangles[valid_triangles(shape.vertices[shape.triangles])]] = True
            parts.append(shape.vertices[used])
        elif isinstance(shape, Sphere):
            parts.append(shape.center + shape.radius * np.concatenate([np.eye(3), -np.eye(3)]))
        elif isinstance(shape, Rectangle):
            ends = np.multiply.outer([-0.5, 0.5], [shape.edge1, shape.edge2])
            parts.append((shape.center + ends[:, None, 0] + ends[None, :, 1]).reshape(-1, 3))
    return np.concatenate(parts)


def _frame(points: NDArray[np.float64], up: NDArray[np.float64]) -> _Frame:
    low, high = points.min(axis=0), points.max(axis=0)
    up = unit(up)
    # where y is up, models face +z, and where z is up, -y: +x is to the right in both
    toward = np.array([0.0, 0.0, 1.0]) if abs(up[2]) < 0.9 else np.array([0.0, -1.0, 0.0])
    front = unit(toward - up * (toward @ up))
    center = (low + high) / 2
    radius = float(np.linalg.norm(points - center, axis=1).max()) or 1.0
    return _Frame(center, radius, np.cross(up, front), up, front)


def _framed(camera: Camera, film: Film, points: NDArray[np.float64], frame: _Frame, given: set[str]) -> Camera:
    """The camera, placed so that the points fit into the film, as far as its position and target are not given."""
    target = np.asarray(camera.look_at) if "look_at" in given else frame.center
    if "position" in given:
        return replace(camera, look_at=_vec3(target))
    away = frame.direction(_AZIMUTH, _ELEVATION)
    right = unit(np.cross(frame.up, away))
    up = np.cross(away, right)
    tan_y = np.tan(np.radians(camera.fov) / 2) / _MARGIN
    tan_x = tan_y * film.width / film.height / camera.stretch
    x, y, z = ((points - target) @ axis for axis in (right, up, away))
    (side, far_x), (lift, far_y) = _fitting(x, z, tan_x), _fitting(y, z, tan_y)
    if "look_at" in given:
        side, far_x, lift, far_y = 0.0, float((z + np.abs(x) / tan_x).max()), 0.0, float((z + np.abs(y) / tan_y).max())
    target = target + side * right + lift * up
    return replace(camera, position=_vec3(target + max(far_x, far_y) * away), look_at=_vec3(target))


def _fitting(x: NDArray[np.float64], z: NDArray[np.float64], tangent: float) -> tuple[float, float]:
    """Where a camera that looks along -z has to stand, in x and at least in z, to see all points at up to an angle
    from its axis: between the two lines at that angle that touch the points."""
    right, left = float((x + tangent * z).max()), float((x - tangent * z).min())
    return (right + left) / 2, (right - left) / (2 * tangent)


def _floor(points: NDArray[np.float64], frame: _Frame, material: int) -> Rectangle:
    lowest = float(((points - frame.center) @ frame.up).min())
    below = frame.center + frame.up * (lowest - 1e-4 * frame.radius)  # a flat underside does not touch it
    size = _FLOOR_SIZE * frame.radius
    edges = {"edge1": _vec3(frame.front * size), "edge2": _vec3(frame.right * size)}
    return Rectangle(name="floor", material=material, center=_vec3(below), **edges)


def _lamps(camera: Camera, frame: _Frame) -> list[Rectangle]:
    """Squares that face the model, around the side that the camera sees."""
    view = camera.position - frame.center
    seen = float(np.degrees(np.arctan2(view @ frame.right, view @ frame.front)))
    lamps = []
    for i, (azimuth, elevation, distance, side, irradiance) in enumerate(_LAMPS):
        away = frame.direction(seen + azimuth, elevation)
        across = unit(np.cross(frame.up, away))
        radiance = irradiance * (distance / side) ** 2
        lamps.append(
            Rectangle(
                name=f"lamp {i}",
                radiance=_vec3(radiance * np.array(_COOL if i else _WARM)),
                center=_vec3(frame.center + away * (distance * frame.radius)),
                edge1=_vec3(across * (side * frame.radius)),
                edge2=_vec3(np.cross(across, away) * (side * frame.radius)),
            )
        )
    return lamps


def _headlight(camera: Camera, frame: _Frame) -> PointLight:
    """At the camera; what is half a radius away is as bright as a white surface at irradiance 2."""
    flux = 4 * np.pi * 2 * (frame.radius / 2) ** 2
    return PointLight(camera.position, (flux, flux, flux))


def _vec3(vector: NDArray[np.float64]) -> Vec3:
    return (float(vector[0]), float(vector[1]), float(vector[2]))
