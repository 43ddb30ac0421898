"""What a render may be asked for."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from pyrt.errors import UsageError

MAX_PIXELS = 1 << 28


class Window(NamedTuple):
    """Pixels x0 … x1 − 1, y0 … y1 − 1 of a picture of width × height."""

    x0: int
    y0: int
    x1: int
    y1: int
    width: int
    height: int


def crop_window(crop: tuple[int, int, int, int] | None, width: int, height: int) -> Window:
    """The window (x0, y0, x1, y1) of a picture; None: all of it. Raises UsageError unless it lies inside."""
    numbers = (0, 0, width, height) if crop is None else tuple(crop)
    if len(numbers) == 4 and all(isinstance(number, int | np.integer) for number in numbers):
        x0, y0, x1, y1 = (int(number) for number in numbers)
        if 0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height:
            return Window(x0, y0, x1, y1, width, height)
    text = ",".join(map(str, numbers))
    raise UsageError(f"crop: expected x0,y0,x1,y1 inside the picture, {width} x {height}, got {text}")


def check_keeping(
    checkpoint: str | Path | None, every: float, samples: tuple[int, int] | None, adaptive: bool, crop: object
) -> None:
    """Raises UsageError, one sentence, unless a render with these arguments can keep its film."""
    if crop is not None:
        raise UsageError("crop: expected none beside checkpoint or samples, which are of whole pictures")
    if samples is not None and adaptive:
        raise UsageError("samples: expected no noise target or time limit beside a range of samples")
    if samples is not None and not 0 <= samples[0] < samples[1] <= 2**30:
        raise UsageError(f"samples: expected 0 <= first < end <= 2^30, got {samples[0]}:{samples[1]}")
    if not 0 <= every < np.inf:
        raise UsageError(f"checkpoint_every: expected a number of seconds >= 0, got {every!r}")
    if checkpoint is not None and Path(checkpoint).suffix.lower() != ".exr":
        raise UsageError(f"{checkpoint}: expected a name ending in .exr, the format that can hold a checkpoint")


def check_arguments(
    spp: int, seed: int, width: int, height: int, pass_samples: int, noise: float | None, time_limit: float | None
) -> None:
    """Raises UsageError, one sentence, for an argument of `render` that is out of range."""
    for name, value, low, high in (
        ("spp", spp, 1, 2**30),
        ("seed", seed, 0, 2**32 - 1),
        ("width", width, 1, 65536),
        ("height", height, 1, 65536),
        ("pass_samples", pass_samples, 1, 2**28),
    ):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
            raise UsageError(f"{name}: expected a whole number from {low} to {high}, got {value!r}")
    if width * height > MAX_PIXELS:
        raise UsageError(f"size: expected at most 2^28 pixels in all, got {width} x {height}")
    for name, limit in (("noise", noise), ("time_limit", time_limit)):
        if limit is not None and not 0 < limit < np.inf:
            raise UsageError(f"{name}: expected a number > 0, got {limit!r}")
