"""The scene's triangles and spheres in one float64 list, cleaned and normalised.

Normalisation subtracts the scene's centre and scales by a power of two, so that |x| <= 1 and float32 holds the
geometry wherever the scene is and however large. Both are exact for coordinates on the input's grid: scaling a
scene by 2^k changes no bit of the result.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.scene import Mesh, Rectangle, Scene, Shape, Sphere

COORDINATE_LIMIT = 1e30  # beyond it, squares and scales leave float32's range
_ULP = 2.0**-24  # half the spacing of float32 in [1, 2)
_PART = 1 << 13  # triangles at a time
_DEGENERATE = 2.0**-44  # sine of the angle below which float64 cannot tell an edge pair from a line


@dataclass(frozen=True)
class Normalisation:
    """x_normalised = (x − center) · scale, scale a power of two."""

    center: NDArray[np.float64]
    scale: float

    def apply(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        moved = points - self.center
        moved *= self.scale
        return moved


@dataclass(frozen=True)
class Triangles:
    """Valid triangles in the order of the scene's shapes."""

    corners: NDArray[np.float64]  # (m, 3 corners, 3), world space
    shape: NDArray[np.int32]  # (m,), index into Scene.shapes
    source: NDArray[np.int32]  # (m,), index of the triangle within its shape
    dropped: int  # triangles that were not finite, or had no area

    def of_shape(self, index: int) -> NDArray[np.intp]:
        """The triangles of Scene.shapes[index]."""
        return np.arange(*np.searchsorted(self.shape, (index, index + 1)))


def rectangle_corners(rectangle: Rectangle) -> NDArray[np.float64]:
    """Corners in the order (u, v) = (0, 0), (1, 0), (1, 1), (0, 1), as a (4, 3) array."""
    return np.asarray(_rectangles_corners([rectangle])[0])


def _rectangles_corners(rectangles: Sequence[Rectangle]) -> NDArray[np.float64]:
    """The same of k rectangles, as a (k, 4, 3) array."""
    vectors = np.array([(r.center, r.edge1, r.edge2) for r in rectangles], np.float64)
    c, e1, e2 = vectors.reshape(-1, 3, 3).transpose(1, 0, 2)
    low = c - 0.5 * e1 - 0.5 * e2
    return np.stack([low, low + e1, low + e1 + e2, low + e2], axis=1)


def gather_triangles(scene: Scene) -> Triangles:
    """All triangles of meshes and rectangles; those that no ray can meet are dropped and counted."""
    count = sum(_triangle_count(shape) for shape in scene.shapes)
    corners, shapes, sources = np.empty((count, 3, 3)), np.empty(count, np.int32), np.empty(count, np.int32)
    end = 0
    for batch in _batches(scene.shapes):
        first, shape = end, batch[0][1]
        for of_shape, source, part in _corner_parts(batch):
            keep = np.flatnonzero(valid_triangles(part))
            kept = slice(end, end := end + len(keep))
            corners[kept], shapes[kept], sources[kept] = part[keep], of_shape[keep], source[keep]
        if isinstance(shape, Mesh) and shape.radiance is not None:
            order = _canonical_order(corners[first:end])
            corners[first:end], sources[first:end] = corners[first:end][order], sources[first:end][order]
    return Triangles(corners[:end], shapes[:end], sources[:end], count - end)


def _triangle_count(shape: Shape) -> int:
    return len(shape.triangles) if isinstance(shape, Mesh) else 2 * isinstance(shape, Rectangle)


def _batches(shapes: Sequence[Shape]) -> Iterator[list[tuple[int, Shape]]]:
    """The shapes that are made of triangles, and the index of each: a large mesh or one that is a light alone, and many
    small shapes together, since numpy takes as long for one triangle as for a hundred."""
    batch: list[tuple[int, Shape]] = []
    room = _PART
    for index, shape in enumerate(shapes):
        count = _triangle_count(shape)
        alone = isinstance(shape, Mesh) and shape.radiance is not None
        if batch and (count > room or alone):
            yield batch
            batch, room = [], _PART
        if count:
            batch.append((index, shape))
            room = 0 if alone else room - count
    if batch:
        yield batch


def _corner_parts(
    batch: list[tuple[int, Shape]],
) -> Iterator[tuple[NDArray[np.int32], NDArray[np.intp], NDArray[np.float64]]]:
    """The batch's triangles in parts: (k,) index of the shape, (k,) number within the shape, (k, 3, 3) corners."""
    if len(batch) == 1 and isinstance(mesh := batch[0][1], Mesh):
        for part in parts(len(mesh.triangles)):
            source = np.arange(part.start, part.stop)
            yield np.full(len(source), batch[0][0], np.int32), source, mesh.vertices[mesh.triangles[part]]
        return
    rectangles = _rectangles_corners([shape for _, shape in batch if isinstance(shape, Rectangle)])
    halves = iter(rectangles[:, [[0, 1, 2], [0, 2, 3]]])
    corners = [s.vertices[s.triangles] if isinstance(s, Mesh) else next(halves) for _, s in batch]
    counts = [len(c) for c in corners]
    of_shape = np.repeat(np.array([index for index, _ in batch], np.int32), counts)
    source = np.arange(len(of_shape)) - np.repeat(np.cumsum([0, *counts[:-1]]), counts)
    yield of_shape, source, np.concatenate(corners)


def _canonical_order(corners: NDArray[np.float64]) -> NDArray[np.intp]:
    """Order by coordinates: which point of a mesh light a sample picks must not depend on the order in the file."""
    return np.lexsort(corners.reshape(len(corners), 9).T[::-1])


def valid_triangles(corners: NDArray[np.float64]) -> NDArray[np.bool_]:
    """(m,) bool for (m, 3, 3) corners: finite, within the limit, and neither a line nor a point."""
    valid = np.empty(len(corners), np.bool_)
    for part in parts(len(corners)):
        flat = np.ascontiguousarray(corners[part].reshape(-1, 9).T)
        with np.errstate(all="ignore"):  # NaN compares false
            e1, e2, n = _edges_and_normal(flat)
            longest = np.sqrt(_square(e1)) * np.sqrt(_square(e2))
            area = np.sqrt(_square(n))
            valid[part] = (np.abs(flat) < COORDINATE_LIMIT).all(axis=0) & (area > _DEGENERATE * longest)
    return valid


def parts(count: int) -> Iterator[slice]:
    """Ranges of triangles whose arrays fit the cache."""
    return (slice(first, min(first + _PART, count)) for first in range(0, count, _PART))


def _edges_and_normal(flat: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
    """Both edges at v0 of triangles (9, m), as `scaled_edges` has them, and their cross product, (3, m) each."""
    edges = (flat[3:].reshape(2, 3, -1) - flat[:3]).reshape(2, 3, -1)
    size = np.abs(edges).max(axis=(0, 1))
    size[size == 0] = 1
    edges /= size
    (ax, ay, az), (bx, by, bz) = edges
    return edges[0], edges[1], np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _square(v: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(v[0] * v[0] + v[1] * v[1] + v[2] * v[2])


def scaled_edges(corners: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Both edges at v0 of (m, 3, 3) triangles, divided by the third result, their largest coordinate (m,): so that no
    tiny triangle's area is 0."""
    edges = corners[:, 1:] - corners[:, :1]
    size = np.abs(edges).max(axis=(1, 2), initial=0.0)
    e1, e2 = (edges / np.where(size > 0.0, size, 1.0)[:, None, None]).transpose(1, 0, 2)
    return e1, e2, size


def triangle_normals(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    """(m, 3) unit normals of valid (m, 3, 3) triangles."""
    normals = np.empty((len(corners), 3))
    for part in parts(len(corners)):
        _, _, n = _edges_and_normal(np.ascontiguousarray(corners[part].reshape(-1, 9).T))
        normals[part] = (n / np.sqrt(_square(n))).T
    return normals


def extremes(points: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any]]:
    """The least and the greatest coordinates, (3,) each, of (n, 3) points, n >= 1."""
    flat = (np.ascontiguousarray(points[part].T) for part in parts(len(points)))
    low, high = zip(*((each.min(axis=1), each.max(axis=1)) for each in flat), strict=True)
    return np.min(low, axis=0), np.max(high, axis=0)


def largest_coordinates(points: NDArray[Any]) -> NDArray[np.float64]:
    """(3,) the greatest |x| of (n, 3) points; 0 if there are none."""
    return np.abs(extremes(points)).max(axis=0).astype(np.float64) if len(points) else np.zeros(3)


def normalisation(points: NDArray[np.float64], spheres: list[Sphere]) -> Normalisation:
    """Centre and scale for the given (n, 3) points and spheres.

    The centre is rounded to a grid of 2^−20 extents, halves upwards, so that moving a scene by a multiple of that grid
    moves the centre by exactly as much.
    """
    low, high = ([extreme] for extreme in extremes(points)) if len(points) else ([], [])
    if spheres:
        centers, radii = np.array([s.center for s in spheres]), np.array([[s.radius] for s in spheres])
        low.append((centers - radii).min(axis=0))
        high.append((centers + radii).max(axis=0))
    if not low:
        return Normalisation(np.zeros(3), 1.0)
    lo, hi = np.min(low, axis=0), np.max(high, axis=0)
    half = max(float((hi - lo).max()) / 2, np.finfo(np.float64).tiny * 2.0**64)
    grid = 2.0 ** (np.frexp(half)[1] - 20)
    center = np.floor((lo + hi) / (2 * grid) + 0.5) * grid
    extent = max(float(np.abs(np.stack([lo, hi]) - center).max()), half)
    return Normalisation(center, 2.0 ** -float(np.frexp(extent)[1]))


@dataclass(frozen=True)
class LocalTriangles:
    """Normalised triangles: what is asked of all of them at once."""

    corners: NDArray[np.float32]  # (m, 3, 3)
    bound: NDArray[np.float64]  # (3,), the greatest |x|
    largest_edge: float  # the greatest coordinate difference along an edge at v0


def local_triangles(corners: NDArray[np.float64], space: Normalisation) -> LocalTriangles:
    """Of (m, 3, 3) corners in world space."""
    local = np.empty(corners.shape, np.float32)
    bound, edge = np.zeros(3), 0.0
    for part in parts(len(corners)):
        moved = space.apply(corners[part])
        local[part] = moved
        bound = np.maximum(bound, largest_coordinates(moved.reshape(-1, 3)))
        edge = max(edge, float(np.abs(moved[:, 1:] - moved[:, :1]).max()))
    return LocalTriangles(local, bound, edge)


def unit(v: NDArray[np.float64]) -> NDArray[np.float64]:
    """v / |v| for a (3,) vector of any representable length but zero."""
    scaled = v / np.abs(v).max()
    return np.asarray(scaled / np.linalg.norm(scaled))


def rounding_offset(
    v0: NDArray[np.float64], e1: NDArray[np.float64], e2: NDArray[np.float64], n: NDArray[np.float64], largest: float
) -> NDArray[np.float64]:
    """How far to move a hit point v0 + u·e1 + v·e2 along n so that no ray that leaves can meet the triangle, or another
    one in the same plane. Arrays (…, 3), and the `largest` edge in the scene.

    In float32 each coordinate of the point is off by one rounding of the stored corners, two of the sum, and one of the
    move; only the part along n counts. The test of a ray rounds the places of a triangle's corners as seen from the
    point, in the ray's own frame: as far as the largest triangle reaches.
    """
    reach = np.abs(e1) + np.abs(e2)
    return np.asarray(4.0 * _ULP * (((np.abs(v0) + reach) * np.abs(n)).sum(axis=-1) + largest))


def sphere_offset(center: NDArray[np.float64], radius: NDArray[np.float64]) -> NDArray[np.float64]:
    """The same for a point center + radius·n of a sphere."""
    return np.asarray(4.0 * _ULP * (np.abs(center).sum(axis=-1) + 4.0 * radius))
