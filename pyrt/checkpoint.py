"""Rendering in rounds, each a range of samples of all pixels, and saving what is done between them."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from time import perf_counter

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import UsageError
from pyrt.files import remove_leftovers
from pyrt.film import Film
from pyrt.image_io import check_output
from pyrt.partial import Partial, Work, read_partial

# Each round costs a look ahead with beams, and a stop loses the current one. Rounds begin with about so many samples,
# and double while they take less than a second, or than an eighth of the render so far and of the time between writes.
_FIRST_ROUND = 1 << 20
_ROUND_SECONDS = 1.0
_ROUNDS = 8
_SHARE = 20  # so many times what writing took passes before the next write, or more

Trace = Callable[[NDArray[np.uint32], int, int], tuple[Film, int]]


def begin(work: Work, first: int, end: int, order: NDArray[np.intp]) -> Partial:
    """A render of the samples first … end − 1 that has none yet. For `order` see `Partial`."""
    return Partial(work, first, first, end, Film.empty(len(order)), order)


def open_checkpoint(path: str | os.PathLike[str], start: Partial, resume: bool, extend: bool) -> Partial:
    """Makes ready to write the file; returns what the render has to begin with: `start`, or with `resume` what the file
    holds, if there is one. That goes on to the sample `start.spp`, or, unless `extend`, as far as it was to reach.

    Raises:
        UsageError: nothing can be written there; see `read_partial`; or the file's samples begin elsewhere or are more.
    """
    check_output(path)
    remove_leftovers(path)
    if not resume or not os.path.exists(path):
        return start
    partial = read_partial(path, start.work, start.order)
    if partial.first != start.first:
        raise UsageError(f"{path}: its samples begin with {partial.first}, expected {start.first}")
    if not extend:
        return partial
    if partial.end > start.spp:
        raise UsageError(f"{path}: it holds samples up to {partial.end} already, expected at most {start.spp}")
    return replace(partial, spp=start.spp)


def accumulate(
    trace: Trace,
    pixels: NDArray[np.uint32],
    partial: Partial,
    save: Callable[[Partial], None],
    every: float,
    going: Callable[[], bool],
) -> Partial:
    """Traces the samples that `partial` still lacks, as long as it is `going`.

    `trace(pixels, first sample, samples)` gives a film and how many pixels are complete: fewer if it was stopped.
    `save` gets what there is after `every` seconds or more, so that it takes at most a twentieth of the time (0: after
    every round), and at the end, whatever ends it: an exception too, which then goes on.
    """
    step = 1 << (_FIRST_ROUND // len(pixels) | 1).bit_length() - 1
    begun = last_save = perf_counter()
    saved, cost = partial.end, 0.0
    try:
        while partial.end < partial.spp and going():
            start = perf_counter()
            samples = _round(partial.end, step, partial.spp)
            film, complete = trace(pixels, partial.end, samples)
            if complete < len(pixels):
                break
            partial = replace(partial, film=partial.film.merge(film), end=partial.end + samples)
            now = perf_counter()
            if now - start < max(_ROUND_SECONDS, min(every, now - begun) / _ROUNDS):
                step *= 2
            if partial.end < partial.spp and now - last_save >= (every and max(every, _SHARE * cost)):
                save(partial)
                last_save = perf_counter()
                saved, cost = partial.end, last_save - now
    finally:
        if partial.end > saved:
            save(partial)
    return partial


def _round(first: int, step: int, end: int) -> int:
    """Samples of the next round: at most `step`, and the halves of one node of the film, to keep its nodes few."""
    aligned = first & -first or step
    return min(step, aligned, end - first)
