"""Removing noise by Intel's Open Image Denoise, from the extra package pyoidn."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from pyrt.errors import PyrtError, UsageError

Image = NDArray[np.float32]


def require_denoiser() -> None:
    """Raises UsageError, one sentence with the command that helps, if pyoidn is not installed."""
    if find_spec("pyoidn") is None:
        raise UsageError("denoise: expected the package pyoidn, which is not installed; run: pip install pyoidn")


def stored_guides(planes: Mapping[str, Image]) -> tuple[Image, Image] | None:
    """Albedo and normal, (height, width, 3), of an EXR file's channels: those for denoising, else those of the first
    surface, else None."""
    for albedo, normal in (("denoising_albedo", "denoising_normal"), ("albedo", "N")):
        names = [f"{albedo}.{c}" for c in "RGB"] + [f"{normal}.{c}" for c in "XYZ"]
        if set(names) <= set(planes):
            both = np.stack([planes[name] for name in names], axis=2)
            return both[..., :3], both[..., 3:]
    return None


def denoised(image: Image, albedo: Image | None = None, normal: Image | None = None) -> Image:
    """The linear picture (height, width, 3) without noise.

    Args:
        albedo: (height, width, 3), and normal: (height, width, 3): what each pixel shows, averaged over it, without
            noise of their own. They keep textures and edges sharp.

    Raises:
        UsageError: pyoidn is not installed.
        PyrtError: Open Image Denoise failed.
    """
    require_denoiser()
    try:
        import pyoidn

        guides = {} if albedo is None or normal is None else {"albedo": np.clip(albedo, 0.0, 1.0), "normal": normal}
        out = pyoidn.denoise(np.ascontiguousarray(image, np.float32), **guides, hdr=True, clean_aux=bool(guides))
    except (OSError, RuntimeError) as error:  # its library does not load, or refuses
        raise PyrtError(f"Open Image Denoise failed: {error}") from error
    return np.asarray(out, np.float32)
