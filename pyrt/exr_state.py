"""A second part of an EXR file, for what is no picture: an image of 32-bit words, which viewers do not show."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import UsageError

_STATE = "pyrt:state"  # the header attribute
_ROWS = 64  # copied at a time, which bounds memory


class StatePart(NamedTuple):
    """What to write."""

    header: str
    rows: int
    row_words: int
    blocks: Iterator[NDArray[np.uint32]]  # (any number of rows, row_words) each, all rows in order


def state_spec(picture: Any, state: StatePart) -> Any:
    """The part's ImageSpec, beside that of the picture."""
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(state.row_words, state.rows, 1, "uint")
    spec.full_width, spec.full_height = picture.full_width, picture.full_height  # one for all parts of a file
    spec.channelnames = ("words",)
    picture.attribute("oiio:subimagename", "picture")
    spec.attribute("oiio:subimagename", "state")
    spec.attribute("Compression", "none")
    spec.attribute(_STATE, state.header)
    return spec


def write_state(file: Any, state: StatePart) -> bool:
    """Writes the part to an ImageOutput that has been opened for it; False if that failed."""
    row = 0
    for block in state.blocks:
        if not file.write_scanlines(row, row + len(block), 0, block[..., None]):
            return False
        row += len(block)
    return True


def read_state(path: str | os.PathLike[str]) -> tuple[str, int, int, Callable[[int, int], NDArray[np.uint32]]]:
    """Of an EXR file's state part: header, rows, words of a row, and a function that reads rows first … end − 1, which
    raises OSError where the file is damaged.

    Raises:
        UsageError: no such file, or none with such a part.
    """
    if not os.path.isfile(path):
        raise UsageError(f"{path}: expected a file that pyrt wrote with --checkpoint or --samples, found none")
    file, header = _open(path)
    if header is None:
        raise UsageError(f"{path}: expected a file that pyrt wrote with --checkpoint or --samples")
    spec = file.spec()
    if 4 * spec.width * spec.height > os.path.getsize(path):
        raise UsageError(f"{path}: damaged: it is shorter than its header says")

    def read(first: int, end: int) -> NDArray[np.uint32]:
        words = file.read_scanlines(1, 0, first, end, 0, 0, 1, "uint")
        if words is None:
            raise OSError(file.geterror().strip())
        return np.asarray(words, np.uint32).reshape(end - first, -1)

    return header, spec.height, spec.width, read


def stored_state(path: str | os.PathLike[str]) -> StatePart | None:
    """An EXR file's state part, for another file; None if it has none. Its blocks raise OSError where it is damaged.

    Raises:
        UsageError: the part is shorter than its header says.
    """
    if _open(path)[1] is None:
        return None
    header, rows, row_words, read = read_state(path)
    blocks = (read(row, min(row + _ROWS, rows)) for row in range(0, rows, _ROWS))
    return StatePart(header, rows, row_words, blocks)


def _open(path: str | os.PathLike[str]) -> tuple[Any, str | None]:
    """OpenImageIO's file at its state part, and the part's header; no header if there is no such file or part."""
    import OpenImageIO as oiio

    file = oiio.ImageInput.open(os.fspath(path))
    header = file.spec().getattribute(_STATE) if file is not None and file.seek_subimage(1, 0) else None
    if isinstance(header, str):
        return file, header
    oiio.geterror()  # else it is printed at the end
    return file, None
