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
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
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
        order: (pixels,) where each pixel of the picture, row by row, stands in the film.
    """

    work: Work
    first: int
    end: int
    spp: int
    film: Film
    order: NDArray[np.intp]


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
        picture = plane[partial.order]
        check = zlib.crc32(picture.data, check)
        yield picture.view(np.uint32).reshape(height, 2 * width)
    yield np.full((1, 2 * width), check, np.uint32)


def _planes(partial: Partial) -> Iterator[Plane]:
    yield partial.film.count.astype(np.float64)
    nodes = partial.film.nodes()
    for key in node_keys(partial.first, partial.end - partial.first):
        yield from nodes[key].reshape(6, -1)


def read_header(path: str | os.PathLike[str]) -> tuple[Work, int, int]:
    """What a file's samples are of, the first of them, and the one after the last. Raises as `read_partial`."""
    header, _ = _open(path)
    return header.work, *header.samples


def read_partial(
    path: str | os.PathLike[str], expected: Work | None = None, order: NDArray[np.intp] | None = None
) -> Partial:
    """Reads what `state_part` stored; by default the film has its pixels row by row.

    Raises:
        UsageError: the file is not readable, not of this kind, damaged, of another version of the format, or not of the
            `expected` work.
    """
    header, planes = _open(path)
    work, (first, end) = header.work, header.samples
    if expected is not None:
        require_same(path, work, expected)
    order = np.arange(work.width * work.height) if order is None else order
    count, nodes = np.empty(len(order), np.uint32), {}
    try:
        count[order] = next(planes)
        for key in node_keys(first, end - first):
            nodes[key] = np.empty((2, 3, len(order)))
            for sums in nodes[key].reshape(6, -1):
                sums[order] = next(planes)
        next(planes, None)
    except OSError as error:
        raise UsageError(f"{path}: damaged: {error}") from None
    film = Film(count, {0: nodes}, (end - first) * len(count) - int(count.sum()))
    return Partial(work, first, end, header.spp, film, order)


def _open(path: str | os.PathLike[str]) -> tuple[_Header, Iterator[Plane]]:
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
    return header, _read_planes(read, rows, work.height, zlib.crc32(text.encode()))


def _read_planes(read: Callable[[int, int], NDArray[np.uint32]], rows: int, height: int, check: int) -> Iterator[Plane]:
    """The planes; raises OSError after the last one if the check sum is wrong."""
    for row in range(0, rows - 1, height):
        plane = read(row, row + height)
        check = zlib.crc32(plane.data, check)
        yield plane.reshape(-1).view(np.float64)
    if (read(rows - 1, rows) != check).any():
        raise OSError("its check sum is wrong")
