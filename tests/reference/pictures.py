"""Whole pictures in float64 on the OpenCL device, of as many samples as pyrt takes (pictures.cl)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.device import Device
from pyrt.scene import Camera, CheckerboardTexture, ConstantTexture, Diffuse, Rectangle, Refraction, Scene
from tests.controls import compiled_from

from .analytic import Array, Indices, unit
from .geometry import Geometry, build

LEAF = 4  # triangles
LARGE = 1 / 8  # triangles longer than this part of the scene get a tree of their own
BLOCK = 1 << 10  # samples of one work-item, or the fewest that are asked for


@dataclass
class Tree:
    """Boxes in depth-first order over triangles in the order of `ids`."""

    corners: Array  # (m, 3, 3)
    boxes: list[Array] = field(default_factory=list)  # low and high corner
    links: list[list[int]] = field(default_factory=list)  # next node if this is missed, first triangle, how many
    ids: list[int] = field(default_factory=list)

    def add(self, ids: Indices) -> None:
        low, high = self.corners[ids].min((0, 1)), self.corners[ids].max((0, 1))
        link = [0, len(self.ids), 0]
        self.boxes.append(np.append(low, high))
        self.links.append(link)
        if len(ids) <= LEAF:
            link[2] = len(ids)
            self.ids.extend(ids.tolist())
        else:
            order = np.argsort(self.corners[ids].sum(1)[:, np.argmax(high - low)], kind="stable")
            for half in np.array_split(ids[order], 2):
                self.add(half)
        link[0] = len(self.links)


def _tree(corners: Array) -> Tree:
    tree = Tree(corners)
    extent = (corners.max(1) - corners.min(1)).max(1)
    large = extent > LARGE * (corners.max((0, 1)) - corners.min((0, 1))).max()
    for part in (large, ~large):
        if part.any():
            tree.add(np.flatnonzero(part))
    return tree


class Pictures:
    """A scene ready to be rendered. Its lights must be points and rectangles."""

    def __init__(self, scene: Scene, device: str | int | None = None):
        self.scene, self._device = scene, Device(device)
        geometry = build(scene)
        tree = _tree(geometry.triangles)
        lamps = [shape for shape in scene.shapes if shape.radiance is not None]
        arrays = [*_geometry_arrays(geometry, tree), *_scene_arrays(scene, lamps)]
        self._buffers = [self._device.upload("reference", array) for array in arrays]
        sizes = (tree.links, geometry.triangles, geometry.radii, scene.shapes, scene.lights, lamps)
        self._counts = (*map(len, sizes), scene.max_depth)
        self._clearance = np.float64(geometry.clearance)
        with compiled_from(Path(__file__).parent):
            self._kernel = self._device.build("pictures.cl", ())["picture"]

    def render(self, ladder: tuple[int, ...], seed: int, size: int, uniform: bool = False) -> dict[int, Array]:
        """By n in the ladder, the (size, size, 3) picture of the samples 0 … n − 1 of every pixel.

        They are the samples that pyrt takes with this seed; with `uniform`, they see the same places, and other points
        of the lights. All n are powers of two.
        """
        block = min(BLOCK, *ladder)
        blocks = max(ladder) // block
        counts = np.array((*self._counts, size), np.int32)
        camera = self._device.upload("camera", _camera_rows(self.scene.camera, size))
        out = self._device.allocate(24 * size * blocks)
        sums = []
        for row in range(size):
            numbers = (np.uint32(n) for n in (seed, row, block, blocks))
            head = (counts.tobytes(), self._clearance, np.int32(uniform), *numbers)
            self._device.run(self._kernel, size * blocks, *head, *self._buffers, camera, out)
            with self._device.mapped(out, (size, blocks, 3), np.float64) as array:
                sums.append({n: array[:, : n // block].sum(1) / n for n in ladder})
        return {n: np.array([row[n] for row in sums]) for n in ladder}


def _geometry_arrays(geometry: Geometry, tree: Tree) -> list[NDArray[Any]]:
    ids, count = np.array(tree.ids), len(geometry.triangles)
    corners = geometry.triangles[ids]
    return [
        np.array(tree.boxes),
        np.array(tree.links, np.int32),
        np.concatenate([corners[:, :1], corners[:, 1:] - corners[:, :1]], 1),
        geometry.uvs[ids].astype(np.float64),
        geometry.normals[ids].astype(np.float64),
        np.append(geometry.shape[ids], geometry.shape[count:]).astype(np.int32),
        np.column_stack([geometry.centers, geometry.radii]),
    ]


def _scene_arrays(scene: Scene, lamps: list[Any]) -> list[NDArray[Any]]:
    assert all(isinstance(lamp, Rectangle) for lamp in lamps), "only rectangles and points may be lights"
    texels = [np.ravel(getattr(texture, "pixels", ())).astype(np.float32) for texture in scene.textures]
    first = np.cumsum([0, *map(len, texels)])
    tables: list[list[tuple[float, ...]]] = [
        [(-1 if s.material is None else s.material, *(s.radiance or (0, 0, 0))) for s in scene.shapes],
        [_material_row(material) for material in scene.materials],
        [_texture_row(texture, start) for texture, start in zip(scene.textures, first[:-1], strict=True)],
        [(*light.position, *light.flux) for light in scene.lights],
        [(*_corner(lamp), *lamp.edge1, *lamp.edge2, *lamp.radiance) for lamp in lamps],
    ]
    shapes, materials, textures, points, rectangles = (np.array(rows, np.float64) for rows in tables)
    return [shapes, materials, textures, np.concatenate([*texels, np.zeros(0, np.float32)]), points, rectangles]


def _corner(rectangle: Rectangle) -> Array:
    return np.array(rectangle.center) - np.add(rectangle.edge1, rectangle.edge2) / 2


def _material_row(material: Any) -> tuple[float, ...]:
    if isinstance(material, Diffuse):
        return (0, material.texture, material.twosided, 1)
    if isinstance(material, Refraction):
        return (1, 0, 0, material.eta)
    return (2, 0, 0, material.ext_ior / material.int_ior)


def _texture_row(texture: Any, first: int) -> tuple[float, ...]:
    if isinstance(texture, ConstantTexture):
        return (0, *texture.color, *texture.color, 1, 1, 0, 0, 1, 1, first)
    if isinstance(texture, CheckerboardTexture):
        return (1, *texture.color0, *texture.color1, *texture.scale, *texture.delta, 1, 1, first)
    height, width = texture.pixels.shape[:2]
    return (2, *(0,) * 6, *texture.scale, *texture.delta, width, height, first)


def _camera_rows(camera: Camera, size: int) -> Array:
    """Position, direction through the upper-left corner of the film, and its steps per pixel to the right and down."""
    forward = unit(np.subtract(camera.look_at, camera.position))
    right = unit(np.cross(forward, camera.up))
    half = math.tan(math.radians(camera.fov) / 2)
    x, y = right * half, -np.cross(right, forward) * half
    return np.array([camera.position, forward - x - y, 2 * x / size, 2 * y / size])
