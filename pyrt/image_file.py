"""Image files by OpenImageIO: channels, header, and where in a larger picture the pixels lie."""

from __future__ import annotations

import os
import time
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import UsageError
from pyrt.exr_state import StatePart, state_spec, write_state
from pyrt.settings import MAX_PIXELS, Window

MAX_HALF = 65504.0
_MAX_ID = 1 << 23  # OpenImageIO converts through float32: up to here, and 0xffffffff, whole numbers stay what they are
_ROWS = 64  # written at a time, which bounds memory; EXR compresses 16 together

Attribute = str | int | float | NDArray[np.float64]  # an array: a 4×4 matrix


class Layers(NamedTuple):
    """What an EXR file holds: as `write_exr` takes it."""

    pixels: NDArray[np.float32]  # (height, width, 3)
    planes: dict[str, NDArray[Any]]  # (height, width) float32 or uint32, by channel
    metadata: dict[str, Attribute]
    half: bool
    window: Window


def read_exr(path: str | os.PathLike[str]) -> Layers:
    """All channels of an EXR file's first part, and of the header what OpenImageIO does not write by itself.

    Raises:
        UsageError: no such file, not readable as an EXR file with channels R, G and B, or with more than 2^28 pixels.
    """
    import OpenImageIO as oiio

    if not (is_utf8(os.fspath(path)) and os.path.isfile(path)):
        raise UsageError(f"{path}: expected an EXR file, found none")
    file = oiio.ImageInput.open(os.fspath(path))
    if file is None:
        raise UsageError(f"{path}: not a readable image: {first_line(oiio.geterror())}")
    spec = file.spec()
    names = list(spec.channelnames)
    if file.format_name() != "openexr" or spec.deep:
        raise UsageError(f"{path}: expected {'a flat' if spec.deep else 'an'} EXR file, found {file.format_name()}")
    if not {"R", "G", "B"} <= set(names):
        raise UsageError(f"{path}: expected channels R, G and B, found {', '.join(names)}")
    if spec.width * spec.height > MAX_PIXELS:
        raise UsageError(f"{path}: expected at most 2^28 pixels, found {spec.width} x {spec.height}")
    whole = [i for i in range(len(names)) if str(spec.channelformat(i)) == "uint"]
    stored = file.read_image("float")
    exact: list[Any] = [file.read_image(0, 0, i, i + 1, "uint") for i in whole]
    if stored is None or any(plane is None for plane in exact):
        raise UsageError(f"{path}: not a readable image: {first_line(file.geterror())}")
    planes: dict[str, NDArray[Any]] = {name: stored[..., i] for i, name in enumerate(names)}
    planes |= {names[i]: plane[..., 0] for i, plane in zip(whole, exact, strict=True)}
    pixels = np.stack([planes.pop(name) for name in "RGB"], axis=2)
    half = str(spec.channelformat(names.index("R"))) == "half"
    window = Window(spec.x, spec.y, spec.x + spec.width, spec.y + spec.height, spec.full_width, spec.full_height)
    return Layers(pixels, planes, _attributes(spec), half, window)


def _attributes(spec: Any) -> dict[str, Attribute]:
    own = {"DateTime", "compression", "screenWindowCenter", "screenWindowWidth"}
    found: dict[str, Attribute] = {}
    for attribute in spec.extra_attribs:
        name, value = attribute.name, attribute.value
        if name in own or name.startswith(("oiio:", "openexr:")):
            continue
        if isinstance(value, tuple) and len(value) == 16:
            found[name] = np.array(value, np.float64).reshape(4, 4)
        elif isinstance(value, str | int | float):
            found[name] = value
    return found


def write_exr(
    path: Path,
    pixels: NDArray[np.float32],
    planes: Mapping[str, NDArray[Any]],
    metadata: Mapping[str, Attribute],
    half: bool,
    window: Window | None,
    state: StatePart | None,
) -> tuple[str, ...]:
    """Arguments and warnings as for `image_io.write_image`. Raises OSError."""
    warnings = []
    too_bright = sum(int(np.sum(np.abs(part) > MAX_HALF)) for part in in_rows(pixels)) if half else 0
    if too_bright:
        pixels = np.clip(pixels, -MAX_HALF, MAX_HALF)
        warnings.append(f"{too_bright} values above {MAX_HALF:g} are clamped to that, the largest half float")
    inexact = [name for name, plane in planes.items() if _has_large_ids(plane)]
    for name in inexact:
        problem = f"it holds numbers above {_MAX_ID}, which OpenImageIO would round"
        warnings.append(f"{name} is left out: {problem}; Result.aovs in Python has it")
    stored = {"R": pixels[..., 0], "G": pixels[..., 1], "B": pixels[..., 2]}
    stored |= {name: plane for name, plane in planes.items() if name not in inexact}
    kinds = ["half" if half else "float"] * 3 + ["uint" if p.dtype.kind == "u" else "float" for p in planes.values()]
    height, width, _ = pixels.shape
    spec = image_spec((height, width, len(stored)), kinds[0], {**date(), **metadata}, window)
    spec.channelnames, spec.channelformats = tuple(stored), tuple(kinds[: len(stored)])
    write_file(path, spec, _blocks(list(stored.values())), state)
    return tuple(warnings)


def _has_large_ids(plane: NDArray[Any]) -> bool:
    return plane.dtype.kind == "u" and bool(((plane > _MAX_ID) & (plane < 0xFFFFFFFF)).any())


def _blocks(channels: list[NDArray[Any]]) -> Iterator[NDArray[np.float32]]:
    """Rows of all channels; the whole numbers of 32 bits as the fractions of 2^32 − 1 that OpenImageIO takes."""
    for rows in zip(*(in_rows(channel) for channel in channels), strict=True):
        yield np.dstack([(c / 0xFFFFFFFF if c.dtype.kind == "u" else c).astype(np.float32) for c in rows])


def in_rows(image: NDArray[Any]) -> Iterator[NDArray[Any]]:
    """The image in parts of some rows."""
    return (image[row : row + _ROWS] for row in range(0, len(image), _ROWS))


def image_spec(
    shape: tuple[int, ...], kind: str, attributes: Mapping[str, Attribute], window: Window | None = None
) -> Any:
    """OpenImageIO's header for (height, width, channels) pixels."""
    import OpenImageIO as oiio

    spec = oiio.ImageSpec(shape[1], shape[0], shape[2], kind)
    if window is not None:
        spec.x, spec.y, spec.full_width, spec.full_height = window.x0, window.y0, window.width, window.height
    for name, value in attributes.items():
        if isinstance(value, np.ndarray):
            spec.attribute(name, oiio.TypeDesc("matrix"), tuple(value.ravel().tolist()))
        elif isinstance(value, str):  # names of files need not be text
            spec.attribute(name, value.encode(errors="backslashreplace").decode())
        else:  # integer attributes have 32 bits
            spec.attribute(name, str(value) if isinstance(value, int) and abs(value) >= 2**31 else value)
    return spec


def write_file(path: Path, spec: Any, blocks: Iterable[NDArray[Any]], state: StatePart | None = None) -> None:
    """Writes (rows, width, channels) blocks, all rows in order. Raises OSError."""
    import OpenImageIO as oiio

    file = oiio.ImageOutput.create(os.fspath(path))
    if file is None:
        raise OSError(first_line(oiio.geterror()))
    name, specs = os.fspath(path), [spec] if state is None else [spec, state_spec(spec, state)]
    written = file.open(name, specs)
    row = spec.y
    for block in blocks if written else ():
        written = written and file.write_scanlines(row, row + len(block), 0, np.ascontiguousarray(block))
        row += len(block)
    if written and state is not None:
        written = file.open(name, specs[1], "AppendSubimage") and write_state(file, state)
    if not (written and file.close()):
        raise OSError(first_line(file.geterror()))


def date() -> dict[str, str]:
    """The header's date: SOURCE_DATE_EPOCH if that is set, so that files can be reproduced, else now."""
    seconds = int(os.environ.get("SOURCE_DATE_EPOCH", time.time()))
    return {"DateTime": time.strftime("%Y:%m:%d %H:%M:%S", time.gmtime(seconds))}


def is_utf8(path: str) -> bool:
    """Whether OpenImageIO can take the name; Python's file functions take any."""
    return path.isascii() or not any("\ud800" <= c <= "\udfff" for c in path)


def first_line(message: str) -> str:
    """Of what OpenImageIO says."""
    return message.strip().split("\n")[0].rstrip(".")
