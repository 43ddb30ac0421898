"""Tracing samples in passes of bounded memory: (pixels × a range of samples) → a film."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.device import LOCAL_SIZE, Device
from pyrt.film import Film
from pyrt.layout import constants, dtypes

PASS_SAMPLES = 1 << 20  # samples of one pass, by default: 12 MiB of radiance
_PIXEL_SAMPLES = 1024  # of a pixel in one pass: with more, there would be few pixels, and sums over short rows
_TILE = 4  # pixels along a side: those of a beam follow each other
_PLANE_PAD = 16  # floats between planes beyond the pixels, so that planes do not share cache sets

MAX_BEAM_BYTES = 1 << 30  # of a whole picture


@dataclass
class Tally:
    """What the passes of one render added up to. `counts`: specular, shadow, dark, clear (see Counters in direct.h)."""

    samples: int = 0
    render_seconds: float = 0.0
    reduce_seconds: float = 0.0
    counts: NDArray[np.int64] = field(default_factory=lambda: np.zeros(4, np.int64))

    @property
    def rays(self) -> int:
        return self.samples + int(self.counts[0]) + int(self.counts[1])


@dataclass
class Scratch:
    """Buffers for what passes leave, kept for the next ones: the first touch of new memory costs more than using it."""

    device: Device
    buffers: dict[str, Any] = field(default_factory=dict)

    def buffer(self, name: str, nbytes: int) -> Any:
        """The buffer of that name, of at least this size; its content is whatever it was."""
        found = self.buffers.get(name)
        if found is None or found.size < nbytes:
            self.buffers[name] = None  # the old one goes before the new one comes
            self.buffers[name] = self.device.allocate(nbytes)
        return self.buffers[name]


@dataclass(frozen=True)
class Ahead:
    """The beams of a picture.

    Attributes:
        params: PassParams of one pass of all its pixels.
        pixels, starts, candidates: buffers of these, of each beam's first pixel, and of what the beams meet.
        beams: (pixels,) uint32, the beam of each pixel.
    """

    params: NDArray[Any]
    pixels: Any
    starts: Any
    candidates: Any
    beams: NDArray[np.uint32]


@dataclass(frozen=True)
class Traced:
    """A pass: its parameters, and buffers of its samples and its pixels' places, until the next is asked for."""

    params: NDArray[Any]
    planes: Any
    places: Any


@dataclass(frozen=True)
class SampleTracer:
    """Traces samples of one picture: the scene's buffers, the picture's parameters, and how to cut passes.

    Attributes:
        kernels: of render.cl, by name.
        buffers: the scene's arrays, in the order of the kernel's arguments.
        parameters: buffer of SceneParams.
        beam_bytes: of one beam and its shafts; 0: no beams.
        scratch: of the same device.
        pass_samples: at most so many samples in a pass, or one of each pixel of a beam.
        after_pass: called after every pass; returning False stops.
    """

    device: Device
    kernels: dict[str, Any]
    buffers: dict[str, Any]
    parameters: Any
    beam_bytes: int
    scratch: Scratch
    seed: int
    pass_samples: int
    tally: Tally
    after_pass: Callable[[], bool]

    def look_ahead(self, pixels: NDArray[np.uint32]) -> Ahead | None:
        """The beams of all pixels of a picture, for `trace`; None if there are none, or too many to keep."""
        starts, beams = _beams_of(pixels)
        size = len(starts) * self.beam_bytes
        if not 0 < size <= min(MAX_BEAM_BYTES, self.device.info.max_alloc):
            return None
        params = _pass_params(0, len(pixels), 0, 1)
        start = perf_counter()
        buffers = self.device.upload("pixels", pixels), self.device.upload("starts", starts)
        ahead = Ahead(params, *buffers, self.scratch.buffer("beams ahead", size), beams)
        self._trace_beams(params, len(starts), ahead.pixels, ahead.starts, ahead.candidates)
        self.tally.render_seconds += perf_counter() - start
        return ahead

    def trace(
        self,
        pixels: NDArray[np.uint32],
        first_sample: int,
        samples: int,
        ahead: Ahead | None = None,
        places: NDArray[np.intp] | None = None,
    ) -> tuple[Film, int]:
        """Samples first_sample … first_sample + samples − 1 of each pixel (x + 65536 · y).

        With the beams of a picture, `places` tells where in its list the pixels stand; else each pass makes its own.
        Returns the film of these pixels, and how many of them, from the first on, are complete: all, unless stopped.
        """
        film = Film.empty(len(pixels))
        for traced in self.passes(pixels, first_sample, samples, ahead, places):
            self._reduce(traced, film)
            if not self.after_pass():
                return film, _keep_complete(film, traced.params, first_sample + samples)
        return film, len(pixels)

    def whole(self, samples: int) -> bool:
        """Whether each pass has so many samples of its pixels, instead of a part of them."""
        return pass_shape(samples, self.pass_samples)[1] == samples

    def passes(
        self,
        pixels: NDArray[np.uint32],
        first_sample: int,
        samples: int,
        ahead: Ahead | None = None,
        places: NDArray[np.intp] | None = None,
    ) -> Iterator[Traced]:
        """Traces what `trace` does, and shows each pass. Its caller asks `after_pass` whether to go on."""
        passes = _passes(len(pixels), first_sample, samples, self.pass_samples)
        pixel_buffer = self.device.upload("pixels", pixels)
        planes = self.scratch.buffer("planes", 4 * max(3 * int(p["sample_count"]) * int(p["stride"]) for p in passes))
        counts = self.scratch.buffer("counts", 16 * max(_groups(p) for p in passes))
        listed = pixel_buffer if places is None else self.device.upload("places", np.asarray(places, np.uint32))
        for params in passes:
            params["seed"] = self.seed
            start = perf_counter()
            beams, candidates = self._beams(params, pixels, pixel_buffer, ahead, places)
            scene = (params.tobytes(), self.parameters, *self.buffers.values())
            lists = (pixel_buffer, beams, candidates, planes, counts)
            self.device.run(self.kernels["render"], _items(params), *scene, *lists)
            self.tally.render_seconds += perf_counter() - start
            start = perf_counter()
            with self.device.mapped(counts, (_groups(params), 4), np.uint32) as array:
                self.tally.counts += array.sum(axis=0, dtype=np.int64)
            self.tally.samples += _items(params)
            yield Traced(params, planes, listed)
            self.tally.reduce_seconds += perf_counter() - start

    def _beams(
        self,
        params: NDArray[Any],
        pixels: NDArray[np.uint32],
        pixel_buffer: Any,
        ahead: Ahead | None,
        places: NDArray[np.intp] | None,
    ) -> tuple[Any, Any]:
        """Buffers of the beam of each pixel of a pass, and of what the beams meet: of a picture, or traced now."""
        first = int(params["first_pixel"])
        part = slice(first, first + int(params["pixel_count"]))
        if ahead is not None and places is not None:
            return self.device.upload("beams", ahead.beams[places[part]]), ahead.candidates
        if not self.beam_bytes:
            return pixel_buffer, pixel_buffer
        starts, beams = _beams_of(pixels[part])
        candidates = self.scratch.buffer("beams", len(starts) * self.beam_bytes)
        self._trace_beams(params, len(starts), pixel_buffer, self.device.upload("starts", starts), candidates)
        return self.device.upload("beams", beams), candidates

    def _trace_beams(self, params: NDArray[Any], count: int, pixels: Any, starts: Any, candidates: Any) -> None:
        params["beam_count"] = count
        names = ("nodes", "triangle_blocks", "sphere_blocks", "triangles", "lights")
        scene = (params.tobytes(), self.parameters, *(self.buffers[name] for name in names))
        self.device.run(self.kernels["trace_beams"], count, *scene, pixels, starts, candidates)

    def _reduce(self, traced: Traced, film: Film) -> None:
        params = traced.params
        shape = (int(params["sample_count"]), 3, int(params["stride"]))
        with self.device.mapped(traced.planes, shape, np.float32) as array:
            pixels = int(params["pixel_count"])
            film.add(array[:, :, :pixels], int(params["first_pixel"]), int(params["first_sample"]))


def _keep_complete(film: Film, params: NDArray[Any], end: int) -> int:
    """Drops the strip of pixels that a stop cut short of sample `end`; returns how many pixels are complete."""
    first_pixel = int(params["first_pixel"])
    if int(params["first_sample"] + params["sample_count"]) == end:
        return first_pixel + int(params["pixel_count"])
    del film.strips[first_pixel]
    return first_pixel


def tiled_pixels(width: int, height: int) -> NDArray[np.uint32]:
    """All pixels as x + 65536 · y, tile by tile: neighbouring work-items trace neighbouring rays."""
    y, x = _tile_grid(width, height)
    pixels = (y << np.uint32(16)) | x
    whole = (y.size, x.size) == (height, width)
    return np.asarray(pixels.ravel() if whole else pixels[(y < height) & (x < width)])


def tile_order(width: int, height: int) -> NDArray[np.intp]:
    """(height · width,): where each pixel, row by row, stands in the list of `tiled_pixels`."""
    y, x = _tile_grid(width, height)
    if (y.size, x.size) == (height, width):
        place = np.arange(width * height)
    else:
        place = np.cumsum((y < height) & (x < width)) - 1
    tiles = place.reshape(y.shape[0], x.shape[1], _TILE, _TILE)
    return tiles.transpose(0, 2, 1, 3).reshape(y.size, x.size)[:height, :width].ravel()


def _tile_grid(width: int, height: int) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """y and x of all pixels of the tiles that cover a picture: they broadcast to (rows, columns, _TILE, _TILE)."""
    y = np.arange(-(-height // _TILE) * _TILE, dtype=np.uint32).reshape(-1, 1, _TILE, 1)
    x = np.arange(-(-width // _TILE) * _TILE, dtype=np.uint32).reshape(1, -1, 1, _TILE)
    return y, x


def _pass_params(first_pixel: int, pixels: int, first_sample: int, samples: int) -> NDArray[Any]:
    params = np.zeros((), dtypes()["PassParams"])
    params["first_pixel"], params["pixel_count"] = first_pixel, pixels
    params["first_sample"], params["sample_count"] = first_sample, samples
    params["stride"] = pixels + _PLANE_PAD
    return params


def _passes(pixels: int, first: int, samples: int, pass_samples: int) -> list[NDArray[Any]]:
    """PassParams of each pass: all samples of some beams, or, if there are too many, a range of them. Whatever the
    passes, so, the same pixels share a beam."""
    pixel_step, sample_step = pass_shape(samples, pass_samples)
    passes = []
    for first_pixel in range(0, pixels, pixel_step):
        for first_sample in range(first, first + samples, sample_step):
            pixel_count = min(pixel_step, pixels - first_pixel)
            sample_count = min(sample_step, first + samples - first_sample)
            passes.append(_pass_params(first_pixel, pixel_count, first_sample, sample_count))
    return passes


def pass_shape(samples: int, pass_samples: int) -> tuple[int, int]:
    """At most how many pixels, and samples of each, a pass has that is to trace so many samples of each pixel."""
    beam = constants()["BEAM_PIXELS"]
    sample_step = min(samples, _PIXEL_SAMPLES, max(1, pass_samples // beam))
    return max(1, pass_samples // (sample_step * beam)) * beam, sample_step


def _beams_of(pixels: NDArray[np.uint32]) -> tuple[NDArray[np.uint32], NDArray[np.uint32]]:
    """Which of the pixels are the first of their beam, and the number of each pixel's beam. A beam is that of a tile of
    the picture, whatever the list of pixels, so that it tells the same of a pixel in any pass, crop or round."""
    tiles = pixels & np.uint32(0x10001 * (0x10000 - constants()["BEAM_SIDE"]))
    first = np.empty(len(pixels), bool)
    first[:1] = True
    np.not_equal(tiles[1:], tiles[:-1], out=first[1:])
    starts = np.flatnonzero(first).astype(np.uint32)
    return starts, np.cumsum(first, dtype=np.uint32) - np.uint32(1)


def _items(params: NDArray[Any]) -> int:
    return int(params["pixel_count"]) * int(params["sample_count"])


def _groups(params: NDArray[Any]) -> int:
    return -(-_items(params) // LOCAL_SIZE)
