"""Partial renders in EXR files.

Such a file is a picture of the samples so far, with a second part that holds the float64 sums bit for bit, so that
what is continued or merged has the bits of a render in one go. The part is an image of 32-bit words without
compression: planes of one double per pixel, row by row, first the number of each pixel's samples, then the six sums of
each of the film's nodes, or of an adaptive render the six sums, the error and what is packed from level, level wanted
and class, and at last a row with the CRC-32 of all that and of the header.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import prod
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from pyrt.errors import UsageError
from pyrt.exr_state import StatePart, read_state
from pyrt.film import Film, node_keys
from pyrt.layout import constants
from pyrt.partial import Adaptive, Index, Partial, PartialAdaptive, Work, require_same

Plane = NDArray[np.float64]
_CLASSES = constants()["PIXEL_CLASSES"]
_PerClass = Annotated[list[float], Field(min_length=_CLASSES, max_length=_CLASSES)]


@dataclass(frozen=True)
class _Round:
    noise: float
    decay: _PerClass
    falls: Annotated[list[_PerClass], Field(min_length=3, max_length=3)]
    dropped: int


@dataclass(frozen=True)
class _Header:
    format: Literal[2]
    work: Work
    spp: Index
    samples: tuple[Index, Index] | None = None
    adaptive: _Round | None = None

    def planes(self) -> int:
        """How many the part has; 0 if that makes no sense."""
        if self.samples is not None:
            first, end = self.samples
            return 1 + 6 * len(list(node_keys(first, end - first))) if first < end else 0
        return 9 if self.adaptive is not None else 0


def state_part(partial: Partial | PartialAdaptive) -> StatePart:
    """What `image_io.write_image` stores beside the picture."""
    if isinstance(partial, Partial):
        header = _Header(2, partial.work, partial.spp, samples=(partial.first, partial.end))
    else:
        state = partial.state
        rounds = _Round(partial.noise, state.decay.tolist(), state.falls.tolist(), state.dropped)
        header = _Header(2, partial.work, partial.spp, adaptive=rounds)
    text = TypeAdapter(_Header).dump_json(header)
    height, width = partial.work.window.shape
    return StatePart(text.decode(), header.planes() * height + 1, 2 * width, _blocks(partial, text))


def _blocks(partial: Partial | PartialAdaptive, header: bytes) -> Iterator[NDArray[np.uint32]]:
    height, width = partial.work.window.shape
    check = zlib.crc32(header)
    for plane in _planes(partial):
        picture = plane[partial.order]
        check = zlib.crc32(picture.data, check)
        yield picture.view(np.uint32).reshape(height, 2 * width)
    yield np.full((1, 2 * width), check, np.uint32)


def _planes(partial: Partial | PartialAdaptive) -> Iterator[Plane]:
    if isinstance(partial, PartialAdaptive):
        state = partial.state
        yield state.count.astype(np.float64)
        yield from state.sums.reshape(6, -1)
        yield state.error
        yield state.level + 256.0 * state.wanted + 65536.0 * state.classes
        return
    yield partial.film.count.astype(np.float64)
    nodes = partial.film.nodes()
    for key in node_keys(partial.first, partial.end - partial.first):
        yield from nodes[key].reshape(6, -1)


def read_header(path: str | os.PathLike[str]) -> tuple[Work, int, int]:
    """What a file's samples are of, the first of them, and the one after the last. Raises as `read_partial`."""
    header, _ = _open(path)
    return header.work, *_fixed(path, header)


def read_partial(
    path: str | os.PathLike[str], expected: Work | None = None, order: NDArray[np.intp] | None = None
) -> Partial:
    """Reads what `state_part` stored; by default the film has its pixels row by row.

    Raises:
        UsageError: the file is not readable, not of this kind, damaged, of another version of the format, or not of the
            `expected` work.
    """
    header, planes = _open(path)
    work, (first, end) = header.work, _fixed(path, header)
    if expected is not None:
        require_same(path, work, expected)
    order = np.arange(prod(work.window.shape)) if order is None else order
    count, nodes = np.empty(len(order), np.uint32), {}
    try:
        count[order] = _whole(next(planes))
        for key in node_keys(first, end - first):
            nodes[key] = np.empty((2, 3, len(order)))
            for sums in nodes[key].reshape(6, -1):
                sums[order] = next(planes)
        next(planes, None)
    except OSError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
    film = Film(count, {0: nodes}, (end - first) * len(count) - int(count.sum()))
    return Partial(work, first, end, header.spp, film, order)


def read_adaptive(path: str | os.PathLike[str], expected: Work, order: NDArray[np.intp]) -> PartialAdaptive:
    """Reads what `state_part` stored of an adaptive render. Raises as `read_partial`."""
    header, planes = _open(path)
    require_same(path, header.work, expected)
    if header.adaptive is None:
        raise UsageError(f"{path}: it has a fixed number of samples, expected a render with --noise or --time")
    state = Adaptive.empty(len(order))
    state.decay, state.falls = np.array(header.adaptive.decay), np.array(header.adaptive.falls)
    state.dropped = header.adaptive.dropped
    try:
        state.count[order] = _whole(next(planes))
        for target in (*state.sums.reshape(6, -1), state.error):
            target[order] = next(planes)
        packed = _whole(next(planes))
        for shift, target in ((0, state.level), (8, state.wanted), (16, state.classes)):
            target[order] = packed >> shift & 0xFF
        next(planes, None)
    except OSError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
    return PartialAdaptive(header.work, header.adaptive.noise, header.spp, state, order)


def _whole(plane: Plane) -> NDArray[np.uint32]:
    with np.errstate(invalid="ignore"):  # what is damaged may be anything, and is found out at the end
        return plane.astype(np.uint32)


def _fixed(path: str | os.PathLike[str], header: _Header) -> tuple[int, int]:
    if header.samples is None:
        raise UsageError(f"{path}: it was rendered with --noise or --time, expected a fixed number of samples")
    return header.samples


def _open(path: str | os.PathLike[str]) -> tuple[_Header, Iterator[Plane]]:
    text, rows, row_words, read = read_state(path)
    try:
        header = TypeAdapter(_Header).validate_json(text)
    except ValidationError as error:
        problem = error.errors()[0]
        place = ".".join(map(str, problem["loc"])) or "header"
        raise UsageError(f"{path}: damaged, or of another version of pyrt: {place}: {problem['msg'].lower()}") from None
    (height, width), planes = header.work.window.shape, header.planes()
    if min(planes, height, width) < 1 or (rows, row_words) != (planes * height + 1, 2 * width):
        raise UsageError(f"{path}: damaged: its size does not fit its header")
    return header, _read_planes(read, rows, height, zlib.crc32(text.encode()))


def _read_planes(read: Callable[[int, int], NDArray[np.uint32]], rows: int, height: int, check: int) -> Iterator[Plane]:
    """The planes; raises OSError after the last one if the check sum is wrong."""
    for row in range(0, rows - 1, height):
        plane = read(row, row + height)
        check = zlib.crc32(plane.data, check)
        yield plane.reshape(-1).view(np.float64)
    if (read(rows - 1, rows) != check).any():
        raise OSError("its check sum is wrong")
