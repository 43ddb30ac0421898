"""Partial renders: films of a range of samples, that can be continued, merged and kept in EXR files.

Such a file is a picture of the samples so far, with a second part that holds the film's float64 sums bit for bit, so
that what is continued or merged has the bits of a render in one go. The part is an image of 32-bit words without
compression: planes of one double per pixel, row by row, first the number of each pixel's samples, then the six sums of
each of the film's nodes, and at last a row with the CRC-32 of all that and of the header.
"""

from __future__ import annotations

import hashlib
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import reduce
from itertools import pairwise
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, TypeAdapter, ValidationError

from pyrt.errors import UsageError
from pyrt.exr_state import StatePart, read_state
from pyrt.film import Film, node_keys
from pyrt.layout import kernel_dir

Side = Annotated[int, Field(ge=1, le=1 << 16)]
Seed = Annotated[int, Field(ge=0, lt=1 << 32)]
Index = Annotated[int, Field(ge=0, le=1 << 30)]
Plane = NDArray[np.float64]


@dataclass(frozen=True)
class Work:
    """What a sample depends on, beside its pixel and its index. Films of the same work add up exactly."""

    scene: str  # see `scene_hash`
    width: Side
    height: Side
    seed: Seed
    device: str
    pyrt: str  # version
    kernels: str  # see `kernels_hash`


@dataclass(frozen=True)
class Partial:
    """A film of the samples `first` … `end` − 1 of all pixels.

    Attributes:
        spp: the sample at which the render is complete.
        place: (pixels,) where the film's pixels lie in the picture: column + width · row.
    """

    work: Work
    first: int
    end: int
    spp: int
    film: Film
    place: NDArray[np.intp]


@dataclass(frozen=True)
class _Header:
    format: Literal[1]
    work: Work
    samples: tuple[Index, Index]
    spp: Index


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
            raise UsageError(f"{path}: its samples are of another {name} ({value}), expected {wanted[name]}")


def merge(partials: Sequence[Partial], names: Sequence[str | os.PathLike[str]]) -> Partial:
    """One film of all the samples: of the same work and order of pixels, in ranges that follow each other.

    `names` are for messages.

    Raises:
        UsageError: they are of different work, ranges overlap, or samples between them are missing.
    """
    order = sorted(range(len(partials)), key=lambda i: (partials[i].first, partials[i].end))
    for before, after in pairwise(order):
        a, b = partials[before], partials[after]
        require_same(names[after], b.work, a.work)
        if a.end != b.first:
            what = "overlap" if a.end > b.first else "leave a gap"
            raise UsageError(
                f"{names[before]} and {names[after]} {what}: they hold the samples {a.first}:{a.end} and "
                f"{b.first}:{b.end}, expected ranges that follow each other"
            )
    first, *_, last = (partials[i] for i in order)
    film = reduce(Film.merge, (partials[i].film for i in order))
    return Partial(first.work, first.first, last.end, last.end, film, first.place)


def state_part(partial: Partial) -> StatePart:
    """What `image_io.write_image` stores beside the picture."""
    header = TypeAdapter(_Header).dump_json(_Header(1, partial.work, (partial.first, partial.end), partial.spp))
    rows = _rows(partial.first, partial.end, partial.work.height)
    return StatePart(header.decode(), rows, 2 * partial.work.width, _blocks(partial, header))


def _rows(first: int, end: int, height: int) -> int:
    return (1 + 6 * len(list(node_keys(first, end - first)))) * height + 1


def _blocks(partial: Partial, header: bytes) -> Iterator[NDArray[np.uint32]]:
    width, height = partial.work.width, partial.work.height
    check = zlib.crc32(header)
    for plane in _planes(partial):
        picture = np.zeros(width * height)
        picture[partial.place] = plane
        check = zlib.crc32(picture.data, check)
        yield picture.view(np.uint32).reshape(height, 2 * width)
    last = np.zeros((1, 2 * width), np.uint32)
    last[0, 0] = check
    yield last


def _planes(partial: Partial) -> Iterator[Plane]:
    yield partial.film.count.astype(np.float64)
    nodes = partial.film.nodes()
    for key in node_keys(partial.first, partial.end - partial.first):
        yield from nodes[key].reshape(6, -1)


def read_partial(
    path: str | os.PathLike[str], expected: Work | None = None, place: NDArray[np.intp] | None = None
) -> Partial:
    """Reads what `state_part` stored; the film gets its pixels in the order of `place`, by default row by row.

    Raises:
        UsageError: the file is not readable, not of this kind, damaged, of another version of the format, or not of the
            `expected` work.
    """
    text, rows, row_words, read = read_state(path)
    try:
        header = TypeAdapter(_Header).validate_json(text)
    except ValidationError as error:
        problem = error.errors()[0]
        place = ".".join(map(str, problem["loc"])) or "header"
        raise UsageError(f"{path}: damaged, or of another version of pyrt: {place}: {problem['msg'].lower()}") from None
    work, (first, end) = header.work, header.samples
    if not first < end or (rows, row_words) != (_rows(first, end, work.height), 2 * work.width):
        raise UsageError(f"{path}: damaged: its size does not fit its header")
    if expected is not None:
        require_same(path, work, expected)
    place = np.arange(work.width * work.height) if place is None else place
    planes = _read_planes(read, rows, work.height, zlib.crc32(text.encode()))
    try:
        count = next(planes)[place].astype(np.uint32)
        nodes = {}
        for key in node_keys(first, end - first):
            nodes[key] = np.empty((2, 3, len(place)))
            for sums in nodes[key].reshape(6, -1):
                sums[:] = next(planes)[place]
        next(planes, None)
    except OSError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
    film = Film(count, {0: nodes}, (end - first) * len(count) - int(count.sum()))
    return Partial(work, first, end, header.spp, film, place)


def _read_planes(read: Callable[[int, int], NDArray[np.uint32]], rows: int, height: int, check: int) -> Iterator[Plane]:
    """The planes; raises OSError after the last one if the check sum is wrong."""
    for row in range(0, rows - 1, height):
        plane = read(row, row + height)
        check = zlib.crc32(plane.data, check)
        yield plane.reshape(-1).view(np.float64)
    if read(rows - 1, rows)[0, 0] != check:
        raise OSError("its check sum is wrong")
