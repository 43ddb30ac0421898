"""Partial renders, which can be continued and merged: films of a range of samples, and adaptive renders so far."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from pyrt.errors import UsageError
from pyrt.film import Film
from pyrt.layout import constants, kernel_dir
from pyrt.settings import Window

Side = Annotated[int, Field(ge=1, le=1 << 16)]
Seed = Annotated[int, Field(ge=0, lt=1 << 32)]
Index = Annotated[int, Field(ge=0, le=1 << 30)]
Crop = tuple[Index, Index, Index, Index]


@dataclass(frozen=True)
class Work:
    """What a film holds, beside a range of samples, and what these depend on. Films of the same work add up exactly.

    Attributes:
        width, height: of the whole picture, of which `crop`, (x0, y0, x1, y1), is the part in the film.
    """

    scene: str  # see `scene_hash`
    width: Side
    height: Side
    crop: Crop
    seed: Seed
    device: str
    pyrt: str  # version
    kernels: str  # see `kernels_hash`

    @property
    def window(self) -> Window:
        """The film's pixels."""
        return Window(*self.crop, self.width, self.height)


@dataclass(frozen=True)
class Partial:
    """A film of the samples `first` … `end` − 1 of all pixels.

    Attributes:
        spp: the sample at which the render is complete.
        order: (pixels,) where each pixel of the picture, row by row, stands in the film.
    """

    work: Work
    first: int
    end: int
    spp: int
    film: Film
    order: NDArray[np.intp]

    def traced(self) -> int:
        """Samples of all pixels together."""
        return len(self.order) * (self.end - self.first)

    def total(self) -> int:
        """How many they will be."""
        return len(self.order) * (self.spp - self.first)


# Of squared errors with twice the samples, by class of pixels, before it is measured: where all is smooth they fall as
# n^−3, at edges as n^−1.5.
_DECAY = (0.17, 0.3, 0.4, 0.4, 0.35)


@dataclass
class Adaptive:
    """An adaptive render so far; arrays are over its pixels.

    Attributes:
        sums: (2, 3, pixels), of the samples and of their squares.
        count: samples of each pixel.
        error: by how much the squared error of a pixel's mean fell when its samples were doubled last, as estimated;
            relative to its radiance. Infinite where it is not known.
        level: of each pixel, which has had 2^level samples; 0: none.
        wanted: the level that it is to have after this round.
        classes: PIXEL_… of types.h.
        decay: (classes,), of squared errors with twice the samples.
        falls: (3, classes): of the pixels that this round has doubled so far the error before and after, and their
            number.
        dropped: samples that were not finite.
        torn: an exception has left the arrays at odds.
    """

    sums: NDArray[np.float64]
    count: NDArray[np.uint32]
    error: NDArray[np.float64]
    level: NDArray[np.uint8]
    wanted: NDArray[np.uint8]
    classes: NDArray[np.uint8]
    decay: NDArray[np.float64]
    falls: NDArray[np.float64]
    dropped: int = 0
    torn: bool = False

    @classmethod
    def empty(cls, pixels: int) -> Adaptive:
        level, unknown = np.zeros(pixels, np.uint8), constants()["PIXEL_UNKNOWN"]
        return cls(
            sums=np.zeros((2, 3, pixels)),
            count=np.zeros(pixels, np.uint32),
            error=np.full(pixels, np.inf),
            level=level,
            wanted=level + np.uint8(1),
            classes=level + np.uint8(unknown),
            decay=np.array(_DECAY),
            falls=np.zeros((3, len(_DECAY))),
        )


@dataclass(frozen=True)
class PartialAdaptive:
    """An adaptive render to the error `noise`, with at most `spp` samples of a pixel; `order` as in `Partial`."""

    work: Work
    noise: float
    spp: int
    state: Adaptive
    order: NDArray[np.intp]

    def traced(self) -> int:
        """Samples of all pixels together."""
        return int(self.state.count.sum())

    def total(self) -> int:
        """How many they will be at most."""
        return len(self.order) * self.spp


def kernels_hash() -> str:
    """SHA-256 of the kernels' source."""
    digest = hashlib.sha256()
    for file in sorted(kernel_dir().glob("*.[ch]*")):
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()


def require_same(path: str | os.PathLike[str], found: Work, expected: Work) -> None:
    """Raises UsageError, one sentence, if samples of both may not be added."""
    wanted = asdict(expected)
    for name, value in asdict(found).items():
        if value != wanted[name]:
            a, b = (text[:12] if name in ("scene", "kernels") else text for text in (f"{value}", f"{wanted[name]}"))
            raise UsageError(f"{path}: its samples are of another {name} ({a}), expected {b}")


def merge_order(parts: Mapping[str, tuple[Work, int, int]]) -> list[str]:
    """The names of parts, each a range first … end − 1 of samples of some work, in the order of their samples.

    Raises:
        UsageError: they are of different work, ranges overlap, or samples between them are missing.
    """
    names = sorted(parts, key=lambda name: parts[name][1:])
    for a, b in pairwise(names):
        (work, first, end), (other, begin, last) = parts[a], parts[b]
        require_same(b, other, work)
        if end != begin:
            raise UsageError(
                f"{a} and {b} {'overlap' if end > begin else 'leave a gap'}: they hold the samples {first}:{end} and "
                f"{begin}:{last}, expected ranges that follow each other"
            )
    return names


def merge(a: Partial, b: Partial) -> Partial:
    """One film of both: b's samples follow a's, and both are of the same work and order of pixels."""
    return replace(a, end=b.end, spp=max(a.spp, b.spp), film=a.film.merge(b.film))
