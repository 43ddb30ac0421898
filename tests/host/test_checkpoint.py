"""Rounds and saves by a clock that only the test moves: any range of samples, at a bounded cost."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from pyrt import checkpoint
from pyrt.checkpoint import accumulate, begin
from pyrt.film import Film
from pyrt.partial import Partial, Work

WORK = Work("", 2, 1, (0, 0, 2, 1), 0, "", "", "")
PIXELS = np.arange(2, dtype=np.uint32)


class Clock:
    """Rounds and saves take the given seconds for a sample, and for a save."""

    def __init__(self, sample: float, save: float):
        self.sample, self.save_seconds = sample, save
        self.now = 0.0
        self.rounds: list[tuple[int, int]] = []
        self.saves: list[tuple[float, int]] = []

    def trace(self, pixels: np.ndarray, first: int, samples: int) -> tuple[Film, int]:
        self.now += samples * self.sample
        self.rounds.append((first, samples))
        film = Film.empty(len(pixels))
        film.add(np.ones((samples, 3, len(pixels)), np.float32), 0, first)
        return film, len(pixels)

    def save(self, partial: Partial) -> None:
        self.saves.append((self.now, partial.end))
        self.now += self.save_seconds


@pytest.fixture(autouse=True)
def _short_rounds(monkeypatch):
    monkeypatch.setattr(checkpoint, "_FIRST_ROUND", 1)


def run(monkeypatch, clock: Clock, first: int, end: int, every: float) -> Partial:
    monkeypatch.setattr(checkpoint, "perf_counter", lambda: clock.now)
    start = begin(WORK, first, end, np.arange(2))
    return accumulate(clock.trace, PIXELS, start, clock.save, every, lambda: True)


@pytest.mark.parametrize("first_round", [1, 8, 1 << 22])
@pytest.mark.parametrize(("first", "end"), [(0, 1), (0, 100), (7, 8), (7, 100), (96, 161)])
def test_every_sample_is_traced_once(monkeypatch, first, end, first_round):
    monkeypatch.setattr(checkpoint, "_FIRST_ROUND", first_round)
    clock = Clock(0.1, 0)
    partial = run(monkeypatch, clock, first, end, 60)
    assert [n for start, samples in clock.rounds for n in range(start, start + samples)] == list(range(first, end))
    assert (partial.end, int(partial.film.count[0])) == (end, end - first)
    assert (partial.film.totals() == end - first).all()


def test_saves_are_so_far_apart_and_the_last_has_all(monkeypatch):
    clock = Clock(0.1, 0.5)
    run(monkeypatch, clock, 0, 10_000, 60)
    times = [time for time, _ in clock.saves]
    assert len(times) > 10
    assert all(60 <= b - a < 60 * 1.3 for a, b in pairwise(times[:-1]))
    assert clock.saves[-1][1] == 10_000


@pytest.mark.parametrize(("share", "least", "most"), [(20, 0.0, 0.06), (0, 0.3, 0.7)])
def test_saves_that_take_long_become_rare(monkeypatch, share, least, most):
    """A twentieth, and the first one. The second case is the control: without the limit, they take half of the time."""
    monkeypatch.setattr(checkpoint, "_SHARE", share)
    clock = Clock(1.0, 60.0)
    run(monkeypatch, clock, 0, 10_000, 60)
    assert least < 60.0 * (len(clock.saves) - 1) / clock.now < most


def test_rounds_stay_short(monkeypatch):
    """A stop after a minute loses no more than a quarter of it."""
    clock = Clock(1.0, 0)
    run(monkeypatch, clock, 0, 5000, 60)
    assert max(samples for _, samples in clock.rounds) <= 16
    quick = Clock(1e-6, 0)
    run(monkeypatch, quick, 0, 1 << 20, 60)
    assert len(quick.rounds) < 30
