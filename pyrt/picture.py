"""Rendering one picture: all its samples at once, in rounds that can be continued, or where they are needed most."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import prod
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt import __version__, film
from pyrt.adaptive import FIRST_SAMPLES, RADIANCE_FLOOR, STEADY_LEVEL, add, refine, summary
from pyrt.aov import AOVS, GUIDES
from pyrt.checkpoint import Saver, accumulate, begin, begin_adaptive, open_checkpoint
from pyrt.denoise import denoised
from pyrt.device_scene import DeviceScene
from pyrt.guide import pixel_counts
from pyrt.memory import Need, picture_bytes
from pyrt.partial import Adaptive, Partial, PartialAdaptive, Work, kernels_hash
from pyrt.passes import SampleTracer, Tally, pass_shape, tile_order, tiled_pixels
from pyrt.request import Request
from pyrt.result import Beside, Result, sample_metadata
from pyrt.scene import Scene
from pyrt.settings import Window
from pyrt.watch import Progress, Watch

_PART = 1 << 18  # pixels traced at a time, if nothing is kept to continue


@dataclass(frozen=True)
class _Picture:
    """One on its way. `pixels`: its pixels, x + 65536 · y, tile by tile."""

    scene: DeviceScene
    request: Request
    watch: Watch
    beside: Beside
    tracer: SampleTracer
    pixels: NDArray[np.uint32]


def render_picture(scene: DeviceScene, request: Request, report: Progress) -> Result:
    """Renders what is asked for, or as much of it as there is when `report` returns False.

    Raises:
        UsageError: the checkpoint is of another render.
        DeviceError: the device failed.
        PyrtError: it would not fit into memory.
    """
    window = request.window
    Need(0, 0, required_bytes(scene.scene, request)).require(scene.scene.name)
    pixels = tiled_pixels(*window.shape[::-1]) + np.uint32(window.x0 | window.y0 << 16)
    start = _start(scene, request)
    watch = Watch(
        report=report,
        tally=Tally(),
        before=0 if start is None else start.traced(),
        total=len(pixels) * request.spp if start is None else start.total(),
        at_least=len(pixels) * min(request.spp, FIRST_SAMPLES),
        start=perf_counter(),
        time_limit=request.time_limit if request.time_limit is not None else np.inf,
        target=(request.noise or 0.0) ** 2,
    )
    parameters = scene.parameters(window.width, window.height)
    extra = scene.aovs((*request.aovs, *GUIDES * request.denoise), window, request.seed, parameters)
    beside = Beside(scene.scene, scene.hash, request.seed, window, {name: extra.get(name) for name in request.aovs})
    tracer = scene.tracer(parameters, request.seed, request.pass_samples, watch.tally, watch.after_pass)
    picture = _Picture(scene, request, watch, beside, tracer, pixels)
    if isinstance(start, Partial):
        result = _in_rounds(picture, start)
    else:
        result = _adaptively(picture, start) if request.adaptive else _at_once(picture)
    if not request.denoise:
        return result
    return replace(result, denoised=denoised(result.image, *(extra[name] for name in GUIDES)))


def required_bytes(scene: Scene, request: Request) -> int:
    """Memory that the picture takes, beside the scene's; see `memory.Need`."""
    channels = sum(len(AOVS[name].channels) for name in request.aovs)
    adaptive, pixels = request.adaptive, prod(request.window.shape)
    return picture_bytes(scene, pixels, request.spp, channels=channels, keep=request.keeps, adaptive=adaptive)


def _start(scene: DeviceScene, request: Request) -> Partial | PartialAdaptive | None:
    """What the render begins with, if it keeps what it has."""
    if not request.keeps:
        return None
    x0, y0, x1, y1, width, height = request.window
    device, crop = str(scene.device.info), (x0, y0, x1, y1)
    work = Work(scene.hash, width, height, crop, request.seed, device, __version__, kernels_hash())
    order = tile_order(x1 - x0, y1 - y0)
    start: Partial | PartialAdaptive
    if request.adaptive:
        start = begin_adaptive(work, request.noise or 0.0, request.spp, order)
    else:
        start = begin(work, *(request.samples or (0, request.spp)), order)
    if request.checkpoint is None:
        return start
    return open_checkpoint(request.checkpoint, start, request.resume, request.extend)


def _at_once(picture: _Picture) -> Result:
    """Part by part, since sums take twice the memory of the picture that they become."""
    request, watch, tracer = picture.request, picture.watch, picture.tracer
    canvas, dropped = film.Canvas.blank(len(picture.pixels)), 0
    step = min(pass_shape(request.spp, request.pass_samples)[0], _PART)
    for first in range(0, len(picture.pixels), step):
        part = picture.pixels[first : first + step]
        found, complete = tracer.trace(part, 0, request.spp)
        canvas.paint(_places(part[:complete], request.window), found.totals()[..., :complete], found.count[:complete])
        dropped += found.dropped
        if not watch.going():
            break
    return _result(picture, canvas.picture(request.window.shape), None, dropped)


def _places(pixels: NDArray[np.uint32], window: Window) -> NDArray[np.intp]:
    """Where the pixels x + 65536 · y stand in the window's picture, row by row."""
    y, x = pixels >> np.uint32(16), pixels & np.uint32(0xFFFF)
    return ((y - np.uint32(window.y0)) * np.uint32(window.shape[1]) + (x - np.uint32(window.x0))).astype(np.intp)


def _in_rounds(picture: _Picture, start: Partial) -> Result:
    request, watch = picture.request, picture.watch

    def result(partial: Partial) -> Result:
        return picture.beside.added_to(partial_result(partial, picture.scene.stats(watch.tally)))

    def save(partial: Partial) -> None:
        if request.checkpoint is not None:
            result(partial).save(request.checkpoint)

    ahead, places = picture.tracer.look_ahead(picture.pixels), np.arange(len(picture.pixels))

    def trace(pixels: NDArray[np.uint32], first: int, count: int) -> tuple[film.Film, int]:
        return picture.tracer.trace(pixels, first, count, ahead, places)

    return result(accumulate(trace, picture.pixels, start, save, request.checkpoint_every, watch.going))


def _adaptively(picture: _Picture, start: PartialAdaptive | None) -> Result:
    request, watch, tracer, pixels = picture.request, picture.watch, picture.tracer, picture.pixels
    state = Adaptive.empty(len(pixels)) if start is None else start.state
    guide = picture.scene.guide(tracer.parameters, request.window.shape)

    def result() -> Result:
        refined, shape = summary(state), request.window.shape
        painted = film.picture(refined.sums, refined.count, tile_order(*shape[::-1]), shape)
        made = _result(picture, painted, refined.noise, refined.dropped)
        made.stats["pixels"] = pixel_counts(state.classes, state.count)
        return replace(made, partial=start)

    def save() -> None:
        if request.checkpoint is not None and state.count.any() and not state.torn:
            result().save(request.checkpoint)

    ahead = tracer.look_ahead(pixels)
    if ahead is not None:
        state.classes[:] = guide.classify(ahead, tracer.scratch)

    def trace(group: NDArray[np.intp], first: int, count: int) -> None:
        work = (pixels[group], first, count, ahead, group)
        if not (guide.can_refine and tracer.whole(count)):
            made, complete = tracer.trace(*work)
            return add(state, group[:complete], made)
        for traced in tracer.passes(*work):
            guide.refine(traced, state, STEADY_LEVEL, RADIANCE_FLOOR)
            if not tracer.after_pass():
                break

    goal = request.noise or 0.0, request.spp if start is None else start.spp
    saver = Saver(save, request.checkpoint_every)
    try:
        refine(trace, guide, state, *goal, watch.going, watch.note_error, saver.save_if_due)
    finally:
        save()
    return result()


def _result(picture: _Picture, painted: film.Picture, noise: float | None, dropped: int) -> Result:
    stats = {**picture.scene.stats(picture.watch.tally), "noise": noise}
    stats["dropped"]["samples"] = dropped
    return picture.beside.added_to(Result(*painted, stats))


def partial_result(partial: Partial, stats: dict[str, Any] | None = None) -> Result:
    """The picture of a film."""
    whole, window = partial.film, partial.work.window
    stats = {**(stats or {}), "noise": None}
    stats["dropped"] = {**stats.get("dropped", {}), "samples": whole.dropped}
    work, spp = partial.work, partial.end - partial.first
    metadata = sample_metadata(work.scene, work.seed, partial.first, spp, work.device)
    picture = film.picture(whole.totals(), whole.count, partial.order, window.shape)
    return Result(*picture, stats, partial, window=window, metadata=metadata)
