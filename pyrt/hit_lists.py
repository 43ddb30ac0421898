"""All hits of many rays: their order, and how they are gathered from parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Columns = tuple[Ints, Ints, NDArray[np.float64]]  # ray, triangle, t


@dataclass(frozen=True)
class AllHits:
    """Every hit of k rays: first the nearest of each ray, then the second ones, and so on; among those, by ray.

    Attributes:
        ray: (h,) int64, which ray.
        triangle: (h,) int64, index into the given triangles.
        t: (h,) float64, distance in units of the ray's direction.
        invalid: how many rays were not finite or had no direction; they miss.
    """

    ray: NDArray[np.int64]
    triangle: NDArray[np.int64]
    t: NDArray[np.float64]
    invalid: int


@dataclass(frozen=True)
class Part:
    """Hits of some of the rays in the order of AllHits, and how many there are on each level (nearest, second, …)."""

    columns: Columns
    levels: Sequence[int]


def in_levels(kept: NDArray[np.uint32], starts: Ints) -> tuple[Ints, Ints, list[int]]:
    """Ray and place of all hits, if those of ray i lie at starts[i] … starts[i] + kept[i] − 1; and level sizes."""
    live = np.flatnonzero(kept)
    rays, places = [live], [starts[live]]
    while len(live):
        live = live[kept[live] > len(rays)]
        places.append(starts[live] + len(rays))
        rays.append(live)
    return np.concatenate(rays), np.concatenate(places), [len(level) for level in rays]


def unpack(hits: NDArray[np.uint64]) -> tuple[Ints, NDArray[np.float32]]:
    """Triangle and t, both (h,), of hits as kernels/all_hits.h packs them."""
    triangle = (hits & np.uint64(0xFFFFFFFF)) >> np.uint64(2)
    return triangle.astype(np.int64), (hits >> np.uint64(32)).astype(np.uint32).view(np.float32)


def join(parts: Sequence[Part], ordered: bool) -> Columns:
    """The parts' hits together. ordered: whether each part's rays all come after those of the parts before it."""
    if len(parts) == 1:
        return parts[0].columns
    pieces: list[Columns] = [(np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0))]
    ends = [np.cumsum([0, *part.levels]) for part in parts]
    for depth in range(max((len(part.levels) for part in parts), default=0)):
        level = [
            _slice(part.columns, end[depth], end[depth + 1])
            for part, end in zip(parts, ends, strict=True)
            if depth < len(part.levels)
        ]
        pieces += level if ordered else [_by_ray(_concatenate(level))]
    return _concatenate(pieces)


def _slice(columns: Columns, start: int, stop: int) -> Columns:
    ray, triangle, t = columns
    return ray[start:stop], triangle[start:stop], t[start:stop]


def _concatenate(pieces: Sequence[Columns]) -> Columns:
    ray, triangle, t = zip(*pieces, strict=True)
    return np.concatenate(ray), np.concatenate(triangle), np.concatenate(t)


def _by_ray(columns: Columns) -> Columns:
    ray, triangle, t = columns
    order = np.argsort(ray, kind="stable")
    return ray[order], triangle[order], t[order]


def chunks(sizes: NDArray[np.uint32], limit: int) -> Iterator[slice]:
    """Runs of the sizes, each as long as its sum stays within the limit, and at least one long."""
    ends = np.cumsum(sizes, dtype=np.int64)
    start = 0
    while start < len(sizes):
        before = ends[start - 1] if start else 0
        stop = max(int(np.searchsorted(ends, before + limit, side="right")), start + 1)
        yield slice(start, stop)
        start = stop
