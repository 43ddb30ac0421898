"""Passes of bounded memory over (pixels × samples), and the result they add up to."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.device import LOCAL_SIZE, Device
from pyrt.errors import UsageError
from pyrt.features import build_options, feature_table
from pyrt.film import Film
from pyrt.layout import constants, dtypes
from pyrt.pack import pack_camera, pack_scene
from pyrt.scene import Scene

PASS_SAMPLES = 1 << 21  # samples of one pass, by default: 24 MiB of radiance
_TILE = 4  # pixels along a side: a beam's pixels, if they all lie in the picture
_PLANE_PAD = 16  # floats between planes beyond the pixels, so that planes do not share cache sets

Progress = Callable[[dict[str, Any]], Any]


@dataclass(frozen=True)
class Result:
    """A rendered picture.

    Attributes:
        image: (height, width, 3) float32, linear Rec.709 radiance, row 0 at the top.
        variance: (height, width, 3) float32, estimated variance of each pixel's mean (an upper estimate, as the samples
            are stratified).
        samples: (height, width) uint32, samples that each pixel's mean holds.
        stats: seconds per stage, rays traced and skipped, the device, the features compiled in.
    """

    image: NDArray[np.float32]
    variance: NDArray[np.float32]
    samples: NDArray[np.uint32]
    stats: dict[str, Any] = field(default_factory=dict)

    def save(self, path: str | Path, *, exposure: float = 0.0) -> tuple[str, ...]:
        """Writes the picture; the format follows from the extension. Returns warnings (see `image_io.write_image`)."""
        from pyrt.image_io import write_image

        return write_image(path, self.image, exposure=exposure)


class Renderer:
    """A scene on a device: tree, kernels and buffers are made once, `render` may be called many times.

    Args:
        scene: what to render.
        device: index or part of the name of an OpenCL device; None chooses.
        all_features: compile every feature in, needed or not (the image is the same).
        beams: look ahead what the rays of neighbouring pixels can hit (the image is the same).
    """

    def __init__(
        self,
        scene: Scene,
        device: str | int | None = None,
        *,
        all_features: bool = False,
        beams: bool = True,
        build_flags: tuple[str, ...] = (),
        progress: Progress | None = None,
    ):
        self.scene = scene
        self._progress = progress or (lambda event: None)
        self._seconds: dict[str, float] = {}
        self._features = feature_table(scene)
        self._progress({"stage": "build", "done": 0.0})
        start = perf_counter()
        self._packed = pack_scene(scene)
        self._seconds["build"] = perf_counter() - start
        self._progress({"stage": "compile", "done": 0.0})
        start = perf_counter()
        self._device = Device(device)
        self._beams = beams
        options = [*build_options(self._features, everything=all_features), f"-DHAS_BEAMS={int(beams)}", *build_flags]
        self._kernels = self._device.build("render.cl", options)
        self._seconds["compile"] = perf_counter() - start
        start = perf_counter()
        self._buffers = {name: self._device.upload(name, array) for name, array in self._packed.arrays.items()}
        self._seconds["upload"] = perf_counter() - start

    def render(
        self,
        spp: int | None = None,
        seed: int = 0,
        size: tuple[int, int] | None = None,
        *,
        pass_samples: int = PASS_SAMPLES,
        progress: Progress | None = None,
    ) -> Result:
        """Renders the scene.

        Args:
            spp: samples per pixel; None takes the scene's.
            seed: of the sample points, 0 … 2^32 − 1.
            size: (width, height) in pixels; None takes the film's.
            pass_samples: samples of one pass, which bounds memory; no influence on the image.
            progress: called with a dict after every pass.

        Raises:
            UsageError: an argument is out of range.
            DeviceError: the device failed.
        """
        width, height = size or (self.scene.film.width, self.scene.film.height)
        spp = self.scene.spp if spp is None else spp
        _check_arguments(spp, seed, width, height, pass_samples)
        progress = progress or self._progress
        pixels = _tiled_pixels(width, height)
        film = Film.empty(len(pixels))
        tally = _Tally()
        scene_params = self._device.upload("parameters", self._scene_params(width, height))
        pixel_buffer = self._device.upload("pixels", pixels)
        passes = _passes(len(pixels), spp, pass_samples)
        planes = self._device.allocate(4 * max(3 * p["sample_count"] * p["stride"] for p in passes))
        counts = self._device.allocate(16 * max(_groups(p) for p in passes))
        beams = self._device.allocate(max(_beams(p) for p in passes) * self._beam_bytes())
        for params in passes:
            params["seed"] = seed
            start = perf_counter()
            self._trace(params, scene_params, pixel_buffer, beams, planes, counts)
            tally.render_seconds += perf_counter() - start
            start = perf_counter()
            self._reduce(params, planes, counts, film, tally)
            tally.reduce_seconds += perf_counter() - start
            progress({"stage": "render", "done": tally.samples / (len(pixels) * spp), "samples": tally.samples})
        return self._result(film, pixels, width, height, tally)

    def _trace(self, params: NDArray[Any], scene_params: Any, pixels: Any, beams: Any, planes: Any, counts: Any) -> None:
        head = (params.tobytes(), scene_params)
        if self._beams:
            arrays = [self._buffers[name] for name in ("nodes", "triangle_blocks", "triangles", "lights")]
            self._device.run(self._kernels["trace_beams"], _beams(params), *head, *arrays, pixels, beams)
        self._device.run(
            self._kernels["render"], _items(params), *head, *self._buffers.values(), pixels, beams, planes, counts
        )

    def _beam_bytes(self) -> int:
        lights = int(self._packed.params["light_count"])
        return dtypes()["Candidates"].itemsize * (1 + lights * (lights <= constants()["SHAFT_LIGHTS"]))

    def _reduce(self, params: NDArray[Any], planes: Any, counts: Any, film: Film, tally: _Tally) -> None:
        shape = (int(params["sample_count"]), 3, int(params["stride"]))
        with self._device.mapped(planes, shape, np.float32) as array:
            pixels = int(params["pixel_count"])
            film.add(array[:, :, :pixels], int(params["first_pixel"]), int(params["first_sample"]))
        with self._device.mapped(counts, (_groups(params), 4), np.uint32) as array:
            tally.counts += array.sum(axis=0, dtype=np.int64)
        tally.samples += _items(params)

    def _scene_params(self, width: int, height: int) -> NDArray[Any]:
        params = self._packed.params.copy()
        params["max_depth"] = self.scene.max_depth
        params["camera"] = pack_camera(self._packed, self.scene.camera, width, height)
        return params

    def _result(self, film: Film, pixels: NDArray[np.uint32], width: int, height: int, tally: _Tally) -> Result:
        def picture(planes: NDArray[Any], dtype: type) -> NDArray[Any]:
            out = np.empty((height, width, *planes.shape[:-1]), dtype)
            out[pixels >> 16, pixels & 0xFFFF] = planes.T
            return out

        specular, shadow, dark, clear = (int(n) for n in tally.counts)
        stats = {
            "seconds": {**self._seconds, "render": tally.render_seconds, "reduce": tally.reduce_seconds},
            "samples": tally.samples,
            "rays": {"camera": tally.samples, "specular": specular, "shadow": shadow},
            "skipped": {"shadow_rays_to_dark_lights": dark, "shadow_rays_in_clear_shafts": clear},
            "dropped": {"samples": film.dropped, "triangles": self._packed.report["dropped_triangles"]},
            "scene": self._packed.report,
            "device": str(self._device.info),
            "features": {row.macro: row.on for row in self._features},
        }
        mean, variance = picture(film.mean(), np.float32), picture(film.variance(), np.float32)
        return Result(mean, variance, picture(film.count, np.uint32), stats)


@dataclass
class _Tally:
    """What the passes of one render added up to."""

    samples: int = 0
    render_seconds: float = 0.0
    reduce_seconds: float = 0.0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))


def _check_arguments(spp: int, seed: int, width: int, height: int, pass_samples: int) -> None:
    for name, value, low, high in (
        ("spp", spp, 1, 2**30),
        ("seed", seed, 0, 2**32 - 1),
        ("width", width, 1, 65536),
        ("height", height, 1, 65536),
        ("pass_samples", pass_samples, 1, 2**28),
    ):
        if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
            raise UsageError(f"{name}: expected a whole number from {low} to {high}, got {value!r}")


def _tiled_pixels(width: int, height: int) -> NDArray[np.uint32]:
    """All pixels as x + 65536 · y, tile by tile."""
    y, x = np.mgrid[0:height, 0:width].astype(np.uint32)
    tile = (y // _TILE) * np.uint32(-(-width // _TILE)) + x // _TILE
    order = np.argsort(tile.ravel(), kind="stable")
    return np.asarray(((y << np.uint32(16)) | x).ravel()[order])


def _passes(pixels: int, spp: int, pass_samples: int) -> list[NDArray[Any]]:
    """PassParams of each pass: all samples of some pixels, or, if there are too many, a range of them at a time."""
    sample_step = min(spp, pass_samples)
    pixel_step = max(1, pass_samples // sample_step)
    passes = []
    for first_pixel in range(0, pixels, pixel_step):
        for first_sample in range(0, spp, sample_step):
            params = np.zeros((), dtypes()["PassParams"])
            params["first_pixel"], params["first_sample"] = first_pixel, first_sample
            params["pixel_count"] = min(pixel_step, pixels - first_pixel)
            params["sample_count"] = min(sample_step, spp - first_sample)
            params["stride"] = params["pixel_count"] + _PLANE_PAD
            passes.append(params)
    return passes


def _items(params: NDArray[Any]) -> int:
    return int(params["pixel_count"]) * int(params["sample_count"])


def _beams(params: NDArray[Any]) -> int:
    return -(-int(params["pixel_count"]) // constants()["BEAM_PIXELS"])


def _groups(params: NDArray[Any]) -> int:
    return -(-_items(params) // LOCAL_SIZE)
