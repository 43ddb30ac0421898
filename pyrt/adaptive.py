"""Adaptive sampling: samples go where they lower the picture's error most, until it is small enough or a limit comes.

Every pixel begins with 2 samples. Then, round by round, pixels double theirs. When they do, the two halves of the
samples tell how the error fell: halves of a scrambled Sobol' sequence are alike in distribution, so a quarter of their
squared difference is on average the variance of a half less that of the whole. With d the share of the variance that
each doubling leaves, measured for each class of pixels (see kernels/classify.h), the whole's variance is d / (1 − d)
times as much. From 8 samples on this is averaged with what the estimate for half as many lets expect: along an edge
that follows the pixels' grid, the halves may agree in all pixels.

Which pixels go on: those where doubling lowers the variance most per sample (Neyman's optimal allocation), as many as
the target needs. A pixel's variance is estimated for that from other pixels of its class nearby, never from itself. So
its own samples have no say in their number, its mean has no bias, and the stated error has none from choosing. All
that they influence is when the picture as a whole is good enough, and averages over all pixels of a class.

The bias that this leaves, root mean square over the pixels, was measured as a tenth of the stated error or less in
pictures of 24×24 pixels, and of the picture's mean a hundredth (tests/render/test_adaptive.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.film import Film, Sums
from pyrt.guide import GAIN_BINS, GAIN_STEPS, LOW_GAIN, Guide
from pyrt.partial import Adaptive

FIRST_SAMPLES = 2
STEADY_LEVEL = 3  # from which on errors are averaged with what the halves' errors let expect
_DEVIATIONS = 3.0  # by which a noisy pixel may be off
_NOISY = 0.01  # squared relative error of a pixel whose own radiance cannot be relied on
_PART = 1 << 26  # samples between two chances to save
_BLOCK = 8192  # pixels added at a time, so that they stay in cache
RADIANCE_FLOOR = 0.01  # squared; below a tenth, errors count in absolute terms
_LEAST_DECAY = (0.125, 0.125, 0.125, 0.125, 0.35)  # by class; lights' edges are edges, whose errors fall as n^−1.5
_MOST_DECAY = 0.5  # of independent samples
_DECAY_PIXELS = 30  # that a class must have, to measure it
_SHARPEN = 0.25  # of the squared error: what a round aims at if there is no target
_AIM = 0.75  # of the squared target: what a round aims at, or else many would do ever less
_LEAST_LEVEL = (1, 3, 2, 2, 5)  # by class; a light may fill little of its edges' pixels and be most of what they show
_PASS_COST = 4096  # samples that take as long as a pass of few samples

Trace = Callable[[NDArray[np.intp], int, int], None]


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
    guide: Guide,
    state: Adaptive,
    noise: float,
    max_samples: int,
    going: Callable[[], bool],
    note: Callable[[float], None],
    save: Callable[[], object],
) -> Refined:
    """Traces the state's pixels until the picture's error is at most `noise`, or each has more than half of
    `max_samples`, as each has a power of two of them. 0 for `noise` is no target.

    `trace(group, first sample, samples)` adds samples of a group of pixels to the state.
    `going` ends it by returning False. `note` is told the picture's squared relative error whenever that is estimated
    anew. `save` may keep the `state`, from which a later call goes on to the same bits.
    """
    top = max_samples.bit_length() - 1
    while going():
        group = _next_group(state)
        if len(group):
            level, wanted = int(state.level[group[0]]), int(state.wanted[group[0]])
            first = 1 << level if level else 0
            trace(group, first, min(1 << wanted, max_samples) - first)
            save()
            continue
        _settle(state)
        error = squared_error(state)
        note(error)
        doublings = _second_doubling(state, top)
        if not doublings.any():
            if top < 1 or error <= noise * noise:
                break
            doublings = _doublings(state, guide, noise * noise, top)
            if not doublings.any():
                break
        state.wanted = state.level + doublings
    return summary(state)


def squared_error(state: Adaptive) -> float:
    """Of the picture, relative: the estimated mean over its pixels; infinite before all have two samples."""
    errors = _errors(state)
    mean, noisy = errors.mean(), np.flatnonzero(errors > _NOISY)
    if np.isfinite(mean) and len(noisy):
        mean += ((_dimmers(state, noisy, errors[noisy]) - 1) * errors[noisy]).sum() / len(errors)
    return float(mean)


def _errors(state: Adaptive) -> NDArray[np.float64]:
    """Of each pixel, squared, and relative to its own radiance."""
    return np.asarray(state.error * (state.decay / (1 - state.decay))[state.classes])


def _dimmers(state: Adaptive, noisy: NDArray[np.intp], errors: NDArray[np.float64]) -> NDArray[np.float64]:
    """The factors to errors relative to the true radiance, of noisy pixels.

    A pixel that is too bright by chance hides its error behind its brightness. So it is held against a mean of itself
    and of the median of its tile of 16 pixels, weighted by how much the others differ and by how noisy it is (as in
    Lee's filter, 1980), or what its own error allows next to that.
    """
    tiles = np.minimum(noisy[:, None] // 16 * 16 + np.arange(16), len(state.count) - 1)
    radiance = state.sums[0].mean(axis=0)[tiles] / np.maximum(state.count, 1)[tiles]
    own = state.sums[0].mean(axis=0)[noisy] / np.maximum(state.count, 1)[noisy]
    others = (radiance.sum(axis=1) - own) / 15
    spread = np.maximum((radiance * radiance).sum(axis=1) - own * own - 15 * others * others, 0) / 15
    noise = errors * (own * own + RADIANCE_FLOOR)
    slack = _DEVIATIONS * np.sqrt(noise)
    likely = (spread * own + noise * np.median(radiance, axis=1)) / (spread + noise)
    likely = np.clip(likely, own - slack, own + slack)
    return np.asarray((own * own + RADIANCE_FLOOR) / (likely * likely + RADIANCE_FLOOR))


def summary(state: Adaptive) -> Refined:
    """What the state holds."""
    error = squared_error(state)
    return Refined(state.sums, state.count, float(np.sqrt(error)) if np.isfinite(error) else None, state.dropped)


def _next_group(state: Adaptive) -> NDArray[np.intp]:
    """Pixels that wait for the same samples, whole beams of them at first; none if the round is done."""
    waiting = np.flatnonzero(state.level < state.wanted)
    if not len(waiting):
        return waiting
    kinds = state.level[waiting] * np.uint16(64) + state.wanted[waiting]
    kind = int(kinds.min())
    beams = max(1, (_PART >> (kind & 63)) // 16)
    return np.asarray(waiting[kinds == kind][: beams * 16])


def add(state: Adaptive, done: NDArray[np.intp], film: Film) -> None:
    """Adds the film's first pixels to the state's pixels `done`: what `Guide.refine` does on devices that can."""
    nodes = film.nodes()
    order = sorted(nodes, key=lambda node: node[1] << node[0])
    state.torn = True
    for first in range(0, len(done), _BLOCK):
        block = done[first : first + _BLOCK]
        _add_block(state, block, [(*node, nodes[node][:, :, first : first + len(block)]) for node in order])
    state.level[done] = state.wanted[done]
    state.count[done] += film.count[: len(done)]
    state.dropped += film.dropped
    state.torn = False


def _add_block(state: Adaptive, done: NDArray[np.intp], nodes: list[tuple[int, int, Sums]]) -> None:
    """Adds nodes (level, index, sums) of a film, each of which doubles the samples that the pixels `done` had."""
    classes, error = state.classes[done].astype(np.intp), state.error[done]
    sums = state.sums.take(done, axis=2)
    for level, index, new in nodes:
        before = error
        if index:
            error = _relative(((sums[0] - new[0]) / (2 << level)) ** 2, (sums[0] + new[0]) / (2 << level))
            for row, weights in zip(state.falls, (before, error, None), strict=True):
                row += np.bincount(classes, weights, len(row))
            if level + 1 >= STEADY_LEVEL:
                error = (error + state.decay[classes] * before) / 2
        elif level:
            mean = new[0] / 2  # from a + b and a² + b²: (a − b)² / 4
            error = _relative(np.maximum(new[1] / 2 - mean * mean, 0.0), mean)
        sums = sums + new
    for plane, values in zip(state.sums.reshape(6, -1), sums.reshape(6, -1), strict=True):
        plane[done] = values  # twice as fast as all planes at once
    state.error[done] = error


def _relative(squared: NDArray[np.float64], mean: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, pixels) to (pixels,): relative to the radiance, averaged over channels."""
    return np.asarray((squared / (mean * mean + RADIANCE_FLOOR)).mean(axis=0))


def _settle(state: Adaptive) -> None:
    """Ends a round: takes what it tells of how errors fall."""
    before, after, counted = state.falls
    known = (counted >= _DECAY_PIXELS) & (before > 0)
    measured = np.clip(after[known] / before[known], np.array(_LEAST_DECAY)[known], _MOST_DECAY)
    # Every other doubling of a Sobol' sequence helps more. Rounded, as the last bits of sums tell where a render was
    # interrupted.
    state.decay[known] = np.round(np.sqrt(state.decay[known] * measured), 6)
    state.falls[:] = 0


def _second_doubling(state: Adaptive, top: int) -> NDArray[np.uint8]:
    """2 samples tell too little of what is not plain."""
    least = np.minimum(_LEAST_LEVEL, top).astype(np.uint8)[state.classes]
    return np.maximum(least, state.level) - state.level


def _doublings(state: Adaptive, guide: Guide, target: float, top: int) -> NDArray[np.uint8]:
    """How often each pixel doubles its samples next: half as often as the target seems to need, so that what looks good
    or bad by chance is looked at again on the way. No pixel gets more than 2^top samples. Where the target is met but
    for what hides behind brightness, or there is none, a quarter of the squared error is aimed at.

    Pixels of the same class, level and gain (by which their variance falls for each sample of the next doubling) are
    alike: all but that gain is a matter of their numbers.
    """
    error = float(_errors(state).mean())
    target = _AIM * target if error > target else _SHARPEN * error
    levels = np.arange(int(state.level.max()) + 1)
    decay, samples = state.decay[:, None], np.exp2(levels)
    factors = samples ** -np.log2(decay)  # the variance of n samples falls as their inverse
    kinds = state.classes * np.uint8(len(levels)) + state.level
    sums = np.bincount(kinds, state.error, factors.size).reshape(factors.shape)
    means = (sums * factors).sum(axis=1) / np.maximum(np.bincount(state.classes, None, len(decay)), 1)
    # decay / (1 − decay) of the error is variance, and 1 − decay of this falls
    shifts = np.log2(decay / (samples * factors))
    tables = (array.astype(np.float32) for array in (factors, means, shifts))
    keys = guide.gains(state.error.astype(np.float32), kinds, *tables)

    pixels = np.bincount(keys, None, factors.size * GAIN_BINS).reshape(*factors.shape, GAIN_BINS)
    gains = LOW_GAIN + (np.arange(GAIN_BINS) + 0.5) / GAIN_STEPS
    variance = pixels * np.exp2(gains) * (samples / (1 - decay))[..., None]
    scale = error * len(keys) / variance.sum()
    variance *= scale
    gains += np.log2(scale)
    least = _least_gain(gains, variance.sum(axis=1), decay, target * len(keys))
    steps = np.ceil(np.maximum(gains - least, 0) / (1 - np.log2(decay)))[:, None]
    doublings = np.minimum((steps + 1) // 2, (top - levels)[:, None]).astype(np.uint8)
    doublings[~_worth_tracing(doublings, variance, pixels, decay, 2.0**least)] = 0
    return np.asarray(doublings.ravel()[keys])


def _least_gain(
    gains: NDArray[np.float64], variance: NDArray[np.float64], decay: NDArray[np.float64], target: float
) -> float:
    """The logarithm of the gain at which pixels stop if their variances, (classes, gains), are to sum up to the target.

    A doubling leaves `decay` of a pixel's variance, and half as much of its gain.
    """

    def reached(least: float) -> bool:
        doublings = np.ceil(np.maximum(gains - least, 0) / (1 - np.log2(decay)))
        return float((variance * decay**doublings).sum()) <= target

    least, step = float(gains[-1]), 64.0
    while step >= 1 / GAIN_STEPS:
        least -= 0.0 if reached(least - step) else step
        step /= 2
    return least - 1 / GAIN_STEPS


def _worth_tracing(
    doublings: NDArray[np.uint8],
    variance: NDArray[np.float64],
    pixels: NDArray[np.intp],
    decay: NDArray[np.float64],
    least: float,
) -> NDArray[np.bool_]:
    """Which kinds of pixels belong to a group, traced together, that gains `least` per sample even if what a pass costs
    counts too; at least one group. Arrays are (classes, levels, gains), of single pixels but `variance`."""
    level = np.arange(doublings.shape[1])[:, None]
    group = (level * 64 + doublings).ravel()
    gain = np.bincount(group, (variance * (1 - decay[..., None] ** doublings)).ravel())
    samples = np.bincount(group, (pixels * np.exp2(level) * (np.exp2(doublings) - 1)).ravel())
    worth = np.where(samples > 0, gain / (samples + _PASS_COST), 0)
    return np.asarray((worth >= min(least, worth.max()))[group].reshape(doublings.shape))
