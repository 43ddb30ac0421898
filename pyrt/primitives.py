"""Where rays from one point meet primitives that are known to be hit, in float64 and world units."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.geometry import Triangles, gather_triangles, scaled_edges
from pyrt.pack import shape_corners
from pyrt.scene import Scene, Sphere

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Hits:
    """Of k rays. Where a ray missed, the indices are −1 and the rest is 0.

    Attributes:
        shape: (k,) int, index into the scene's shapes.
        material: (k,) int, index into the scene's materials; −1 for a surface without one.
        triangle: (k,) int, index of the triangle within its shape; −1 for a sphere.
        point: (k, 3), on the surface.
        normal: (k, 3), unit shading normal on the ray's side.
        uv: (k, 2), texture coordinates.
    """

    shape: NDArray[np.int32]
    material: NDArray[np.int32]
    triangle: NDArray[np.int32]
    point: Array
    normal: Array
    uv: Array


@dataclass(frozen=True)
class Primitives:
    """A scene's triangles and spheres, by the ids that the kernels use: triangles first.

    Attributes:
        shape: (n + 1,), of each primitive; and −1, for none.
        material: (shapes + 1,), of each shape; and −1.
    """

    scene: Scene
    triangles: Triangles
    centers: Array  # (spheres, 3)
    radii: Array  # (spheres,)
    shape: NDArray[np.int32]
    material: NDArray[np.int32]

    @classmethod
    def of(cls, scene: Scene) -> Primitives:
        triangles = gather_triangles(scene)
        spheres = [(i, s.center, s.radius) for i, s in enumerate(scene.shapes) if isinstance(s, Sphere)]
        shape = np.concatenate([triangles.shape, np.array([*(i for i, _, _ in spheres), -1], np.int32)])
        materials = [-1 if s.material is None else s.material for s in scene.shapes]
        return cls(
            scene,
            triangles,
            np.array([center for _, center, _ in spheres], np.float64).reshape(-1, 3),
            np.array([radius for _, _, radius in spheres], np.float64),
            shape,
            np.array([*materials, -1], np.int32),
        )


def meet_primitives(primitives: Primitives, primitive: NDArray[np.int32], origin: Array, directions: Array) -> Hits:
    """Of rays that start at `origin` (3,) and run along `directions` (k, 3), of any length.

    `primitive` (k,): what each ray hits first, or −1.
    """
    count, triangles = len(primitive), primitives.triangles
    shape = primitives.shape[primitive]
    indices = shape, primitives.material[shape], np.full(count, -1, np.int32)
    hits = Hits(*indices, np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 2)))
    is_sphere = primitive >= len(triangles.shape)
    rays = np.flatnonzero(is_sphere)
    sphere = primitive[rays] - len(triangles.shape)
    found = _meet_spheres(primitives.centers[sphere], primitives.radii[sphere, None], origin, directions[rays])
    hits.point[rays], hits.normal[rays], hits.uv[rays] = found
    for index, rays in _groups(np.where(is_sphere, -1, shape)):
        mine = primitive[rays]
        hits.triangle[rays] = triangles.source[mine]
        corners = shape_corners(primitives.scene.shapes[index], triangles.source[mine])
        found = _meet_triangles(triangles.corners[mine], corners["n"], corners["uv"], origin, directions[rays])
        hits.point[rays], hits.normal[rays], hits.uv[rays] = found
    return hits


def _groups(shape: NDArray[np.int32]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Each shape ≥ 0, and the rays that hit it."""
    order = np.argsort(shape, kind="stable")
    order = order[np.searchsorted(shape[order], 0) :]
    for rays in np.split(order, np.flatnonzero(np.diff(shape[order])) + 1):
        if len(rays):
            yield int(shape[rays[0]]), rays


def _meet_triangles(
    corners: Array, normals: NDArray[np.float32], uvs: NDArray[np.float32], origin: Array, d: Array
) -> tuple[Array, Array, Array]:
    """Points, normals and texture coordinates. Barycentrics are forced inside, as the device's rays are rounded."""
    e1, e2, size = scaled_edges(corners)
    ng = np.cross(e1, e2)
    offset = (origin - corners[:, 0]) / size[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        moment = np.cross(offset, d) / (d * ng).sum(axis=1)[:, None]
        weights = np.stack([-(moment * e2).sum(axis=1), (moment * e1).sum(axis=1)], axis=1)
    weights = np.clip(
        np.where(np.isfinite(weights), weights, 1 / 3), 0.0, 1.0
    )  # not finite: the plane seen from its edge
    weights /= np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
    weights = np.concatenate([1.0 - weights.sum(axis=1, keepdims=True), weights], axis=1)
    point = corners[:, 0] + ((weights[:, 1:2] * e1 + weights[:, 2:] * e2) * size[:, None])
    smooth = np.einsum("kc,kci->ki", weights, normals)
    ng = _facing(_unit(ng), d)
    n = np.where(smooth.any(axis=1)[:, None], _unit(smooth), ng)
    return point, _facing(n, -ng), np.einsum("kc,kci->ki", weights, uvs)


def _meet_spheres(centers: Array, radii: Array, origin: Array, d: Array) -> tuple[Array, Array, Array]:
    """Points, normals and texture coordinates; radii are (k, 1)."""
    d = _unit(d)
    from_center = (origin - centers) / radii
    middle = -(from_center * d).sum(axis=1, keepdims=True)
    beside = from_center + middle * d
    half = np.sqrt(np.maximum(1.0 - (beside * beside).sum(axis=1, keepdims=True), 0.0))
    n = _unit(beside + np.where(middle > half, -half, half) * d)
    longitude = np.arctan2(n[:, 2], n[:, 0]) / (2 * np.pi) % 1.0
    uv = np.stack([longitude, np.arccos(np.clip(n[:, 1], -1.0, 1.0)) / np.pi], axis=1)
    return centers + radii * n, _facing(n, d), uv


def _unit(v: Array) -> Array:
    """v / |v| for (k, 3) vectors; 0 stays 0."""
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.asarray(v / np.where(length > 0.0, length, 1.0))


def _facing(n: Array, d: Array) -> Array:
    """(k, 3) normals, turned against d."""
    return np.where((n * d).sum(axis=1, keepdims=True) > 0.0, -n, n)
