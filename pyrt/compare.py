"""How far a picture is from a reference."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import UsageError
from pyrt.image_tools import flip

MEASURES = {
    "rmse": "root of the mean of (A - B)^2",
    "relmse": "mean of (A - B)^2 / (B^2 + 0.01)",
    "mean": "mean of A - B",
    "max": "greatest |A - B|",
    "flip": "mean of FLIP, the visible difference: 0 is none, 1 black against white",
}
_DARK = 0.01  # so that black pixels of the reference do not decide


@dataclass(frozen=True)
class Difference:
    """Of a picture A from a reference B of the same size; means are over all pixels and channels.

    Attributes:
        measures: by the names of MEASURES, in float64.
        worst: column and row of the pixel with the greatest |A - B|.
        not_finite: pixels that are not finite in A or B; they count as equal in the measures.
        image: (height, width, 3) float32, |A - B|.
    """

    measures: dict[str, float]
    worst: tuple[int, int]
    not_finite: int
    image: NDArray[np.float32]


def difference(image: NDArray[np.float32], reference: NDArray[np.float32], *, display: bool = False) -> Difference:
    """Compares two linear pictures (height, width, 3).

    Args:
        display: both end at white, which FLIP wants to know.

    Raises:
        UsageError: the sizes differ.
    """
    if image.shape != reference.shape:
        sizes = [f"{width} x {height}" for height, width, _ in (image.shape, reference.shape)]
        raise UsageError(f"expected two pictures of one size, got {sizes[0]} and {sizes[1]} pixels")
    finite = np.isfinite(np.concatenate([image, reference], axis=2)).all(axis=2)
    a, b = (np.where(finite[..., np.newaxis], picture, 0).astype(np.float64) for picture in (image, reference))
    error = a - b
    distance = np.abs(error)
    row, column, _ = np.unravel_index(distance.argmax(), distance.shape)
    measures = {
        "rmse": np.sqrt((error**2).mean()),
        "relmse": (error**2 / (b**2 + _DARK)).mean(),
        "mean": error.mean(),
        "max": distance.max(),
        "flip": flip(a.astype(np.float32), b.astype(np.float32), display=display).mean(dtype=np.float64),
    }
    with np.errstate(invalid="ignore"):
        shown = np.abs(image - reference)
    return Difference(
        measures={name: float(value) for name, value in measures.items()},
        worst=(int(column), int(row)),
        not_finite=int((~finite).sum()),
        image=shown,
    )
