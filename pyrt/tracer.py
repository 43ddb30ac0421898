"""Ray queries against a triangle mesh: closest hit and any hit, in float64 in and out."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrt.device_sah import splitter
from pyrt.doctor import open_device
from pyrt.errors import UsageError
from pyrt.geometry import largest_coordinates, normalisation, valid_triangles
from pyrt.hit_lists import AllHits, Ints, Part, chunks, in_levels, join, unpack
from pyrt.layout import dtypes
from pyrt.pack import round_up
from pyrt.rays import BATCH, LocalRays, Rays, localise, make_rays, plane_points, points
from pyrt.tree import build_tree

_ROOM = 8  # hits of a ray that the first pass can list; rays with more are traced again
_CROWD = 1 << 23  # hits that such a second pass lists at a time, which bounds memory


@dataclass(frozen=True)
class Hits:
    """Closest hits of k rays. The hit point is (1 − u − v)·V0 + u·V1 + v·V2.

    Attributes:
        t: (k,) float64, distance in units of the ray's direction; inf for a miss.
        triangle: (k,) int32, index into the given triangles; −1 for a miss.
        u, v: (k,) float64, weights of V1 and V2; 0 for a miss.
        invalid: how many rays were not finite or had no direction; they miss.
    """

    t: NDArray[np.float64]
    triangle: NDArray[np.int32]
    u: NDArray[np.float64]
    v: NDArray[np.float64]
    invalid: int


class RayTracer:
    """A mesh that rays can be traced against.

    The mesh may lie anywhere and have any size: it is normalised in float64, and then kept in float32. So a ray that
    starts on the surface starts within 2^-22 of the mesh's size of it, on either side. Triangles that are not finite or
    have no area cannot be hit; they are counted in `dropped` and warned about once.

    Args:
        vertices: (n, 3) float.
        triangles: (m, 3) int, indices into `vertices`.
        device: index or part of the name of an OpenCL device; None chooses.

    Raises:
        UsageError: the arrays have another shape, or an index is out of range.
        DeviceError: no device can be used, or the mesh does not fit it.
    """

    def __init__(self, vertices: ArrayLike, triangles: ArrayLike, device: str | int | None = None):
        corners = _corners(vertices, triangles)
        self._ids = np.flatnonzero(valid_triangles(corners)).astype(np.int32)
        self.dropped = len(corners) - len(self._ids)
        if self.dropped:
            warnings.warn(f"{self.dropped} of {len(corners)} triangles are not finite or have no area", stacklevel=2)
        self._corners = corners[self._ids]
        self._space = normalisation(self._corners.reshape(-1, 3), [])
        normal = self._space.apply(self._corners).astype(np.float32)
        self._bound = largest_coordinates(normal.reshape(-1, 3))
        self._device = open_device(device)
        self._double = self._device.has_double
        shape = [f"-DHAS_DOUBLE={int(self._double)}", f"-DPACKET={self._device.packet}"]
        self._kernels = self._device.build("trace.cl", ["-DHAS_SPHERES=0", *shape])
        self._scene = [self._device.adopt(name, array) for name, array in self._pack(normal).items()]

    def _pack(self, corners: NDArray[np.float32]) -> dict[str, NDArray[Any]]:
        """The kernels' arrays for normalised (m, 3, 3) corners; blocks hold the caller's numbers of triangles."""
        tree = build_tree(corners, np.zeros(0, dtypes()["Sphere"]), splitter(self._device))
        used = tree.triangle_blocks["id"] >= 0
        tree.triangle_blocks["id"][used] = self._ids[tree.triangle_blocks["id"][used]]
        params = np.zeros((), dtypes()["SceneParams"])
        params["root"], params["triangle_count"], params["bound"] = tree.root, len(corners), round_up(self._bound)
        space = np.array([*self._space.center, self._space.scale, *self._bound])
        return {"parameters": params, "nodes": tree.nodes, "triangle blocks": tree.triangle_blocks, "space": space}

    def closest(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """The nearest hits with 0 < t < t_max.

        Args:
            origins: (k, 3) float. directions: (k, 3) float, of any length. t_max: scalar or (k,).

        Raises:
            UsageError: the arrays do not fit together.
        """
        rays = make_rays(origins, directions, t_max)
        t, u, v = (np.empty(len(rays)) for _ in range(3))
        triangle = np.empty(len(rays), np.int32)
        parts = rays.batches()
        return Hits(t, triangle, u, v, sum(self._closest(part, t[i], triangle[i], u[i], v[i]) for i, part in parts))

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """(k,) bool: whether anything lies at 0 < t < t_max. Arguments and errors as for `closest`."""
        rays = make_rays(origins, directions, t_max)
        out = np.empty(len(rays), np.bool_)
        for index, part in rays.batches():
            self._trace("trace_any", part if self._double else self._localise(part).rays, out[index].view(np.uint8))
        return out

    def all_hits(
        self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf, max_hits: int | None = None
    ) -> AllHits:
        """Every hit with 0 < t < t_max, or the `max_hits` nearest of each ray.

        A ray through an edge or a corner passes through one of the triangles there. Where it touches an outline, it
        hits twice, in and out; so the number of hits tells inside from outside, unless the ray runs within the plane of
        a triangle that it touches. No hit is lost on the border of an open mesh. Arguments and errors as for `closest`.
        """
        rays = make_rays(origins, directions, t_max)
        parts: list[Part] = []
        invalid, ordered = 0, True
        for index, batch in rays.batches():
            numbers = np.arange(index.start, index.start + len(batch))
            found, bad = self._list(batch, numbers, np.full(len(batch), _ROOM, np.uint32), max_hits, parts)
            invalid += bad
            crowded = np.flatnonzero(found > _ROOM)
            ordered &= not len(crowded)
            for chunk in chunks(found[crowded], _CROWD):
                which = crowded[chunk]
                self._list(batch.take(which), numbers[which], found[which], max_hits, parts)
        return AllHits(*join(parts, ordered), invalid)

    def _list(
        self, rays: Rays, numbers: Ints, room: NDArray[np.uint32], max_hits: int | None, parts: list[Part]
    ) -> tuple[NDArray[np.uint32], int]:
        """Adds the part of the rays with room for their hits; returns how many hits each ray has, and how many rays
        are invalid."""
        local = None if self._double else self._localise(rays)
        starts = np.concatenate([np.zeros(1, np.int64), np.cumsum(room, dtype=np.int64)])
        found, kept = np.empty((2, len(rays)), np.uint32)
        hits = np.empty(starts[-1], np.uint64)
        bad = self._trace("trace_all", local.rays if local else rays, found, kept, hits, extra=[starts])
        if max_hits is not None:
            kept = np.minimum(kept, max_hits)
        ray, place, levels = in_levels(kept, starts)
        if local:
            triangle, t_local = unpack(hits[place])
            t = local.distance(t_local, ray)
        else:
            triangle, t = np.empty(len(ray), np.int64), np.empty(len(ray))
            inputs = [*self._scene[-1:], *_arguments(rays), hits, place, ray]
            self._launch("trace_unpack", len(ray), inputs, [triangle, t])
        parts.append(Part((numbers[ray], triangle, t), levels))
        return found, local.invalid if local else bad

    def locate(
        self, origins: ArrayLike, directions: ArrayLike, ray: ArrayLike, triangle: ArrayLike
    ) -> NDArray[np.float64]:
        """(h, 3) points where the rays numbered `ray` (h,) meet the planes of the triangles (h,) that they hit.

        A point lies on its ray and its plane but for the rounding of float64.

        Raises:
            UsageError: shapes do not fit, or there is no such ray or triangle (-1, say, which stands for a miss).
        """
        rays = make_rays(origins, directions, np.inf)
        rows = _indices("ray", ray, len(rays))
        hit = _indices("triangle", triangle, len(self._local_corners))
        if len(rows) != len(hit):
            raise UsageError(f"triangle: expected as many as in ray, {len(rows)}, got {len(hit)}")
        out = np.empty((len(rows), 3))
        for start in range(0, len(rows), BATCH):
            part = slice(start, start + BATCH)
            o, d = (np.asarray(a[rows[part]], np.float64) for a in (rays.origins, rays.directions))
            if self._double:
                inputs = [*self._scene[-1:], self._local_corners, o, d, hit[part]]
                self._launch("trace_points", len(o), inputs, [out[part]])
            else:
                out[part] = plane_points(self._space, self._local_corners, o, d, hit[part])
        return out

    @cached_property
    def _local_corners(self) -> NDArray[np.float64]:
        """(m, 3, 3) of all of the caller's triangles; 0 for those that were dropped."""
        corners = np.zeros((len(self._ids) + self.dropped, 3, 3))
        corners[self._ids] = self._space.apply(self._corners)
        return corners

    def _closest(self, rays: Rays, t: Any, triangle: Any, u: Any, v: Any) -> int:
        """Fills the arrays, and counts the invalid rays."""
        if self._double:
            return self._trace("trace_closest", rays, t, triangle, u, v)
        local = self._localise(rays)
        short = np.empty((3, len(rays)), np.float32)
        self._trace("trace_closest", local.rays, short[0], triangle, short[1], short[2])
        t[:], u[:], v[:] = local.distance(short[0]), short[1], short[2]
        return local.invalid

    def _localise(self, rays: Rays) -> LocalRays:
        return localise(rays, self._space, self._bound)

    def _trace(self, kernel: str, rays: Rays, *outputs: NDArray[Any], extra: Sequence[NDArray[Any]] = ()) -> int:
        """Runs the kernel on contiguous rays of its own precision, and counts those that it found invalid."""
        invalid = np.zeros(1, np.uint32)
        inputs = [*self._scene, *_arguments(rays), *extra]
        self._launch(kernel, len(rays), inputs, [invalid, *outputs], self._device.packet)
        return int(invalid[0])

    def _launch(
        self, kernel: str, count: int, inputs: Sequence[Any], outputs: Sequence[NDArray[Any]], packet: int = 1
    ) -> None:
        """Runs the kernel for `count` items on arrays, buffers and numbers, `packet` at a time, and fills outputs."""
        if count == 0:
            return
        share = self._device.share
        arguments = [share(each) if isinstance(each, np.ndarray) else each for each in inputs]
        self._device.run(self._kernels[kernel], -(-count // packet), np.uint32(count), *arguments, fill=outputs)


def _arguments(rays: Rays) -> list[Any]:
    return [rays.origins, rays.directions, rays.t_max, np.uint32(rays.t_max.shape != (1,))]


def _indices(name: str, values: ArrayLike, count: int) -> Ints:
    """The values (h,) as int64. Raises UsageError unless they are whole numbers from 0 to count - 1."""
    array = np.asarray(values)
    if array.ndim != 1 or not (np.issubdtype(array.dtype, np.integer) or array.size == 0):
        raise UsageError(f"{name}: expected an integer array of shape (h,), got {array.dtype} {array.shape}")
    if array.size and not (0 <= array.min() and array.max() < count):
        raise UsageError(f"{name}: expected indices from 0 to {count - 1}, got {array.min()} to {array.max()}")
    return np.ascontiguousarray(array, np.int64)


def _corners(vertices: ArrayLike, triangles: ArrayLike) -> NDArray[np.float64]:
    v, t = points("vertices", vertices).astype(np.float64, copy=False), np.asarray(triangles)
    if t.ndim != 2 or t.shape[1] != 3 or not np.issubdtype(t.dtype, np.integer):
        raise UsageError(f"triangles: expected an integer array of shape (m, 3), got {t.dtype} {t.shape}")
    if len(t) and not (0 <= t.min() and t.max() < len(v)):
        raise UsageError(f"triangles: expected indices from 0 to {len(v) - 1}, got {t.min()} to {t.max()}")
    return np.asarray(v[t])
