"""The stratified average: sums of samples in float64, in sample order, whatever the passes were."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

_BLOCK = 8192  # pixels summed at a time, so that the sums stay in cache


@dataclass
class Film:
    """Running sums for a list of pixels. Planes are (3, pixels).

    Each pixel's samples are added one after another in float64, so the result does not depend on how many passes they
    came in. Samples that are not finite are left out and counted.
    """

    total: NDArray[np.float64]
    squares: NDArray[np.float64]
    count: NDArray[np.uint32]  # (pixels,)
    dropped: int = 0

    @classmethod
    def empty(cls, pixels: int) -> Film:
        return cls(np.zeros((3, pixels)), np.zeros((3, pixels)), np.zeros(pixels, np.uint32))

    def add(self, planes: NDArray[np.float32], first: int) -> None:
        """Adds a pass: planes is (samples, 3, pixels of the pass), the pass starting at pixel `first` of the list."""
        samples, _, pixels = planes.shape
        for start in range(0, pixels, _BLOCK):
            block = planes[:, :, start : start + _BLOCK]
            where = slice(first + start, first + start + block.shape[2])
            total, squares = self.total[:, where], self.squares[:, where]
            before = total.copy(), squares.copy()
            _accumulate(block, total, squares)
            if np.isfinite(squares).all():
                self.count[where] += np.uint32(samples)
            else:
                total[...], squares[...] = before
                self._add_finite(block, where)

    def _add_finite(self, block: NDArray[np.float32], where: slice) -> None:
        finite: NDArray[np.bool_] = np.asarray(np.isfinite(block).all(axis=1))
        _accumulate(np.where(finite[:, None], block, 0.0), self.total[:, where], self.squares[:, where])
        self.count[where] += finite.sum(axis=0, dtype=np.uint32)
        self.dropped += int((~finite).sum())

    def mean(self) -> NDArray[np.float64]:
        """(3, pixels): the average of each pixel's samples; 0 where there are none."""
        return self.total / np.maximum(self.count, 1)

    def variance(self) -> NDArray[np.float64]:
        """(3, pixels): estimated variance of the mean as if the samples were independent. Stratification makes the true
        variance smaller, so this is an upper estimate. 0 with fewer than two samples."""
        n = np.maximum(self.count, 2).astype(np.float64)
        spread = np.maximum(self.squares - self.total * self.total / n, 0.0)
        return np.where(self.count > 1, spread / (n * (n - 1)), 0.0)


def _accumulate(block: NDArray[np.float32], total: NDArray[np.float64], squares: NDArray[np.float64]) -> None:
    sample = np.empty(total.shape)
    for plane in block:
        sample[...] = plane
        total += sample
        np.multiply(sample, sample, out=sample)
        squares += sample
