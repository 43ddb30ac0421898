"""Rendering in rounds, each a range of samples of all pixels, and saving what is done between them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import UsageError
from pyrt.files import remove_leftovers
from pyrt.film import Film
from pyrt.image_io import check_output
from pyrt.partial import Adaptive, Partial, PartialAdaptive, Work
from pyrt.partial_file import read_adaptive, read_partial

# Each round costs a look ahead with beams, and a stop loses the current one. Rounds begin with about so many samples,
# and double while they take less than a second, or than an eighth of the render so far and of the time between writes.
_FIRST_ROUND = 1 << 20
_ROUND_SECONDS = 1.0
_ROUNDS = 8
_SHARE = 20  # so many times what writing took passes before the next write, or more

Kept = Partial | PartialAdaptive


def begin(work: Work, first: int, end: int, order: NDArray[np.intp]) -> Partial:
    """A render of the samples first … end − 1 that has none yet. For `order` see `Partial`."""
    return Partial(work, first, first, end, Film.empty(len(order)), order)


def begin_adaptive(work: Work, noise: float, spp: int, order: NDArray[np.intp]) -> PartialAdaptive:
    """An adaptive render that has no samples yet; see `PartialAdaptive`."""
    return PartialAdaptive(work, noise, spp, Adaptive.empty(len(order)), order)


def open_checkpoint(path: str | os.PathLike[str], start: Kept, resume: bool, extend: bool) -> Kept:
    """Makes ready to write the file; returns what the render has to begin with: `start`, or with `resume` what the file
    holds, if there is one. That goes on to the sample `start.spp`, or, unless `extend`, as far as it was to reach.

    Raises:
        UsageError: nothing can be written there; see `read_partial`; or the file is of another kind of render, or holds
            more samples.
    """
    check_output(path)
    remove_leftovers(path)
    if not resume or not os.path.exists(path):
        return start
    if isinstance(start, Partial):
        partial: Kept = _same_range(path, read_partial(path, start.work, start.order), start, extend)
    else:
        partial = _same_target(path, read_adaptive(path, start.work, start.order), start, extend)
    return replace(partial, spp=start.spp) if extend else partial


def _same_range(path: str | os.PathLike[str], found: Partial, start: Partial, extend: bool) -> Partial:
    if found.first != start.first:
        raise UsageError(f"{path}: its samples begin with {found.first}, expected {start.first}")
    if extend and found.end > start.spp:
        raise UsageError(f"{path}: it holds samples up to {found.end} already, expected at most {start.spp}")
    return found


def _same_target(
    path: str | os.PathLike[str], found: PartialAdaptive, start: PartialAdaptive, extend: bool
) -> PartialAdaptive:
    if found.noise != start.noise:
        raise UsageError(f"{path}: it is rendered to the noise {found.noise:g}, expected {start.noise:g}")
    if extend and found.spp != start.spp:
        raise UsageError(f"{path}: it is rendered with at most {found.spp} samples, expected {start.spp}")
    return found


@dataclass
class Saver:
    """Calls `write` after `every` seconds or more, so that it takes at most a twentieth of the time (0: always)."""

    write: Callable[[], None]
    every: float
    cost: float = 0.0
    last: float = field(default_factory=lambda: perf_counter())

    def save_if_due(self) -> bool:
        """Whether it was."""
        start = perf_counter()
        if start - self.last < (self.every and max(self.every, _SHARE * self.cost)):
            return False
        self.write()
        self.last = perf_counter()
        self.cost = self.last - start
        return True


def accumulate(
    trace: Callable[..., tuple[Film, int]],
    pixels: NDArray[np.uint32],
    partial: Partial,
    save: Callable[[Partial], None],
    every: float,
    going: Callable[[], bool],
) -> Partial:
    """Traces the samples that `partial` still lacks, as long as it is `going`.

    `trace(pixels, first sample, samples)` gives a film and how many pixels are complete: fewer if it was stopped.
    `save` gets what there is every so often (see `Saver`), and at the end, whatever ends it: an exception too, which
    then goes on.
    """
    step = 1 << (_FIRST_ROUND // len(pixels) | 1).bit_length() - 1
    saver, begun, saved = Saver(lambda: save(partial), every), perf_counter(), partial.end
    try:
        while partial.end < partial.spp and going():
            start = perf_counter()
            samples = _round(partial.end, step, partial.spp)
            film, complete = trace(pixels, partial.end, samples)
            if complete < len(pixels):
                break
            partial = replace(partial, film=partial.film.merge(film, reuse=True), end=partial.end + samples)
            now = perf_counter()
            if now - start < max(_ROUND_SECONDS, min(every, now - begun) / _ROUNDS):
                step *= 2
            if partial.end < partial.spp and saver.save_if_due():
                saved = partial.end
    finally:
        if partial.end > saved:
            save(partial)
    return partial


def _round(first: int, step: int, end: int) -> int:
    """Samples of the next round: at most `step`, and the halves of one node of the film, to keep its nodes few."""
    aligned = first & -first or step
    return min(step, aligned, end - first)
