"""Rays as the caller gives them, and their normalisation in numpy, for devices without float64.

`kernels/rays.h` normalises with the same operations, and so to the same bits.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pyrt.errors import UsageError
from pyrt.geometry import Normalisation

BATCH = 1 << 20  # rays of one launch, which bounds memory
_FAR = 4.0  # normalised coordinates beyond which origins are moved to the scene


@dataclass(frozen=True)
class Rays:
    """k rays: origins and directions (k, 3), t_max (k,) or, the same for all, (1,); of any real dtype."""

    origins: NDArray[Any]
    directions: NDArray[Any]
    t_max: NDArray[Any]

    def __len__(self) -> int:
        return len(self.origins)

    def batches(self) -> Iterator[tuple[slice, Rays]]:
        """Parts of at most BATCH rays, as contiguous float64 (no copy if they are that already), and their places."""
        for start in range(0, len(self), BATCH):
            part = slice(start, start + BATCH)
            limits = self.t_max if self.t_max.shape == (1,) else self.t_max[part]
            arrays = (np.ascontiguousarray(a, np.float64) for a in (self.origins[part], self.directions[part], limits))
            yield part, Rays(*arrays)

    def take(self, index: NDArray[np.intp]) -> Rays:
        """The rays of the given numbers."""
        limits = self.t_max if self.t_max.shape == (1,) else self.t_max[index]
        return Rays(self.origins[index], self.directions[index], limits)


def make_rays(origins: ArrayLike, directions: ArrayLike, t_max: ArrayLike) -> Rays:
    """Checks shapes and numbers.

    Raises:
        UsageError: not as many directions as origins, not three coordinates, or a t_max that fits neither.
    """
    o, d = points("origins", origins), points("directions", directions)
    if len(o) != len(d):
        raise UsageError(f"directions: expected as many as origins ({len(o)}), got {len(d)}")
    limit = np.asarray(t_max)
    if limit.shape not in {(), (1,), (len(o),)} or limit.dtype.kind not in "fiu":
        raise UsageError(f"t_max: expected a number or {len(o)} of them, got {limit.dtype} {limit.shape}")
    return Rays(o, d, limit.reshape(-1))


def points(name: str, values: ArrayLike) -> NDArray[Any]:
    """The values as an array.

    Raises:
        UsageError: it does not have the shape (n, 3), or does not hold real numbers.
    """
    array = np.asarray(values)
    if array.ndim != 2 or array.shape[1] != 3:
        raise UsageError(f"{name}: expected an array of shape (n, 3), got {array.shape}")
    if array.dtype.kind not in "fiub":
        raise UsageError(f"{name}: expected real numbers, got {array.dtype}")
    return array


@dataclass(frozen=True)
class LocalRays:
    """Rays in the scene's normalised coordinates, float32, and what leads back.

    Attributes:
        rays: invalid ones are replaced by rays that miss.
        advance, exponent: (k,), t = (t_local + advance) · 2^−exponent.
        invalid: how many rays were not finite or had no direction.
    """

    rays: Rays
    advance: NDArray[np.float64]
    exponent: NDArray[np.int32]
    invalid: int

    def distance(self, t: NDArray[np.float32], ray: NDArray[np.int64] | slice = slice(None)) -> NDArray[np.float64]:
        """The caller's t of local ones on the rays of these numbers."""
        with np.errstate(over="ignore"):
            return np.asarray(np.ldexp(t + self.advance[ray], -self.exponent[ray]))


def localise(rays: Rays, space: Normalisation, bound: NDArray[np.float64]) -> LocalRays:
    """Normalises float64 rays for a scene in |x| <= bound (3,).

    Directions are scaled by a power of two to a largest component in [½, 1). Origins far outside are moved to the
    scene's box in float64, so that float32 need not hold the distance; what overflows even so misses.
    """
    o, d = rays.origins, rays.directions
    limit = np.array(np.broadcast_to(rays.t_max, len(o)))
    bad = ~(np.isfinite(o).all(axis=1) & np.isfinite(d).all(axis=1) & d.any(axis=1)) | np.isnan(limit)
    o, d = np.where(bad[:, None], 0.0, o), np.where(bad[:, None], (0.0, 0.0, 1.0), d)
    limit[bad] = 0.0
    exponent = np.frexp(np.abs(d).max(axis=1, initial=0.0))[1]
    d = np.ldexp(d, -exponent[:, None])
    exponent += np.frexp(space.scale)[1] - 1
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        o = space.apply(o)
        advance = _advance(o, d, bound)
        o = (o + advance[:, None] * d).astype(np.float32)
        limit = np.clip(np.ldexp(limit, exponent) - advance, 0.0, None).astype(np.float32)
    return LocalRays(Rays(o, d.astype(np.float32), limit), advance, exponent, int(bad.sum()))


def _advance(o: NDArray[np.float64], d: NDArray[np.float64], bound: NDArray[np.float64]) -> NDArray[np.float64]:
    """How far along d the box around the scene begins, for origins that are far outside; else 0."""
    out = np.zeros(len(o))
    far = np.flatnonzero((np.abs(o) > _FAR).any(axis=1))
    if len(far):
        entry = -(np.copysign(1.25 * np.maximum(bound, 0.5), d[far]) + o[far]) / d[far]
        entry = np.where(d[far] == 0.0, -np.inf, entry).max(axis=1)
        out[far] = np.clip(entry, 0.0, np.abs(o[far]).max(axis=1) * _FAR)
    return out


def plane_points(
    space: Normalisation,
    corners: NDArray[np.float64],
    o: NDArray[np.float64],
    d: NDArray[np.float64],
    triangle: NDArray[np.int64],
) -> NDArray[np.float64]:
    """(h, 3) points where rays o + t·d meet the planes of triangles (h,), which index (m, 3, 3) normalised corners.

    Not farther than the triangle reaches along the ray, so that a ray nearly in the plane finds a point on it too.
    """
    d = np.ldexp(d, -np.frexp(np.abs(d).max(axis=1))[1][:, None])
    c = corners[triangle]
    to = c - space.apply(o)[:, None]
    n = np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0])
    depths = (to * d[:, None]).sum(axis=2) / (d * d).sum(axis=1, keepdims=True)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = (to[:, 0] * n).sum(axis=1) / (d * n).sum(axis=1)
    t = np.fmin(np.fmax(t, depths.min(axis=1)), depths.max(axis=1))
    return np.asarray(o + (t / space.scale)[:, None] * d)
