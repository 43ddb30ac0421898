"""Pictures in a terminal: two pixels a character as coloured half blocks, or shades of characters without colours."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from rich.color import Color
from rich.console import Console
from rich.segment import Segment, Segments
from rich.style import Style

from pyrt.image_io import linear_to_srgb
from pyrt.image_tools import shrunk

_SHADES = " .:-=+*#%@"  # from dark to bright
_LUMINANCE = (0.2126, 0.7152, 0.0722)


def fitted(width: int, height: int) -> tuple[int, int]:
    """The size in pixels at which a picture fits into the terminal of stdout, never larger than it is.

    80 x 25 characters where stdout is no terminal; COLUMNS and LINES say otherwise.
    """
    console = Console()
    scale = min(1.0, console.width / width, 2 * max(console.height - 1, 1) / height)
    return max(1, round(scale * width)), max(1, round(scale * height))


def show(image: NDArray[np.float32], exposure: float = 0.0) -> None:
    """Prints a linear picture (height, width, 3) to stdout, brightened by 2^exposure.

    With as many colours as the terminal has; with shades of characters if stdout is no terminal or its encoding has no
    half block, or where TERM=dumb or NO_COLOR ask for it.
    """
    console = Console()
    height, width, _ = image.shape
    small = shrunk(image, *fitted(width, height))
    with np.errstate(over="ignore"):
        small = np.clip(np.nan_to_num(small * np.float32(2.0**exposure)), 0, 1)
    if len(small) % 2:
        small = np.concatenate([small, np.zeros_like(small[:1])])
    upper, lower = small[::2], small[1::2]
    if console.color_system is None or console.no_color or not console.encoding.startswith("utf"):
        shades = linear_to_srgb((upper + lower) @ _LUMINANCE / 2) * (len(_SHADES) - 1)
        for row in np.rint(shades).astype(int):
            print("".join(_SHADES[shade] for shade in row).rstrip())
        return
    segments = []
    for colors in zip(_bytes(upper), _bytes(lower), strict=True):
        for top, bottom in zip(*colors, strict=True):
            style = Style(color=Color.from_rgb(*top), bgcolor=Color.from_rgb(*bottom))
            segments.append(Segment("\N{UPPER HALF BLOCK}", style))
        segments.append(Segment.line())
    console.print(Segments(segments), end="")


def _bytes(pixels: NDArray[np.float32]) -> list[list[list[int]]]:
    values: list[list[list[int]]] = np.rint(255 * linear_to_srgb(pixels)).astype(int).tolist()
    return values
