"""Reads textures and writes pictures, by OpenImageIO. Colours are linear Rec.709, row 0 is at the top."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import PyrtError, SceneError, UsageError
from pyrt.exr_state import StatePart
from pyrt.files import check_file, check_target, replacing
from pyrt.image_file import Attribute, date, first_line, image_spec, in_rows, is_utf8, write_exr, write_file
from pyrt.image_tools import check_view, viewed
from pyrt.layout import aligned_empty
from pyrt.room import available
from pyrt.settings import Window

MAX_TEXTURE_SIDE = 32768
MAX_TEXELS = 2**28  # as many as a picture may have: 3 GiB of float32 RGB
MAX_EXPOSURE = 120  # whose gain float32 holds
_UNASKED = 64 << 20  # bytes; to ask how much memory there is takes a millisecond

_DISPLAY = {".png", ".jpg", ".jpeg"}
_LINEAR = {".exr", ".hdr", ".tif", ".tiff", ".npy"}

Image = NDArray[np.float32]


class TextureData(NamedTuple):
    """A texture's colours, and what was dropped on reading it."""

    pixels: Image  # (height, width, 3)
    warnings: tuple[str, ...] = ()


class Picture(NamedTuple):
    """A picture's colours, and whether the file holds them for a display: on the sRGB curve, ending at white."""

    pixels: Image  # (height, width, 3), linear
    display: bool


def srgb_to_linear(values: NDArray[Any]) -> NDArray[Any]:
    """Decodes the sRGB curve (IEC 61966-2-1)."""
    return np.where(values <= 0.04045, values / 12.92, (np.maximum(values, 0.04045) + 0.055) ** 2.4 / 1.055**2.4)


def linear_to_srgb(values: NDArray[Any]) -> NDArray[Any]:
    """Encodes with the sRGB curve (IEC 61966-2-1)."""
    return np.where(values <= 0.0031308, values * 12.92, 1.055 * np.maximum(values, 0.0031308) ** (1 / 2.4) - 0.055)


def read_texture(path: str | os.PathLike[str], colorspace: str | None = None) -> TextureData:
    """Reads the colours of an image file, decoded to linear.

    `colorspace`, "srgb" or "linear", overrides the file's own tag; a file without one is sRGB if its pixels are
    integers and linear if they are floats. Grey becomes RGB. Colours are taken as stored, and alpha is dropped, with a
    warning where it is not 1 everywhere.

    Raises:
        SceneError: no such file, not readable as an image, more than 32768 pixels on a side or 2^28 in all (found
            before the pixels are read), or a texel that is not finite.
        PyrtError: it would not fit into memory.
    """
    stored, spec = _read(path)
    pixels = _decoded(stored, _color_channels(spec, path), colorspace or _stored_colorspace(spec))
    if not np.isfinite(pixels).all():
        raise SceneError(f"{path}: {np.sum(~np.isfinite(pixels).all(axis=2))} pixels are not finite")
    alpha = stored[..., spec.alpha_channel] if spec.alpha_channel >= 0 else None
    opaque = alpha is None or (alpha == (np.iinfo(alpha.dtype).max if alpha.dtype.kind == "u" else 1)).all()
    return TextureData(pixels, () if opaque else (f"{path}: the image's alpha is not used",))


def read_picture(path: str | os.PathLike[str]) -> Picture:
    """Reads the colours of an image file, or of an array (h, w, 3) in NPY, decoded to linear; the rest is left out.

    Raises:
        UsageError: as SceneError of `read_texture`, but pixels need not be finite.
    """
    try:
        if Path(path).suffix.lower() == ".npy":
            return Picture(_read_npy(path), False)
        stored, spec = _read(path)
        colorspace = _stored_colorspace(spec)
        return Picture(_decoded(stored, _color_channels(spec, path), colorspace), colorspace == "srgb")
    except SceneError as error:
        raise UsageError(str(error)) from None


def _read_npy(path: str | os.PathLike[str]) -> Image:
    check_file(path)
    try:
        with np.errstate(over="ignore"):
            # mapped: no more than the file holds is allocated
            array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (ValueError, OverflowError) as error:
        raise SceneError(f"{path}: not a readable array: {first_line(str(error)).lower()}") from None
    if array.ndim != 3 or array.shape[2] != 3 or not array.size or array.dtype.kind not in "fiu":
        raise SceneError(f"{path}: expected an array (height, width, 3) of numbers, found {array.shape} {array.dtype}")
    return np.array(array, np.float32)


def is_picture(path: str | os.PathLike[str]) -> bool:
    """Whether the name's extension is of a picture: NPY, or a format of OpenImageIO's."""
    import OpenImageIO as oiio

    formats = oiio.get_string_attribute("extension_list")  # "tiff:tif,tiff;png:png"
    extensions = {extension for names in formats.split(";") for extension in names.partition(":")[2].split(",")}
    return Path(path).suffix.lower().removeprefix(".") in extensions | {"npy"}


def _read(path: str | os.PathLike[str]) -> tuple[NDArray[Any], Any]:
    """All channels as they are stored, and OpenImageIO's description of the file. Raises SceneError."""
    import OpenImageIO as oiio

    check_file(path)
    if not is_utf8(os.fspath(path)):
        raise SceneError(f"{path}: expected a name that can be written as UTF-8")
    hints = oiio.ImageSpec()
    hints.attribute("oiio:UnassociatedAlpha", 1)  # else the colours of PNG come multiplied by alpha
    file = oiio.ImageInput.open(os.fspath(path), hints)
    if file is None:
        raise SceneError(f"{path}: not a readable image: {first_line(oiio.geterror())}")
    spec = file.spec()
    if max(spec.width, spec.height) > MAX_TEXTURE_SIDE or spec.width * spec.height > MAX_TEXELS:
        raise SceneError(
            f"{path}: the image has {spec.width} x {spec.height} pixels, "
            f"expected at most {MAX_TEXTURE_SIDE} on a side and {MAX_TEXELS} in all"
        )
    if spec.deep or spec.depth > 1:
        raise SceneError(f"{path}: expected a flat image, found a {'deep' if spec.deep else 'volume'} image")
    _require_room(path, spec)
    kind = str(spec.format)
    stored = file.read_image(kind if kind in ("uint8", "uint16") else "float")
    if stored is None:
        raise SceneError(f"{path}: not a readable image: {first_line(file.geterror())}")
    return stored, spec


def _require_room(path: str | os.PathLike[str], spec: Any) -> None:
    """Raises PyrtError unless there is memory for the pixels as they are stored, and for their colours."""
    channel = {"uint8": 1, "uint16": 2}.get(str(spec.format), 4)
    need = spec.width * spec.height * (spec.nchannels * channel + 12)
    if need > _UNASKED and need > (free := available()):
        size = f"{spec.width} x {spec.height} pixels of {spec.nchannels} channels"
        found = f"{need / 2**30:.3g} GiB of free memory for {size}, found {free / 2**30:.3g} GiB"
        raise PyrtError(f"{path}: expected {found}")


def _color_channels(spec: Any, path: str | os.PathLike[str]) -> list[int]:
    names = [name.upper() for name in spec.channelnames]
    for wanted in (("R", "G", "B"), ("Y", "Y", "Y")):
        if set(wanted) <= set(names):
            return [names.index(name) for name in wanted]
    raise SceneError(f"{path}: expected channels R, G, B or Y, found {', '.join(spec.channelnames)}")


def _stored_colorspace(spec: Any) -> str:
    tag = str(spec.getattribute("oiio:ColorSpace") or "")
    if tag.startswith(("lin_", "linear", "scene_linear")):
        return "linear"
    return "srgb" if tag.startswith("srgb") or str(spec.format) not in ("half", "float", "double") else "linear"


def _decoded(stored: NDArray[Any], channels: list[int], colorspace: str) -> Image:
    """(height, width, 3), some rows at a time: a copy of all, or indices of 64 bits, would take most of the memory."""
    decoded: Image = aligned_empty(stored.shape[0] * stored.shape[1] * 3, np.float32).reshape(*stored.shape[:2], 3)
    whole = stored.dtype.kind == "u"
    values = np.linspace(0, 1, np.iinfo(stored.dtype).max + 1) if whole else np.empty(0)
    table = (srgb_to_linear(values) if colorspace == "srgb" else values).astype(np.float32)
    for part, out in zip(in_rows(stored), in_rows(decoded), strict=True):
        colors = part[..., channels]
        if whole:
            np.take(table, colors, out=out, mode="clip")  # the other modes copy
        else:
            with np.errstate(over="ignore"):  # infinite then, which the caller checks
                out[...] = srgb_to_linear(colors) if colorspace == "srgb" else colors
    return decoded


def check_output(path: str | os.PathLike[str], exposure: float = 0.0, view: str | None = None) -> None:
    """Raises UsageError if `write_image` could not write that: an unknown extension, no folder to write to, an exposure
    that is out of range, or an unknown view."""
    target = Path(path)
    extensions = sorted(_DISPLAY | _LINEAR)
    if target.suffix.lower() not in extensions:
        raise UsageError(f"{os.fspath(path) or 'output'}: expected a name ending in {', '.join(extensions)}")
    if not is_utf8(os.path.realpath(target)):
        raise UsageError(f"{path}: expected a name, in folders, that can be written as UTF-8")
    check_target(path)
    check_exposure(exposure)
    check_view(view)


def is_display(path: str | os.PathLike[str]) -> bool:
    """Whether the name's extension is of a format that holds pictures as displays show them."""
    return Path(path).suffix.lower() in _DISPLAY


def check_exposure(exposure: float) -> None:
    """Raises UsageError for an exposure that is out of range."""
    if not abs(exposure) <= MAX_EXPOSURE:
        raise UsageError(f"exposure: expected stops from {-MAX_EXPOSURE} to {MAX_EXPOSURE}, got {exposure:g}")


def write_image(
    path: str | os.PathLike[str],
    image: NDArray[Any],
    *,
    exposure: float = 0.0,
    view: str | None = None,
    metadata: Mapping[str, Attribute] | None = None,
    planes: Mapping[str, NDArray[Any]] | None = None,
    half: bool = True,
    window: Window | None = None,
    state: StatePart | None = None,
) -> tuple[str, ...]:
    """Writes an (h, w, 3) linear image in the format of the extension, all of the file or nothing.

    PNG and JPEG hold 8 bits on the sRGB curve, dithered by OpenImageIO's fixed blue noise, after a gain of 2^exposure;
    no tone mapping, unless `view` names a view of OpenColorIO's built-in configuration (see `image_tools.VIEWS`). EXR
    (half, or float), HDR, TIFF (float) and NPY (float) hold linear values and ignore the exposure and the view.

    Into EXR files only go `planes`, (h, w) arrays by channel name, as float channels, or 32-bit whole numbers where the
    array has unsigned ones; `metadata`, header attributes; `window`, where in a larger picture the image lies (the data
    window in the display window); and `state`, as a part of its own. The header's date is SOURCE_DATE_EPOCH if that is
    set, so that files can be reproduced.

    Returns:
        Warnings: half channels end at 65504, brighter values are clamped to that; a channel of whole numbers above 2^23
        (but 2^32 − 1) is left out, as OpenImageIO would round them.

    Raises:
        UsageError: as `check_output`.
        PyrtError: writing failed, for instance because the disk is full.
    """
    check_output(path, exposure, view)
    extension = Path(path).suffix.lower()
    pixels = np.asarray(image, np.float32)
    warnings: tuple[str, ...] = ()
    try:
        with replacing(path) as temporary:
            if extension == ".npy":
                np.save(temporary, pixels)
            elif extension in _DISPLAY:
                _write_display(temporary, pixels, 2.0**exposure, view)
            elif extension == ".exr":
                warnings = write_exr(temporary, pixels, planes or {}, metadata or {}, half, window, state)
            else:
                write_file(temporary, image_spec(pixels.shape, "float", date()), [pixels])
    except OSError as error:
        raise PyrtError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None
    return tuple(f"{path}: {warning}" for warning in warnings)


def _write_display(path: Path, pixels: Image, gain: float, view: str | None) -> None:
    attributes: dict[str, Attribute] = {
        "oiio:ColorSpace": "sRGB",
        "oiio:dither": 1,
        "png:compressionLevel": 4,  # of 9; the default makes files 6 % smaller and takes three times as long
        "Compression": "png" if path.suffix.lower() == ".png" else "jpeg:95",
        "jpeg:subsampling": "4:4:4",
    }
    parts: Iterable[Image]
    if view is None:
        parts = (linear_to_srgb(np.clip(_finite(part, gain), 0, 1)).astype(np.float32) for part in in_rows(pixels))
    else:
        parts = [viewed(_finite(pixels, gain), view)]
    write_file(path, image_spec(pixels.shape, "uint8", attributes), parts)


def _finite(pixels: Image, gain: float) -> Image:
    with np.errstate(over="ignore"):  # white then
        return np.asarray(np.nan_to_num(pixels * np.float32(gain)))
