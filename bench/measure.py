"""Error of a picture, time to an error, and timing that a noisy machine cannot turn around."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

TRIM = 1e-3  # share of the values that silhouettes of lights may spoil
DARK = 0.01  # added to the squared reference, so that black pixels do not decide


@dataclass(frozen=True)
class Error:
    """Of a picture against a reference: the trimmed relative mean squared error, and the plain root mean square."""

    relmse: float
    rmse: float


def squared_errors(image: ArrayLike, reference: ArrayLike) -> NDArray[np.float64]:
    """(x − ref)² / (ref² + 0.01) for each value, in the shape of the pictures."""
    x, ref = np.asarray(image, np.float64), np.asarray(reference, np.float64)
    return np.asarray((x - ref) ** 2 / (ref**2 + DARK))


def error(image: ArrayLike, reference: ArrayLike) -> Error:
    """The error of a picture (height, width, 3); relMSE leaves out the worst 0.1 % of the values."""
    values = np.sort(squared_errors(image, reference), axis=None)
    kept = values[: len(values) - int(TRIM * len(values))]
    rmse = np.sqrt(np.mean((np.asarray(image, np.float64) - np.asarray(reference, np.float64)) ** 2))
    return Error(float(kept.mean()), float(rmse))


def seconds_to(target: float, errors: Sequence[float], seconds: Sequence[float]) -> float | None:
    """Time after which a ladder of (error, seconds) first reaches the target, by interpolation of the logarithms.

    The seconds of the first rung where that is good enough already (an upper bound); None where no rung is.
    """
    rungs = sorted(zip(seconds, errors, strict=True))
    if not rungs or not min(errors) <= target:
        return None
    if rungs[0][1] <= target:
        return rungs[0][0]
    for (t0, e0), (t1, e1) in pairwise(rungs):
        if e1 <= target:
            share = math.log(e0 / target) / math.log(e0 / max(e1, 1e-300))
            return math.exp(math.log(t0) + share * math.log(t1 / t0))
    raise AssertionError("unreachable: the least error is below the target")


def geometric_mean(values: Sequence[float]) -> float:
    return statistics.geometric_mean(values) if values else math.nan


def interleaved(
    jobs: Mapping[Any, Callable[[int], Any]], repeats: int, done: Callable[[Any, Any], None]
) -> dict[Any, list[float]]:
    """Seconds of every job, `repeats` times each, in turn (A B A B …) so that a slow minute slows all of them.

    A job gets the number of the repetition; before the first, each runs once untimed. `done` gets its name and result.
    """
    for job in jobs.values():
        job(repeats)
    seconds: dict[Any, list[float]] = {name: [] for name in jobs}
    for repetition in range(repeats):
        for name, job in jobs.items():
            start = perf_counter()
            result = job(repetition)
            seconds[name].append(perf_counter() - start)
            done(name, result)
    return seconds


def paired_ratio(ours: Sequence[float], theirs: Sequence[float]) -> float:
    """Median over the repetitions of theirs / ours: above 1 we are faster."""
    return statistics.median(b / a for a, b in zip(ours, theirs, strict=True))
