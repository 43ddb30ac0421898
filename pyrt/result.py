"""A rendered picture, and the files that it becomes."""

from __future__ import annotations

import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt import __version__
from pyrt.aov import exr_planes
from pyrt.camera import FilmPlane, film_plane, world_to_camera, world_to_ndc
from pyrt.image_file import Attribute
from pyrt.partial import Partial, PartialAdaptive
from pyrt.partial_file import state_part
from pyrt.scene import Scene
from pyrt.settings import Window


@dataclass(frozen=True)
class Result:
    """A rendered picture.

    Attributes:
        image: (height, width, 3) float32, linear Rec.709 radiance, row 0 at the top.
        variance: (height, width, 3) float32, estimated variance of each pixel's mean (an upper estimate, as the samples
            are stratified).
        samples: (height, width) uint32, samples that each pixel's mean holds.
        stats: seconds per stage, rays traced and skipped, the device, the features compiled in, and with a noise target
            or a time limit the estimated relative error that was reached.
        partial: what goes on from here needs, if the render had a checkpoint or a range of samples. EXR files hold it
            too then.
        aovs: what was asked for beside the picture, by name: (height, width) or (height, width, channels); `aov.AOVS`
            tells what each holds, and its dtype. EXR files hold them too.
        denoised: (height, width, 3) float32, the denoised image, if that was asked for. EXR files hold both; other
            formats this one.
        window: the picture's pixels, of which picture.
        metadata: what EXR files say about the picture, by attribute. With SOURCE_DATE_EPOCH set, its seconds are left
            out, so that equal pictures have equal bytes.
    """

    image: NDArray[np.float32]
    variance: NDArray[np.float32]
    samples: NDArray[np.uint32]
    stats: dict[str, Any] = field(default_factory=dict)
    partial: Partial | PartialAdaptive | None = None
    aovs: dict[str, NDArray[Any]] = field(default_factory=dict)
    denoised: NDArray[np.float32] | None = None
    window: Window | None = None
    metadata: dict[str, Attribute] = field(default_factory=dict)

    def save(
        self, path: str | Path, *, exposure: float = 0.0, view: str | None = None, half: bool = True
    ) -> tuple[str, ...]:
        """Writes the picture, all of the file or nothing. Returns warnings about what the format cannot hold.

        Args:
            path: a name ending in .exr, .hdr, .tif, .tiff or .npy, for linear values, or .png, .jpg or .jpeg.
            exposure: PNG and JPEG are brightened by 2^exposure.
            view: how PNG and JPEG show what is brighter than white: None clips, "aces" is a film-like tone curve.
            half: 16 bits for the colours of EXR files; else 32.

        Raises:
            UsageError: the name has another ending, there is no such folder or no such view.
            PyrtError: the file cannot be written.
        """
        from pyrt.image_io import write_image

        exr = Path(path).suffix.lower() == ".exr"
        planes = exr_planes(self.aovs)
        if self.denoised is not None:
            planes |= {f"denoised.{c}": self.denoised[..., i] for i, c in enumerate("RGB")}
        return write_image(
            path,
            self.image if exr or self.denoised is None else self.denoised,
            exposure=exposure,
            view=view,
            metadata=self.metadata,
            planes=planes,
            half=half,
            window=self.window,
            state=state_part(self.partial) if self.partial is not None else None,
        )

    def __repr__(self) -> str:
        height, width, _ = self.image.shape
        return f"<Result {width}x{height}, {self.samples.mean():.4g} spp>"

    def _repr_png_(self) -> bytes:
        """The picture as a PNG file, which notebooks show in place of the result."""
        with TemporaryDirectory() as folder:
            path = Path(folder, "result.png")
            self.save(path)
            return path.read_bytes()


def sample_metadata(scene: str, seed: int, first: int, spp: int, device: str) -> dict[str, Attribute]:
    """Header attributes of a picture that holds `spp` samples of each pixel from the `first` on, or fewer of some.

    `scene` is its hash.
    """
    return {
        "Software": f"pyrt {__version__}",
        "pyrt:scene_hash": scene,
        "pyrt:seed": seed,
        "pyrt:first_sample": first,
        "pyrt:spp": spp,
        "pyrt:device": device,
    }


@dataclass(frozen=True)
class Beside:
    """What a picture comes with, beside its samples.

    Attributes:
        scene_hash: see there.
        window: its pixels.
        aovs: those that were asked for, by name; None for variance and samples.
    """

    scene: Scene
    scene_hash: str
    seed: int
    window: Window
    aovs: dict[str, NDArray[Any] | None]

    def added_to(self, result: Result) -> Result:
        """The result with that."""
        sampled = {"variance": result.variance, "samples": result.samples}
        aovs = {name: sampled[name] if array is None else array for name, array in self.aovs.items()}
        return replace(result, aovs=aovs, window=self.window, metadata=self._metadata(result))

    def _metadata(self, result: Result) -> dict[str, Attribute]:
        size, partial = (self.window.width, self.window.height), result.partial
        plane = film_plane(self.scene.camera, *size)
        first = partial.first if isinstance(partial, Partial) else 0
        spp = int(result.samples.max())
        out = sample_metadata(self.scene_hash, self.seed, first, spp, result.stats["device"])
        out |= {
            "pyrt:scene": self.scene.name,
        } | _matrices(plane, *size)
        if "SOURCE_DATE_EPOCH" not in os.environ:
            out["pyrt:seconds"] = float(sum(result.stats["seconds"].values()))
        return out


def _matrices(plane: FilmPlane, width: int, height: int) -> dict[str, Attribute]:
    """Those that a header's float32 can hold: a film of next to no angle has none."""
    with np.errstate(all="ignore"):
        try:
            found = {"worldToCamera": world_to_camera(plane), "worldToNDC": world_to_ndc(plane, width, height)}
        except np.linalg.LinAlgError:
            return {}
    return {name: matrix for name, matrix in found.items() if np.abs(matrix).max() <= np.finfo(np.float32).max}
