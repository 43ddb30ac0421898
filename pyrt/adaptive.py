"""Adaptive sampling: pixels get samples until the picture's estimated error is small enough, or a limit is reached.

All pixels begin with 16 samples. Then those whose error, pooled over 3×3 pixels, is above the target double their
samples, again and again. A pixel's error is estimated by comparing its two halves, each a stratified point set of its
own: half their difference, squared, is the variance of their mean if they err independently. Halves of one Sobol'
sequence rather compensate each other, which makes the estimate too high; a pixel whose first samples all miss a detail
makes it too low, and the more so the tighter the target is.

Which pixels go on depends on the samples that they already have, so the picture is not strictly unbiased; the bias is
small because the decision pools nine pixels. A fixed number of samples has no such bias.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.film import Film
from pyrt.partial import DONE, SETTLED, WAITING, Adaptive

FIRST_SAMPLES = 16
_PART = 1 << 26  # samples between two chances to save
_RADIANCE_FLOOR = 0.01  # squared; below a tenth, errors count in absolute terms

Trace = Callable[[NDArray[np.uint32], int, int], tuple[Film, int]]


@dataclass(frozen=True)
class Refined:
    """The samples of all pixels of a list together.

    Attributes:
        sums: (2, 3, pixels) float64, of samples and of their squares.
        count: (pixels,) uint32, samples of each pixel.
        noise: estimated relative error of the picture, root mean square; None if not even the first round was complete.
        dropped: samples that were not finite.
    """

    sums: NDArray[np.float64]
    count: NDArray[np.uint32]
    noise: float | None
    dropped: int


def refine(
    trace: Trace,
    pixels: NDArray[np.uint32],
    state: Adaptive,
    noise: float,
    max_samples: int,
    going: Callable[[], bool],
    note: Callable[[float], None],
    save: Callable[[], object],
) -> Refined:
    """Traces pixels (x + 65536 · y) until the picture's error is at most `noise`, or each has `max_samples`.

    `trace(pixels, first sample, samples)` gives a film and how many pixels are complete; fewer than asked for ends it.
    So does `going` by returning False. `note` is told the picture's squared relative error whenever that is estimated
    anew. `save` may keep the `state`, from which a later call goes on to the same bits.
    """
    half = min(FIRST_SAMPLES, max_samples + 1) // 2
    while going():
        if state.samples > half and not (state.stage == DONE).any():  # between rounds
            note(float(state.error.mean()))
            if state.error.mean() <= noise * noise:
                break
            state.stage[_pooled(pixels, state.error) <= noise * noise] = SETTLED
        step = state.samples or half
        waiting = np.flatnonzero(state.stage == WAITING)[: max(1, _PART // step)]
        if not len(waiting) or state.samples + step > max_samples:
            break
        film, complete = trace(pixels[waiting], state.samples, step)
        _add(state, waiting[:complete], film)
        if not (state.stage == WAITING).any():
            state.samples += step
            state.stage[state.stage == DONE] = WAITING
        save()
    return summary(state)


def summary(state: Adaptive) -> Refined:
    """What the state holds."""
    known = state.error[np.isfinite(state.error)]
    return Refined(state.sums, state.count, float(np.sqrt(known.mean())) if len(known) else None, state.dropped)


def _add(state: Adaptive, done: NDArray[np.intp], film: Film) -> None:
    """Adds the film's first pixels to the state's pixels `done`, which begins and ends with the marks of that."""
    new, new_count = film.totals()[:, :, : len(done)], film.count[: len(done)]
    if state.samples:
        error = _squared_error(state.sums[0][:, done], state.count[done], new[0], new_count)
    state.torn = True
    if state.samples:
        state.error[done] = error
    state.sums[:, :, done] += new
    state.count[done] += new_count
    state.dropped += film.dropped
    state.stage[done] = DONE
    state.torn = False


def _squared_error(
    old: NDArray[np.float64], old_count: NDArray[np.uint32], new: NDArray[np.float64], new_count: NDArray[np.uint32]
) -> NDArray[np.float64]:
    """Estimated squared relative error of the mean of both halves, averaged over channels. Sums are (3, pixels)."""
    a, b = old / np.maximum(old_count, 1), new / np.maximum(new_count, 1)
    mean = 0.5 * (a + b)
    return np.asarray((0.25 * (a - b) ** 2 / (mean * mean + _RADIANCE_FLOOR)).mean(axis=0))


def _pooled(pixels: NDArray[np.uint32], error: NDArray[np.float64]) -> NDArray[np.float64]:
    """Each pixel's average error over itself and its neighbours in the picture."""
    y, x = (pixels >> 16).astype(np.intp) + 1, (pixels & 0xFFFF).astype(np.intp) + 1
    total = np.zeros((int(y.max()) + 2, int(x.max()) + 2))
    weight = np.zeros_like(total)
    total[y, x], weight[y, x] = error, 1.0
    for axis in (0, 1):
        total = total + np.roll(total, 1, axis) + np.roll(total, -1, axis)
        weight = weight + np.roll(weight, 1, axis) + np.roll(weight, -1, axis)
    return np.asarray(total[y, x] / weight[y, x])
