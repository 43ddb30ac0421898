"""A scene as arrays of primitives in float64, with brute-force closest and any hit.

The only acceleration: triangles lie in nested clusters, and a ray meets those whose bounding sphere it crosses.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.scene import Mesh, Rectangle, Scene, Sphere

from .analytic import Array, Indices, dot, unit

CLUSTER_SIZE = 32
SLACK = 1e-12  # barycentric: a ray through an edge hits one triangle at least


@dataclass(frozen=True)
class Cluster:
    triangles: Indices
    center: Array
    radius: float
    halves: tuple[Cluster, ...]  # empty: to be met as a whole


@dataclass(frozen=True)
class Geometry:
    """Triangles come first, in the order of the scene's shapes, then spheres; ids count through both."""

    triangles: Array  # (m, 3, 3)
    uvs: Array  # (m, 3, 2)
    normals: Array  # (m, 3, 3), zero where flat
    centers: Array  # (s, 3)
    radii: Array  # (s,)
    shape: Indices  # (m + s,) index into scene.shapes
    cluster: Cluster  # of all triangles
    clearance: float  # rays start this far from where they stand


@dataclass(frozen=True)
class Hits:
    """Closest hits of k rays; where `shape` is -1 the ray missed, and the other fields mean nothing."""

    shape: Indices
    point: Array
    normal: Array  # geometric, on the front side
    shading: Array
    uv: Array

    def __getitem__(self, chosen: Indices) -> Hits:
        return Hits(self.shape[chosen], self.point[chosen], self.normal[chosen], self.shading[chosen], self.uv[chosen])


def build(scene: Scene) -> Geometry:
    parts = [(i, *_corners(shape)) for i, shape in enumerate(scene.shapes) if not isinstance(shape, Sphere)]
    spheres = [(i, shape) for i, shape in enumerate(scene.shapes) if isinstance(shape, Sphere)]
    triangles = np.concatenate([np.empty((0, 3, 3)), *(part[1] for part in parts)])
    centers = np.array([s.center for _, s in spheres]).reshape(-1, 3)
    radii = np.array([s.radius for _, s in spheres])
    low = np.concatenate([triangles.reshape(-1, 3), centers - radii[:, None]]).min(0, initial=np.inf)
    high = np.concatenate([triangles.reshape(-1, 3), centers + radii[:, None]]).max(0, initial=-np.inf)
    shape = [np.full(len(part[1]), part[0]) for part in parts] + [np.array([i for i, _ in spheres], int)]
    return Geometry(
        triangles,
        np.concatenate([np.empty((0, 3, 2)), *(part[2] for part in parts)]),
        np.concatenate([np.empty((0, 3, 3)), *(part[3] for part in parts)]),
        centers,
        radii,
        np.concatenate(shape).astype(np.intp),
        _cluster(triangles, np.arange(len(triangles))),
        1e-10 * float(np.max(high - low, initial=0.0)),
    )


def _corners(shape: object) -> tuple[Array, Array, Array]:
    """Triangles (m, 3, 3) of a mesh or rectangle with their texture coordinates (m, 3, 2) and normals (m, 3, 3)."""
    if isinstance(shape, Rectangle):
        square = np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)])
        vertices = np.array(shape.center) + (square - 0.5) @ np.array([shape.edge1, shape.edge2])
        faces = np.array([(0, 1, 2), (0, 2, 3)])
        return vertices[faces], square[faces], np.zeros((2, 3, 3))
    assert isinstance(shape, Mesh)
    vertices = shape.vertices[shape.triangles]
    corner = np.broadcast_to([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)], (len(vertices), 3, 2))
    uvs = corner if shape.uvs is None else shape.uvs.astype(float)
    return vertices, uvs, np.zeros_like(vertices) if shape.normals is None else shape.normals.astype(float)


def _cluster(triangles: Array, ids: Indices) -> Cluster:
    """Halved along the widest axis until few triangles are left."""
    corners = triangles[ids].reshape(-1, 3)
    low, high = corners.min(0, initial=np.inf), corners.max(0, initial=-np.inf)
    halves: tuple[Cluster, ...] = ()
    if len(ids) > CLUSTER_SIZE:
        order = ids[np.argsort(triangles[ids, :, np.argmax(high - low)].sum(1), kind="stable")]
        halves = tuple(_cluster(triangles, half) for half in np.array_split(order, 2))
    center = (low + high) / 2 if len(ids) else np.zeros(3)
    return Cluster(ids, center, float(np.linalg.norm(corners - center, axis=1).max(initial=0)), halves)


def closest(geometry: Geometry, origins: Array, directions: Array) -> Hits:
    """First hit of each ray (k, 3), (k, 3), directions of unit length; of equal hits the lowest id."""
    distance = np.full(len(origins), np.inf)
    primitive = np.full(len(origins), -1)
    for rays, ids, t in _candidates(geometry, origins, directions, np.full(len(origins), np.inf)):
        t = np.where(t > geometry.clearance, t, np.inf)
        nearest = t.min(1)
        lowest = np.where(t == nearest[:, None], ids, len(geometry.shape)).min(1)
        better = (nearest < distance[rays]) | ((nearest == distance[rays]) & (lowest < primitive[rays]))
        better &= np.isfinite(nearest)
        distance[rays[better]], primitive[rays[better]] = nearest[better], lowest[better]
    point = origins + np.where(np.isfinite(distance), distance, 0.0)[:, None] * directions
    return _surface(geometry, primitive, point)


def occluded(geometry: Geometry, origins: Array, targets: Array) -> NDArray[np.bool_]:
    """(k,) whether anything lies strictly between the ends of each segment."""
    length = np.linalg.norm(targets - origins, axis=1)
    blocked = np.zeros(len(origins), bool)
    for rays, _, t in _candidates(geometry, origins, (targets - origins) / length[:, None], length):
        blocked[rays] |= ((t > geometry.clearance) & (t < length[rays, None] - geometry.clearance)).any(1)
    return blocked


def _candidates(
    geometry: Geometry, origins: Array, directions: Array, length: Array
) -> Iterator[tuple[Indices, Indices, Array]]:
    """Yield (rays, ids, t (rays, ids)) for groups of primitives; t is infinite where the ray misses."""
    for cluster, rays in _leaves(geometry.cluster, np.arange(len(origins)), origins, directions, length):
        triangles = geometry.triangles[cluster.triangles]
        for part in np.array_split(rays, len(rays) * len(triangles) // 2**20 + 1):
            yield part, cluster.triangles, _triangles(triangles, origins[part], directions[part])
    if len(geometry.radii):
        ids = len(geometry.triangles) + np.arange(len(geometry.radii))
        for root in (-1.0, 1.0):
            yield np.arange(len(origins)), ids, _spheres(geometry, origins, directions, root)


def _leaves(
    cluster: Cluster, rays: Indices, origins: Array, directions: Array, length: Array
) -> Iterator[tuple[Cluster, Indices]]:
    """The smallest clusters, each with those of the rays that come near it."""
    to_center = cluster.center - origins[rays]
    along = np.clip(dot(to_center, directions[rays]), 0, length[rays])
    away = to_center - along[:, None] * directions[rays]
    rays = rays[dot(away, away) <= cluster.radius**2 * (1 + 1e-9)]
    if len(rays) and not cluster.halves:
        yield cluster, rays
    for half in cluster.halves if len(rays) else ():
        yield from _leaves(half, rays, origins, directions, length)


def _triangles(triangles: Array, origins: Array, directions: Array) -> Array:
    """(k, m) distances to triangles (Möller and Trumbore 1997)."""
    e1, e2 = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    normal = np.cross(e1, e2)
    offset = origins[:, None] - triangles[:, 0]
    moment = np.cross(offset, directions[:, None])
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = -1 / (directions @ normal.T)
        u, v = dot(moment, e2) * scale, -dot(moment, e1) * scale
        t = dot(offset, normal) * scale
        hit = (u >= -SLACK) & (v >= -SLACK) & (u + v <= 1 + SLACK) & np.isfinite(t)
    return np.where(hit, t, np.inf)


def _spheres(geometry: Geometry, origins: Array, directions: Array, root: float) -> Array:
    """(k, s) distances to the near (root -1) or far (+1) side of the spheres."""
    to_center = geometry.centers - origins[:, None]
    along = np.einsum("nsi,ni->ns", to_center, directions)
    away = to_center - along[..., None] * directions[:, None]
    half2 = geometry.radii**2 - dot(away, away)
    return np.where(half2 >= 0, along + root * np.sqrt(np.maximum(half2, 0)), np.inf)


def _surface(geometry: Geometry, primitive: Indices, point: Array) -> Hits:
    """What the surface is like where rays hit it."""
    normal, shading, uv = np.zeros_like(point), np.zeros_like(point), np.zeros((len(point), 2))
    count = len(geometry.triangles)
    flat, ball = (primitive >= 0) & (primitive < count), primitive >= count
    ids = primitive[flat]
    corners = geometry.triangles[ids]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normal[flat] = unit(areas)
    opposite = np.cross(np.roll(corners, -1, 1) - point[flat, None], np.roll(corners, -2, 1) - point[flat, None])
    weights = dot(opposite, areas[:, None]) / dot(areas, areas)[:, None]
    uv[flat] = np.einsum("nc,nci->ni", weights, geometry.uvs[ids])
    smooth = np.einsum("nc,nci->ni", weights, geometry.normals[ids])
    shading[flat] = unit(np.where(smooth.any(1)[:, None], smooth, normal[flat]))
    normal[ball] = shading[ball] = unit(point[ball] - geometry.centers[primitive[ball] - count])
    uv[ball] = sphere_uv(normal[ball])
    shape = np.where(primitive >= 0, np.append(geometry.shape, -1)[primitive], -1)
    return Hits(shape, point, normal, shading, uv)


def sphere_uv(normals: Array) -> Array:
    """(n, 2) longitude around +y from +x towards +z, and angle from +y, both scaled to [0, 1]."""
    x, y, z = normals.T
    return np.stack([np.arctan2(z, x) / (2 * np.pi) % 1.0, np.arccos(np.clip(y, -1, 1)) / np.pi], 1)
