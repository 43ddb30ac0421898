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
    """A scene's triangles, and the shape of each primitive: triangles first, then spheres, and −1 for none."""

    scene: Scene
    triangles: Triangles
    shape: NDArray[np.int32]

    @classmethod
    def of(cls, scene: Scene) -> Primitives:
        triangles = gather_triangles(scene)
        spheres = [i for i, s in enumerate(scene.shapes) if isinstance(s, Sphere)]
        return cls(scene, triangles, np.concatenate([triangles.shape, np.array([*spheres, -1], np.int32)]))


def meet_primitives(primitives: Primitives, primitive: NDArray[np.int32], origin: Array, directions: Array) -> Hits:
    """Of rays that start at `origin` (3,) and run along `directions` (k, 3), of any length.

    `primitive` (k,): what each ray hits first, or −1.
    """
    count, triangles = len(primitive), primitives.triangles
    shapes, none = primitives.shape[primitive], np.full(count, -1, np.int32)
    hits = Hits(shapes, none, none.copy(), np.zeros((count, 3)), np.zeros((count, 3)), np.zeros((count, 2)))
    for shape, rays in _groups(shapes):
        what = primitives.scene.shapes[shape]
        hits.material[rays] = -1 if what.material is None else what.material
        if isinstance(what, Sphere):
            found = _meet_sphere(what, origin, directions[rays])
        else:
            mine = primitive[rays]
            hits.triangle[rays] = triangles.source[mine]
            corners = shape_corners(what, triangles.source[mine])
            found = _meet_triangles(triangles.corners[mine], corners["n"], corners["uv"], origin, directions[rays])
        hits.point[rays], hits.normal[rays], hits.uv[rays] = found
    return hits


def _groups(shape: NDArray[np.int32]) -> Iterator[tuple[int, NDArray[np.intp]]]:
    """Each shape that is hit, and the rays that hit it."""
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


def _meet_sphere(sphere: Sphere, origin: Array, d: Array) -> tuple[Array, Array, Array]:
    """Points, normals and texture coordinates."""
    d = _unit(d)
    from_center = (origin - np.asarray(sphere.center)) / sphere.radius
    middle = -(d @ from_center)
    beside = from_center + middle[:, None] * d
    half = np.sqrt(np.maximum(1.0 - (beside * beside).sum(axis=1), 0.0))
    near = middle - half
    n = _unit(beside + np.where(near > 0.0, -half, half)[:, None] * d)
    longitude = np.arctan2(n[:, 2], n[:, 0]) / (2 * np.pi) % 1.0
    uv = np.stack([longitude, np.arccos(np.clip(n[:, 1], -1.0, 1.0)) / np.pi], axis=1)
    return np.asarray(sphere.center) + sphere.radius * n, _facing(n, d), uv


def _unit(v: Array) -> Array:
    """v / |v| for (k, 3) vectors; 0 stays 0."""
    length = np.linalg.norm(v, axis=1, keepdims=True)
    return np.asarray(v / np.where(length > 0.0, length, 1.0))


def _facing(n: Array, d: Array) -> Array:
    """(k, 3) normals, turned against d."""
    return np.where((n * d).sum(axis=1, keepdims=True) > 0.0, -n, n)
