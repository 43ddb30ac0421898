"""Ray queries against a triangle mesh: closest hit and any hit, in float64 in and out."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrt.doctor import open_device
from pyrt.errors import UsageError
from pyrt.geometry import normalisation, valid_triangles
from pyrt.layout import dtypes
from pyrt.pack import round_up
from pyrt.tree import build_tree

_BATCH = 1 << 21  # rays of one launch, which bounds memory


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

    The mesh may lie anywhere and have any size: it is normalised in float64. Triangles that are not finite or have no
    area cannot be hit; they are counted in `dropped` and warned about once.

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
        tree = build_tree(normal, np.zeros(0, dtypes()["Sphere"]))
        self._bound = np.abs(normal).max(axis=(0, 1), initial=0.0).astype(np.float64)
        params = np.zeros((), dtypes()["SceneParams"])
        params["root"], params["triangle_count"], params["bound"] = tree.root, len(normal), round_up(self._bound)
        self._device = open_device(device)
        self._kernels = self._device.build("trace.cl", ["-DHAS_SPHERES=0"])
        uploads = {"parameters": params, "nodes": tree.nodes, "triangle blocks": tree.triangle_blocks}
        self._scene = [self._device.upload(name, array) for name, array in uploads.items()]

    def closest(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> Hits:
        """The nearest hits with 0 < t < t_max.

        Args:
            origins: (k, 3) float. directions: (k, 3) float, of any length. t_max: scalar or (k,).
        """
        rays = _Rays.make(origins, directions, t_max)
        count = len(rays.t_max)
        t, uv = np.full(count, np.inf), np.zeros((2, count))
        triangle = np.full(count, -1, np.int32)
        for batch in rays.batches():
            ids, t[batch], uv[:, batch] = self._closest(rays.take(batch))
            triangle[batch] = ids
        return Hits(t, triangle, uv[0], uv[1], rays.invalid)

    def occluded(self, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike = np.inf) -> NDArray[np.bool_]:
        """(k,) bool: whether anything lies at 0 < t < t_max. Arguments as for `closest`."""
        rays = _Rays.make(origins, directions, t_max)
        out = np.zeros(len(rays.t_max), np.bool_)
        for batch in rays.batches():
            out[batch] = self._any(rays.take(batch))
        return out

    def _closest(self, rays: _Rays) -> tuple[NDArray[np.int32], NDArray[np.float64], NDArray[np.float64]]:
        count = len(rays.t_max)
        batch, exponent, advance = self._normalised(rays)
        tuv, ids = self._device.allocate(12 * count), self._device.allocate(4 * count)
        self._run("trace_closest", batch, tuv, ids)
        with self._device.mapped(ids, (count,), np.int32) as array:
            found = array >= 0
            triangle = np.where(found, self._ids[array] if len(self._ids) else -1, -1)
        with self._device.mapped(tuv, (3, count), np.float32) as array:
            with np.errstate(over="ignore"):
                t = np.ldexp(np.where(found, array[0] + advance, np.inf), -exponent)
            uv = np.where(found, array[1:], 0.0).astype(np.float64)
        return triangle, t, uv

    def _any(self, rays: _Rays) -> NDArray[np.bool_]:
        count = len(rays.t_max)
        batch, _, _ = self._normalised(rays)
        occluded = self._device.allocate(count)
        self._run("trace_any", batch, occluded)
        with self._device.mapped(occluded, (count,), np.uint8) as array:
            return np.asarray(array != 0)

    def _run(self, kernel: str, batch: NDArray[np.float32], *outputs: Any) -> None:
        count = batch.shape[1]
        rays = self._device.upload("rays", batch)
        self._device.run(self._kernels[kernel], count, np.uint32(count), *self._scene, rays, *outputs)

    def _normalised(self, rays: _Rays) -> tuple[NDArray[np.float32], NDArray[np.int32], NDArray[np.float64]]:
        """The kernel's (7, k) rays, and how t maps back: t = (t_kernel + advance) · 2^−exponent.

        Directions are scaled by a power of two to a largest component in [½, 1). Origins far outside are moved to the
        scene's box in float64, so that float32 need not hold the distance; what overflows even so misses.
        """
        exponent = np.frexp(np.abs(rays.directions).max(axis=1, initial=0.0))[1]
        d = np.ldexp(rays.directions, -exponent[:, None])
        exponent += np.frexp(self._space.scale)[1] - 1
        batch = np.empty((7, len(d)), np.float32)
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            o = self._space.apply(rays.origins)
            advance = self._advance(o, d)
            batch[:3] = (o + advance[:, None] * d).T
            batch[3:6] = d.T
            batch[6] = np.clip(np.ldexp(rays.t_max, exponent) - advance, 0.0, None)
        return batch, exponent, advance

    def _advance(self, o: NDArray[np.float64], d: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far along d the box around the scene begins, for origins that are far outside; else 0."""
        out = np.zeros(len(o))
        far = np.flatnonzero((np.abs(o) > 4.0).any(axis=1))
        if len(far):
            entry = -(np.copysign(1.25 * np.maximum(self._bound, 0.5), d[far]) + o[far]) / d[far]
            entry = np.where(d[far] == 0.0, -np.inf, entry).max(axis=1)
            out[far] = np.clip(entry, 0.0, np.abs(o[far]).max(axis=1) * 4.0)
        return out


@dataclass(frozen=True)
class _Rays:
    """Rays as float64 arrays; invalid ones replaced by rays that miss (t_max = 0)."""

    origins: NDArray[np.float64]
    directions: NDArray[np.float64]
    t_max: NDArray[np.float64]
    invalid: int = 0

    @classmethod
    def make(cls, origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> _Rays:
        o, d = _points("origins", origins), _points("directions", directions)
        if len(o) != len(d):
            raise UsageError(f"directions: expected as many as origins ({len(o)}), got {len(d)}")
        limit = np.array(np.broadcast_to(np.asarray(t_max, np.float64), len(o)))
        bad = ~(np.isfinite(o).all(axis=1) & np.isfinite(d).all(axis=1) & d.any(axis=1)) | np.isnan(limit)
        if bad.any():
            o, d = np.where(bad[:, None], 0.0, o), np.where(bad[:, None], (0.0, 0.0, 1.0), d)
            limit[bad] = 0.0
        return cls(o, d, limit, int(bad.sum()))

    def batches(self) -> list[slice]:
        return [slice(i, i + _BATCH) for i in range(0, len(self.t_max), _BATCH)]

    def take(self, batch: slice) -> _Rays:
        return _Rays(self.origins[batch], self.directions[batch], self.t_max[batch])


def _points(name: str, values: ArrayLike) -> NDArray[np.float64]:
    array = np.asarray(values, np.float64)
    if array.ndim != 2 or array.shape[1] != 3:
        raise UsageError(f"{name}: expected an array of shape (n, 3), got {array.shape}")
    return array


def _corners(vertices: ArrayLike, triangles: ArrayLike) -> NDArray[np.float64]:
    v, t = _points("vertices", vertices), np.asarray(triangles)
    if t.ndim != 2 or t.shape[1] != 3 or not np.issubdtype(t.dtype, np.integer):
        raise UsageError(f"triangles: expected an integer array of shape (m, 3), got {t.dtype} {t.shape}")
    if len(t) and not (0 <= t.min() and t.max() < len(v)):
        raise UsageError(f"triangles: expected indices from 0 to {len(v) - 1}, got {t.min()} to {t.max()}")
    return np.asarray(v[t])
