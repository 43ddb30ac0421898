"""Boxes of primitives, ordinary and hard ones, for the tests of tree builders."""

from __future__ import annotations

import numpy as np

Boxes = tuple[np.ndarray, np.ndarray]  # low, high (n, 3) float32


def triangles(count: int, size: float, seed: int = 0) -> Boxes:
    rng = np.random.default_rng(seed)
    corners = rng.uniform(-1, 1, (count, 1, 3)) + size * rng.normal(size=(count, 3, 3))
    return corners.min(axis=1).astype(np.float32), corners.max(axis=1).astype(np.float32)


def needles(count: int) -> Boxes:
    rng = np.random.default_rng(1)
    centers, reach = rng.uniform(-1, 1, (count, 3)), np.abs(rng.normal(size=(count, 3))) ** 3 * 0.02
    return (centers - reach).astype(np.float32), (centers + reach).astype(np.float32)


def sphere(count: int) -> Boxes:
    """Small boxes on a sphere, in the order of a spiral."""
    z = np.linspace(-1, 1, count)
    angle = np.arange(count) * np.pi * (3 - 5**0.5)
    r = np.sqrt(1 - z * z)
    centers = np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)
    return (centers - count**-0.5).astype(np.float32), (centers + count**-0.5).astype(np.float32)


def nested(count: int) -> Boxes:
    """Boxes at 2^-i of the size 2^-i, in random order."""
    corner = 2.0 ** -(np.random.default_rng(2).permutation(count) % 120)[:, None] * np.ones(3)
    return corner.astype(np.float32), (1.5 * corner).astype(np.float32)


def mixed(count: int) -> Boxes:
    rng = np.random.default_rng(3)
    centers = rng.choice([-1, 1], (count, 3)) * 10 ** rng.uniform(-30, 30, (count, 3))
    reach = np.abs(centers) * rng.random((count, 3))
    return (centers - reach).astype(np.float32), (centers + reach).astype(np.float32)


def equal(count: int) -> Boxes:
    return np.full((count, 3), 0.1, np.float32), np.full((count, 3), 0.2, np.float32)


def concentric(count: int) -> Boxes:
    reach = np.random.default_rng(4).random((count, 1)) * np.ones(3)
    return (-reach).astype(np.float32), reach.astype(np.float32)


def points(count: int, scale: float) -> Boxes:
    centers = (scale * np.random.default_rng(5).uniform(-1, 1, (count, 3))).astype(np.float32)
    return centers, centers


def line(count: int) -> Boxes:
    centers = np.random.default_rng(6).random((count, 1)) * np.array([1, 0, 0])
    return centers.astype(np.float32), (centers + [0.01, 0, 0]).astype(np.float32)


CASES = {
    **{f"triangles {n}": triangles(n, 0.1) for n in (1, 2, 7, 8, 9, 16, 17, 34, 500)},
    "small triangles": triangles(20_000, 0.01),
    "needles": needles(2000),
    "sphere": sphere(3000),
    "nested": nested(3000),
    "mixed": mixed(3000),
    "equal": equal(3000),
    "concentric": concentric(3000),
    "points": points(1000, 1.0),
    "denormal": points(1000, 1e-41),
    "huge": points(1000, 4e37),
    "line": line(1000),
    "one of another place": tuple(np.concatenate([a, a[:1] + 1e6]) for a in triangles(9000, 1e-3)),
}
