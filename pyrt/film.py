"""The stratified average: sums in float64, with the same bits whatever parts the samples came in.

A floating-point sum depends on its order, so the order is fixed: the samples of a pixel are the leaves of a binary
tree, and a node, the samples index·2^level … (index + 1)·2^level − 1, is the sum of its two halves. A film holds the
largest nodes that its samples complete. Every split into passes leads to the same nodes, and so do films of separate
sample ranges that are merged later. This takes no more additions than a running sum, and its error grows only with the
logarithm of the number of samples.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

_BLOCK = 16384  # pixels summed at a time, or samples of fewer pixels, so that the sums stay in cache

Sums = NDArray[np.float64]  # (2, 3, pixels): of x and of x²
Nodes = dict[tuple[int, int], Sums]  # by (level, index)
Picture = tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.uint32]]  # mean, variance, number of samples


@dataclass
class Film:
    """Sums over the samples of a list of pixels. Samples that are not finite are left out and counted."""

    count: NDArray[np.uint32]  # (pixels,), samples in the sums
    strips: dict[int, Nodes] = field(default_factory=dict)  # by the first pixel that the nodes are of
    dropped: int = 0

    @classmethod
    def empty(cls, pixels: int) -> Film:
        return cls(np.zeros(pixels, np.uint32))

    def add(self, planes: NDArray[np.float32], first_pixel: int, first_sample: int) -> None:
        """Adds a pass: planes is (samples, 3, pixels of the pass), for the pixels from `first_pixel` of the list on.

        A pixel's samples may come in any ranges, but in the same strips of pixels each time.
        """
        samples, _, pixels = planes.shape
        nodes = self.strips.setdefault(first_pixel, {})
        self.count[first_pixel : first_pixel + pixels] += np.uint32(samples)
        scratch = np.empty((samples.bit_length(), 2, 3, min(pixels, _BLOCK)))
        for level, index in node_keys(first_sample, samples):
            start = index << level
            run = planes[start - first_sample :][: 1 << level]
            sums = np.empty((2, 3, pixels))
            for pixel in range(0, pixels, _BLOCK):
                part = slice(pixel, pixel + _BLOCK)
                self._add_block(run[..., part], first_pixel + pixel, sums[..., part], scratch)
            _insert(nodes, level, index, sums, True)

    def _add_block(self, run: NDArray[np.float32], first_pixel: int, sums: Sums, scratch: NDArray[np.float64]) -> None:
        _tree_sums(run, sums, scratch[..., : run.shape[2]])
        if np.isfinite(sums).all():
            return
        finite = np.asarray(np.isfinite(run).all(axis=1))
        lost = (~finite).sum(axis=0, dtype=np.uint32)
        self.count[first_pixel : first_pixel + len(lost)] -= lost
        self.dropped += int(lost.sum())
        _tree_sums(np.where(finite[:, None], run, np.float32(0)), sums, scratch[..., : run.shape[2]])

    def merge(self, other: Film, *, reuse: bool = False) -> Film:
        """The film of both films' samples: the same pixels, and sample ranges that do not overlap.

        `reuse`: its sums may overwrite the other film's, which is of no use afterwards.
        """
        strips, starts = {}, sorted(self.strips)
        for first, theirs in (other.strips or {0: {}}).items():
            width = next((sums.shape[2] for sums in theirs.values()), len(self.count))
            strips[first] = self._part(starts, first, first + width)
            for (level, index), sums in theirs.items():
                _insert(strips[first], level, index, sums, reuse)
        return Film(self.count + other.count, strips, self.dropped + other.dropped)

    def _part(self, starts: list[int], first: int, end: int) -> Nodes:
        """The nodes of the pixels first … end − 1; not copies where these lie in one strip. `starts`: of the strips."""
        pieces: dict[tuple[int, int], list[Sums]] = {}
        for start in starts[max(bisect_right(starts, first) - 1, 0) : bisect_left(starts, end)]:
            for key, sums in self.strips[start].items():
                pieces.setdefault(key, []).append(sums[..., max(first - start, 0) : end - start])
        return {key: each[0] if len(each) == 1 else np.concatenate(each, axis=2) for key, each in pieces.items()}

    def nodes(self) -> Nodes:
        """The nodes of all strips together; not copies where there is one strip."""
        strips = [self.strips[first] for first in sorted(self.strips)]
        if len(strips) == 1:
            return strips[0]
        return {key: np.concatenate([nodes[key] for nodes in strips], axis=2) for key in (strips[0] if strips else ())}

    def totals(self) -> Sums:
        """(2, 3, pixels): sums of all samples and of their squares, the nodes added from the first sample on.

        Of a film that was filled only in part: the pixels of its first strips. Not a copy where there is one node.
        """
        parts = [_total(self.strips[first]) for first in sorted(self.strips)]
        if not parts:
            return np.zeros((2, 3, len(self.count)))
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=2)


def _total(nodes: Nodes) -> Sums:
    if len(nodes) == 1:
        return next(iter(nodes.values()))
    total = np.zeros_like(next(iter(nodes.values())))
    for key in sorted(nodes, key=lambda key: key[1] << key[0]):
        total += nodes[key]
    return total


def mean(sums: Sums, count: NDArray[np.uint32]) -> NDArray[np.float64]:
    """(3, pixels): the average of each pixel's samples; 0 where there are none."""
    return np.asarray(sums[0] / np.maximum(count, 1))


def variance(sums: Sums, count: NDArray[np.uint32]) -> NDArray[np.float64]:
    """(3, pixels): estimated variance of the mean as if the samples were independent. Stratification makes the true
    variance smaller, so this is an upper estimate. 0 with fewer than two samples."""
    n = np.maximum(count, 2).astype(np.float64)
    spread = np.maximum(sums[1] - sums[0] * sums[0] / n, 0.0)
    return np.where(count > 1, spread / (n * (n - 1)), 0.0)


@dataclass(frozen=True)
class Canvas:
    """A picture to be painted: of its pixels, row by row, mean and variance (pixels, 3), and number of samples."""

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    samples: NDArray[np.uint32]

    @classmethod
    def blank(cls, pixels: int) -> Canvas:
        mean, variance = np.zeros((2, pixels, 3), np.float32)
        return cls(mean, variance, np.zeros(pixels, np.uint32))

    def paint(self, places: NDArray[np.intp], sums: Sums, count: NDArray[np.uint32]) -> None:
        """Puts the pixels of `sums` (2, 3, k) where `places` (k,) says."""
        self.samples[places] = count
        for pixel in range(0, len(places), _BLOCK):
            part = slice(pixel, pixel + _BLOCK)
            self.mean[places[part]] = mean(sums[..., part], count[part]).T
            # its square may be more than float32 holds
            spread = np.minimum(variance(sums[..., part], count[part]), np.finfo(np.float32).max)
            self.variance[places[part]] = spread.T

    def picture(self, shape: tuple[int, int]) -> Picture:
        """Mean and variance, (*shape, 3), and number of samples of each pixel."""
        return self.mean.reshape(*shape, 3), self.variance.reshape(*shape, 3), self.samples.reshape(shape)


def picture(sums: Sums, count: NDArray[np.uint32], order: NDArray[np.intp], shape: tuple[int, int]) -> Picture:
    """As `Canvas.picture`, of the pixels of a list; `order`: where in it each pixel stands."""
    canvas, places = Canvas.blank(len(count)), np.empty_like(order)
    places[order] = np.arange(len(order))
    canvas.paint(places, sums, count)
    return canvas.picture(shape)


def node_keys(first: int, count: int) -> Iterator[tuple[int, int]]:
    """(level, index) of the fewest nodes that make up a range of samples, in its order."""
    end = first + count
    while first < end:
        level = (end - first).bit_length() - 1
        while first & ((1 << level) - 1):
            level -= 1
        yield level, first >> level
        first += 1 << level


def _tree_sums(run: NDArray[np.float32], sums: Sums, scratch: NDArray[np.float64]) -> None:
    """Stores the node of 2^k samples (2^k, 3, pixels); scratch is (k or more, 2, 3, pixels)."""
    half = len(run) // 2
    if half and run.size > 3 * _BLOCK:
        _tree_sums(run[:half], sums, scratch[1:])
        _tree_sums(run[half:], scratch[0], scratch[1:])
        sums += scratch[0]
        return
    work = sums[:, None] if half == 0 else np.empty((2, *run.shape))
    work[0] = run
    np.multiply(work[0], work[0], out=work[1])
    for step in (1 << k for k in range(half.bit_length())):
        work[:, :: 2 * step] += work[:, step :: 2 * step]
    if half:
        sums[...] = work[:, 0]


def _insert(nodes: Nodes, level: int, index: int, sums: Sums, reuse: bool) -> None:
    """Adds a node, whose array may be overwritten if `reuse`; those of the other nodes are not."""
    while (sibling := nodes.pop((level, index ^ 1), None)) is not None:
        # which of the two is the left one makes no difference to a sum of two
        sums, reuse = np.add(sums, sibling, out=sums if reuse else None), True
        level, index = level + 1, index >> 1
    nodes[level, index] = sums
