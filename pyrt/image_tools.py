"""What OpenImageIO computes with pictures: how different two look, fewer pixels, and colours for a display."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import PyrtError, UsageError

Image = NDArray[np.float32]

# Views of OpenColorIO's built-in configuration, by names that one can type.
_DISPLAY = "sRGB - Display"
VIEWS = {"aces": "ACES 2.0 - SDR 100 nits (Rec.709)", "srgb": "Un-tone-mapped", "raw": "Raw"}


def flip(image: Image, reference: Image, *, display: bool) -> Image:
    """FLIP, the difference that one sees on flipping between two pictures: (height, width) float32, from 0 to 1.

    Andersson et al., "FLIP: A Difference Evaluator for Alternating Images" (2020), and for high dynamic range
    "Visualizing Errors in Rendered High Dynamic Range Images" (2021), at 67 pixels per degree.

    Args:
        image: (height, width, 3) linear.
        reference: the same.
        display: values end at white; otherwise exposures are chosen by the reference's median and greatest luminance.
    """
    import OpenImageIO as oiio

    pair = (_buffer(reference), _buffer(image))
    # luminances of 0 are taken from the reference
    result = oiio.ImageBufAlgo.FLIP_diff(*pair, hdr=int(not display), maxluminance=0.0, medianluminance=0.0)
    return _pixels(result)[..., 0]


def shrunk(image: Image, width: int, height: int) -> Image:
    """The picture (h, w, 3) averaged into (height, width, 3) pixels, neither more than it has."""
    import OpenImageIO as oiio

    return _pixels(oiio.ImageBufAlgo.resize(_buffer(image), "box", roi=oiio.ROI(0, width, 0, height)))


def check_view(view: str | None) -> None:
    """Raises UsageError for a view that is not in VIEWS."""
    if view is not None and view not in VIEWS:
        raise UsageError(f'view: expected one of {", ".join(VIEWS)}, got "{view}"')


def viewed(image: Image, view: str) -> Image:
    """Values for an sRGB display, 0 … 1, of a linear picture (h, w, 3) through one of VIEWS."""
    import OpenImageIO as oiio

    source, name = _buffer(image), VIEWS[view]
    result = oiio.ImageBufAlgo.ociodisplay(source, _DISPLAY, name, "lin_rec709_scene", colorconfig="ocio://default")
    return np.clip(_pixels(result), 0.0, 1.0)


def _buffer(image: Image) -> Any:
    import OpenImageIO as oiio

    return oiio.ImageBuf(np.ascontiguousarray(image, np.float32))


def _pixels(buffer: Any) -> Image:
    if buffer.has_error:
        raise PyrtError(f"OpenImageIO failed: {buffer.geterror()}")
    return np.asarray(buffer.get_pixels(), np.float32)
