"""Is a rendered picture the truth plus noise? Scores in standard deviations, and how large the largest may be."""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

ROUNDING = 2e-6  # relative: float32 geometry and shading of one sample; far below every effect that the tests look for


@dataclass(frozen=True)
class Estimate:
    """An unbiased estimate and the variance of that estimate, both of the same shape."""

    mean: Array
    variance: Array


def threshold(count: int, alpha: float = 1e-3) -> float:
    """Bound on the largest |z| among `count` scores that holds with probability 1 − alpha (Bonferroni)."""
    return NormalDist().inv_cdf(1 - alpha / (2 * count))


def z_scores(estimate: Estimate, truth: Estimate | ArrayLike, rounding: float = ROUNDING) -> Array:
    """(estimate − truth) in standard deviations of both; `rounding` · |truth| counts as one more."""
    known = truth if isinstance(truth, Estimate) else Estimate(np.asarray(truth, float), np.zeros(()))
    difference = np.asarray(estimate.mean, float) - known.mean
    deviation = np.sqrt(estimate.variance + known.variance + (rounding * known.mean) ** 2)
    return np.divide(difference, deviation, out=np.where(difference == 0, 0.0, np.inf), where=deviation > 0)


def replicate(samples: Array) -> Estimate:
    """Estimate from k independent replicates (k, ...): their mean, and the variance that they themselves show."""
    return Estimate(samples.mean(0), samples.var(0, ddof=1) / len(samples))


def gaussian(t: ArrayLike, freedom: int) -> Array:
    """The standard normal score as improbable as Student's t with `freedom` degrees (Wallace 1959, within 1 %)."""
    t = np.asarray(t, float)
    scale = (8 * freedom + 1) / (8 * freedom + 3)
    return np.asarray(np.sign(t) * scale * np.sqrt(freedom * np.log1p(t**2 / freedom)))


def assert_agrees(scores: Array, alpha: float = 1e-3) -> None:
    """Fail if the largest |score| would occur by chance with probability below alpha, and say where it is."""
    worst = np.unravel_index(np.argmax(np.abs(scores)), scores.shape)
    limit = threshold(scores.size, alpha)
    place = tuple(int(i) for i in worst)
    assert np.abs(scores[worst]) < limit, f"|z| = {abs(scores[worst]):.2f} at {place}, expected < {limit:.2f}"
