"""The sample points: exact stratification, independence of pixels, pairs and seeds, convergence, and the warps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray

from tests.device.probe import evaluate, sobol_points
from tests.reference.analytic import Array
from tests.reference.statistics import threshold

ALPHA = 1e-3
PAIRS = range(24)  # the camera's, two of each light, and one of each specular event


def hashes(count: int, seed: int = 0) -> NDArray[np.uint32]:
    return np.random.default_rng(seed).integers(0, 2**32, count, dtype=np.uint32)


def pixel_hashes(width: int, height: int) -> NDArray[np.uint32]:
    """What render.cl gives neighbouring pixels, row by row."""
    y, x = np.mgrid[0:height, 0:width].astype(np.uint32)
    code = "hash[i] = hash_uint(pixel[i] ^ hash_uint(0x51633e2du));"
    pixels = (x | (y << np.uint32(16))).ravel()
    return evaluate("sampling.h", code, pixels.size, {"hash": np.uint32}, pixel=pixels)["hash"]


# Exactness ------------------------------------------------------------------------------------------------------------


def test_unit_float_is_below_one():
    strided, last = np.arange(0, 2**32, 65_521), np.arange(2**32 - 1000, 2**32)
    bits = np.concatenate([strided, last]).astype(np.uint32)
    y = evaluate("sampling.h", "y[i] = unit_float(bits[i]);", len(bits), {"y": np.float32}, bits=bits)["y"]
    assert (y == (bits >> np.uint32(8)) * 2.0**-24).all()
    assert y.max() == 1 - 2.0**-24
    assert np.float32(2**32 - 1) * np.float32(2.0**-32) == 1  # what it protects from


def test_second_coordinate_is_sobols():
    """Direction numbers of the primitive polynomial x + 1: m_k = 2 m_{k−1} xor m_{k−1}."""
    index = np.concatenate([np.arange(8, dtype=np.uint32), hashes(1000)])
    truth, m = np.zeros_like(index), 1
    for bit in range(32):
        truth ^= np.where((index >> np.uint32(bit)) & np.uint32(1), np.uint32(m << (31 - bit)), np.uint32(0))
        m = (m << 1) ^ m
    code = "y[i] = reverse_bits(sobol_second_reversed(index[i]));"
    y = evaluate("sampling.h", code, len(index), {"y": np.uint32}, index=index)["y"]
    assert (y == truth).all()
    assert (y[:8] / 2.0**32 == [0, 0.5, 0.75, 0.25, 0.625, 0.125, 0.375, 0.875]).all()


def is_stratified(points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """(pixels,): each of 2^k points (pixels, 2^k, 2) is alone in its cell of every grid of 2^a × 2^(k−a) cells."""
    samples = points.shape[1]
    good = np.ones(len(points), bool)
    for columns in 2 ** np.arange(samples.bit_length()):
        rows = samples // columns
        cell = (points[..., 0] * columns).astype(int) * rows + (points[..., 1] * rows).astype(int)
        good &= (np.sort(cell, axis=1) == np.arange(samples)).all(axis=1)
    return good


@pytest.mark.parametrize("pair", PAIRS)
def test_every_aligned_block_is_stratified(pair):
    """Sizes 2 … 1024, blocks at the start and far into the sequence."""
    for size, block in [(2, 0), (4, 3), (16, 0), (64, 1), (256, 2**16), (1024, 0), (1024, 2**21)]:
        assert is_stratified(sobol_points(hashes(32, pair), pair, size, size * block)).all()


def test_unaligned_blocks_are_not_stratified():
    assert not is_stratified(sobol_points(hashes(32), 0, 64, 32 + 16)).any()


# Independence ---------------------------------------------------------------------------------------------------------


def correlation(a: Array, b: Array) -> float:
    """Score of the correlation of n pairs of uniform numbers, standard normal if there is none."""
    return float(12 * ((a - 0.5) * (b - 0.5)).sum() / np.sqrt(a.size))


def chi2_score(counts: Array, expected: Array) -> float:
    """Pearson's χ² as a standard normal score (Wilson and Hilferty 1931)."""
    freedom = counts.size - 1
    chi2 = ((counts - expected) ** 2 / expected).sum()
    return float(((chi2 / freedom) ** (1 / 3) - 1 + 2 / (9 * freedom)) / np.sqrt(2 / (9 * freedom)))


def test_one_point_of_many_pixels_is_uniform():
    """Owen's scrambling makes each point uniform over the square: χ² of 32 × 32 cells over 2^18 neighbouring pixels."""
    for pair, index in [(0, 0), (0, 1), (1, 0), (7, 5)]:
        points = sobol_points(pixel_hashes(512, 512), pair, 1, index)[:, 0]
        counts, *_ = np.histogram2d(points[:, 0], points[:, 1], 32, [[0, 1], [0, 1]])
        assert abs(chi2_score(counts.ravel(), np.full(1024, len(points) / 1024))) < threshold(4, ALPHA)


@pytest.mark.parametrize("step", [1, 512])
def test_neighbouring_pixels_are_uncorrelated(step):
    points = sobol_points(pixel_hashes(512, 512), 1, 1).astype(float)[:, 0]
    scores = [correlation(points[:-step, a], points[step:, b]) for a in (0, 1) for b in (0, 1)]
    assert np.abs(scores).max() < threshold(4, ALPHA)


def test_pairs_are_uncorrelated():
    """Over many pixels the samples of two pairs show no common order, neither on average nor in the single pixel."""
    sets = [sobol_points(hashes(4096), pair, 16).astype(float) for pair in range(6)]
    scores = [
        correlation(first[..., a], second[..., b])
        for i, first in enumerate(sets)
        for second in sets[:i]
        for a in (0, 1)
        for b in (0, 1)
    ]
    assert np.abs(scores).max() < threshold(len(scores), ALPHA)


def test_pairs_are_shuffled_as_if_by_random_bits():
    """The correlation of two pairs within a pixel varies from pixel to pixel as under true Owen scrambling, ± 4σ."""
    first, second = (np.argsort(np.argsort(sobol_points(hashes(8192), p, 16)[..., 0], 1), 1) for p in (1, 2))
    rng = np.random.default_rng(0)
    found, ideal = rank_correlation(first, second), rank_correlation(ideal_ranks(8192, rng), ideal_ranks(8192, rng))
    assert abs((found**2).mean() - (ideal**2).mean()) < 4 * np.sqrt(((found**2).var() + (ideal**2).var()) / 8192)
    assert rank_correlation(first, first).min() > 1 - 1e-12  # a pair with itself


def rank_correlation(a: Array, b: Array) -> Array:
    return ((a - 7.5) * (b - 7.5)).sum(1) / ((np.arange(16) - 7.5) ** 2).sum()


def ideal_ranks(pixels: int, rng: np.random.Generator) -> NDArray[np.intp]:
    """Order in x of the 16 samples of each pixel: bits reversed between two scrambles."""
    reverse = [int(f"{i:04b}"[::-1], 2) for i in range(16)]
    index = np.broadcast_to(np.arange(16), (pixels, 16))
    return owen_scramble(np.take(reverse, owen_scramble(index, rng)), rng)


def owen_scramble(x: NDArray[np.intp], rng: np.random.Generator) -> NDArray[np.intp]:
    """4-bit numbers, each bit flipped by a random bit of its own for every value of the bits above it."""
    flips = rng.integers(0, 2, (len(x), 16))
    out = np.zeros_like(x)
    for bit in (3, 2, 1, 0):
        above = (x | 16) >> (bit + 1)
        out |= ((x >> bit & 1) ^ np.take_along_axis(flips, above, 1)) << bit
    return out


# Convergence ----------------------------------------------------------------------------------------------------------

INTEGRANDS: dict[str, tuple[Callable[[Array, Array], Array], float, float]] = {
    "smooth": (lambda x, y: np.exp(x * y), 1.3179021514544038, -1.3),
    "slanted step": (lambda x, y: (y > 0.3 + 0.37 * x).astype(float), 0.515, -0.72),
    "disc": (lambda x, y: (x * x + y * y < 1).astype(float), np.pi / 4, -0.72),
    "corner": (lambda x, y: ((y > 0.3 + 0.37 * x) & (y > 0.9 - 0.81 * x)).astype(float), 0.36245762711864404, -0.72),
}


def slope(points: NDArray[np.float32], f: Callable[[Array, Array], Array], truth: float) -> float:
    """Exponent of the RMSE over the pixels in the number of samples, 2^4 … 2^12."""
    values = f(*np.moveaxis(points.astype(float), 2, 0))
    counts = 2 ** np.arange(4, 13)
    rmse = [np.sqrt(((values[:, :n].mean(1) - truth) ** 2).mean()) for n in counts]
    return float(np.polyfit(np.log(counts), np.log(rmse), 1)[0])


@pytest.mark.parametrize("name", INTEGRANDS)
def test_error_falls_faster_than_random(name):
    f, truth, limit = INTEGRANDS[name]
    assert slope(sobol_points(hashes(512), 3, 4096), f, truth) < limit
    random = np.random.default_rng(0).random((512, 4096, 2), np.float32)
    assert abs(slope(random, f, truth) + 0.5) < 0.03  # what independent samples do
