"""Which pixels of which picture."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

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

    @property
    def shape(self) -> tuple[int, int]:
        """Height and width of the window itself."""
        return self.y1 - self.y0, self.x1 - self.x0


def crop_window(crop: tuple[int, int, int, int] | None, width: int, height: int) -> Window:
    """The window (x0, y0, x1, y1) of a picture; None: all of it. Raises UsageError unless it lies inside, or for a
    picture without pixels or with too many."""
    check_whole("width", width, 1, 65536)
    check_whole("height", height, 1, 65536)
    if width * height > MAX_PIXELS:
        raise UsageError(f"size: expected at most 2^28 pixels in all, got {width} x {height}")
    numbers = (0, 0, width, height) if crop is None else tuple(crop) if isinstance(crop, Sequence) else (crop,)
    if len(numbers) == 4 and all(isinstance(number, int | np.integer) for number in numbers):
        x0, y0, x1, y1 = (int(number) for number in numbers)
        if 0 <= x0 < x1 <= width and 0 <= y0 < y1 <= height:
            return Window(x0, y0, x1, y1, int(width), int(height))
    text = crop if isinstance(crop, str) else ",".join(map(str, numbers))
    raise UsageError(f"crop: expected x0,y0,x1,y1 inside the picture, {width} x {height}, got {text}")


def pair(name: str, value: Any) -> tuple[int, int]:
    """The two whole numbers that `value` holds. Raises UsageError, one sentence, for anything else."""
    numbers = tuple(value) if isinstance(value, Sequence | np.ndarray) else ()
    if len(numbers) != 2 or not all(isinstance(number, int | np.integer) for number in numbers):
        raise UsageError(f"{name}: expected two whole numbers, got {value!r}")
    return int(numbers[0]), int(numbers[1])


def check_number(name: str, value: object, *, zero: bool = False) -> None:
    """Raises UsageError, one sentence, for what is no finite number > 0, or >= 0 if `zero`."""
    if not isinstance(value, int | float | np.number) or not (0 < value < np.inf or (zero and value == 0)):
        raise UsageError(f"{name}: expected a number {'>=' if zero else '>'} 0, got {value!r}")


def check_whole(name: str, value: object, low: int, high: int) -> None:
    """Raises UsageError, one sentence, for what is no whole number from `low` to `high`."""
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
        raise UsageError(f"{name}: expected a whole number from {low} to {high}, got {value!r}")
