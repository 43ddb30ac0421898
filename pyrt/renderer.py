"""A scene on a device, and the pictures that it renders."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import cached_property
from math import prod
from pathlib import Path
from time import perf_counter
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt import __version__, film
from pyrt.adaptive import FIRST_SAMPLES, Refined, refine, summary
from pyrt.aov import AOVS, GUIDES, AovTracer, check_aovs
from pyrt.camera import film_plane
from pyrt.checkpoint import Saver, accumulate, begin, begin_adaptive, open_checkpoint
from pyrt.denoise import denoised, require_denoiser
from pyrt.device import Device
from pyrt.device_sah import splitter
from pyrt.doctor import open_device
from pyrt.features import build_options, feature_table
from pyrt.guide import Guide, pixel_counts
from pyrt.layout import constants, dtypes
from pyrt.memory import Need, estimate, picture_bytes
from pyrt.pack import pack_camera, pack_scene
from pyrt.partial import Adaptive, Partial, PartialAdaptive, Work, kernels_hash
from pyrt.passes import PASS_SAMPLES, SampleTracer, Scratch, Tally, tile_order, tiled_pixels
from pyrt.primitives import Primitives
from pyrt.result import Beside, Result, sample_metadata
from pyrt.scene import Scene
from pyrt.scene_hash import scene_hash
from pyrt.settings import Window, check_arguments, check_keeping, crop_window
from pyrt.watch import Progress, Watch

MAX_SAMPLES = 1 << 16  # of a pixel, where noise or time is the limit and spp is not given


class Renderer:
    """A scene on a device: tree, kernels and buffers are made once, `render` may be called many times.

    Args:
        scene: what to render.
        device: index or part of the name of an OpenCL device; None chooses. Or an open one.
        all_features: compile every feature in, needed or not (the image is the same).
        beams: look ahead what the rays of neighbouring pixels can hit (the image is the same).
        build_flags: more options for the OpenCL compiler.
        progress: called with a dict at each stage ("build", "compile", then as for `render`).

    Raises:
        DeviceError: no device can be used, or the scene does not fit it.
    """

    def __init__(
        self,
        scene: Scene,
        device: str | int | Device | None = None,
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
        estimate(scene).require(scene.name)
        self._progress({"stage": "build", "done": 0.0})
        start = perf_counter()
        self._device = device if isinstance(device, Device) else open_device(device)
        self._packed = pack_scene(scene, splitter(self._device))
        self._seconds["build"] = perf_counter() - start
        self._progress({"stage": "compile", "done": 0.0})
        start = perf_counter()
        self._beams = beams
        shape = [f"-DHAS_BEAMS={int(beams)}", f"-DPACKET={self._device.packet}"]
        options = [*build_options(self._features, everything=all_features), *shape, *build_flags]
        self._kernels = self._device.build("render.cl", options)
        self._seconds["compile"] = perf_counter() - start
        start = perf_counter()
        arrays = self._packed.arrays  # each goes as soon as the device has it
        self._buffers = {name: self._device.upload(name, arrays.pop(name)) for name in list(arrays)}
        self._seconds["upload"] = perf_counter() - start
        self._scratch = Scratch(self._device)

    def render(
        self,
        spp: int | None = None,
        seed: int = 0,
        size: tuple[int, int] | None = None,
        *,
        noise: float | None = None,
        time_limit: float | None = None,
        samples: tuple[int, int] | None = None,
        checkpoint: str | Path | None = None,
        checkpoint_every: float = 60.0,
        resume: bool = False,
        crop: tuple[int, int, int, int] | None = None,
        aovs: Iterable[str] = (),
        denoise: bool = False,
        pass_samples: int = PASS_SAMPLES,
        progress: Progress | None = None,
    ) -> Result:
        """Renders the scene: a fixed number of samples, or until the first limit is reached.

        Args:
            spp: samples per pixel; None takes the scene's. With `noise` or `time_limit`, at most so many (None: 65536).
            seed: of the sample points, 0 … 2^32 − 1.
            size: (width, height) in pixels; None takes the film's.
            noise: stop when the estimated relative error (root mean square over the picture) is at most this.
            time_limit: stop after so many seconds of this call, but not before all pixels have 2 samples.
            samples: (first, end): render only the samples first … end − 1 of the picture, for `merge`.
            checkpoint: EXR file that always holds the picture so far, and the film, from which `resume` goes on. It is
                written at the end, too, and when anything stops the render.
            checkpoint_every: seconds between two writes, or more, so that they take at most a twentieth of the time;
                0: as often as possible.
            resume: go on from the checkpoint, if there is one. The picture has the same bits as if it was rendered in
                one go. `spp` may have grown; None takes what the render was to reach.
            crop: (x0, y0, x1, y1): only the pixels x0 … x1 − 1, y0 … y1 − 1. Unless noise or time is the limit, they
                have the bits that they have in the whole picture.
            aovs: names of `aov.AOVS`, what to compute beside the picture.
            denoise: compute `Result.denoised`; needs the package pyoidn.
            pass_samples: samples of one pass, which bounds memory; no influence on the image.
            progress: called after every pass with a dict: stage ("render"), done (0 … 1, of the limit that is nearest),
                samples, rays and noise (the error so far, or None). The render stops if that returns False.

        Raises:
            UsageError: an argument is out of range, or the checkpoint is of another render.
            DeviceError: the device failed.
            PyrtError: it would not fit into memory.
        """
        width, height = size or (self.scene.film.width, self.scene.film.height)
        adaptive = noise is not None or time_limit is not None
        extend = spp is not None or samples is not None
        spp = spp if spp is not None else MAX_SAMPLES if adaptive else self.scene.spp
        check_arguments(spp, seed, width, height, pass_samples, noise, time_limit)
        names, window = check_aovs(aovs), crop_window(crop, width, height)
        if denoise:
            require_denoiser()
        keep = checkpoint is not None or samples is not None
        shape = (window.y1 - window.y0, window.x1 - window.x0)
        channels = sum(len(AOVS[name].channels) for name in names)
        picture = picture_bytes(self.scene, prod(shape), spp, channels=channels, keep=keep, adaptive=adaptive)
        Need(0, 0, picture).require(self.scene.name)
        pixels = tiled_pixels(*shape[::-1]) + np.uint32(window.x0 | window.y0 << 16)
        start: Partial | PartialAdaptive | None = None
        if checkpoint is not None or samples is not None:
            check_keeping(checkpoint, checkpoint_every, samples, adaptive, crop)
            start = self._begin(adaptive, noise or 0.0, samples or (0, spp), seed, (width, height))
            if checkpoint is not None:
                start = open_checkpoint(checkpoint, start, resume, extend)
        watch = Watch(
            report=progress or self._progress,
            tally=Tally(),
            before=0 if start is None else start.traced(),
            total=len(pixels) * spp if start is None else start.total(),
            at_least=len(pixels) * min(spp, FIRST_SAMPLES),
            start=perf_counter(),
            time_limit=time_limit if time_limit is not None else np.inf,
            target=(noise or 0.0) ** 2,
        )
        parameters = self._device.upload("parameters", self._scene_params(width, height))
        extra = self._aovs((*names, *GUIDES) if denoise else names, window, seed, parameters)
        beside = Beside(self.scene, self._scene_hash, seed, window, {name: extra.get(name) for name in names})
        tracer = SampleTracer(
            device=self._device,
            kernels=self._kernels,
            buffers=self._buffers,
            parameters=parameters,
            beam_bytes=self._beam_bytes(),
            scratch=self._scratch,
            seed=seed,
            pass_samples=pass_samples,
            tally=watch.tally,
            after_pass=watch.after_pass,
        )
        if isinstance(start, Partial):
            result = self._render_rounds(tracer, pixels, start, checkpoint, checkpoint_every, watch, beside)
        elif adaptive:
            goal = (noise or 0.0, spp if start is None else start.spp)
            result = self._render_adaptive(tracer, pixels, goal, start, checkpoint, checkpoint_every, watch, beside)
        else:
            refined = _whole_pixels(*tracer.trace(pixels, 0, spp))
            result = beside.added_to(self._result(refined, shape, watch.tally))
        if not denoise:
            return result
        return replace(result, denoised=denoised(result.image, *(extra[name] for name in GUIDES)))

    def _render_rounds(
        self,
        tracer: SampleTracer,
        pixels: NDArray[np.uint32],
        start: Partial,
        checkpoint: str | Path | None,
        every: float,
        watch: Watch,
        beside: Beside,
    ) -> Result:
        def result(partial: Partial) -> Result:
            return beside.added_to(partial_result(partial, self._stats(watch.tally)))

        def save(partial: Partial) -> None:
            if checkpoint is not None:
                result(partial).save(checkpoint)

        return result(accumulate(tracer.trace, pixels, start, save, every, watch.going))

    def _render_adaptive(
        self,
        tracer: SampleTracer,
        pixels: NDArray[np.uint32],
        goal: tuple[float, int],
        start: PartialAdaptive | None,
        checkpoint: str | Path | None,
        every: float,
        watch: Watch,
        beside: Beside,
    ) -> Result:
        state = Adaptive.empty(len(pixels)) if start is None else start.state
        shape = (beside.window.y1 - beside.window.y0, beside.window.x1 - beside.window.x0)
        guide = Guide.of(self._device, self._guide_kernels, self._buffers, tracer.parameters, shape)

        def result() -> Result:
            made = self._result(summary(state), shape, watch.tally)
            made.stats["pixels"] = pixel_counts(state.classes, state.count)
            return beside.added_to(replace(made, partial=start))

        def save() -> None:
            if checkpoint is not None and state.count.any() and not state.torn:
                result().save(checkpoint)

        ahead = tracer.look_ahead(pixels)
        if ahead is not None:
            state.classes[:] = guide.classify(ahead.params, ahead.pixels, ahead.beams)

        def trace(part: NDArray[np.uint32], first: int, count: int, places: NDArray[np.intp]) -> tuple[film.Film, int]:
            return tracer.trace(part, first, count, ahead, places)

        saver = Saver(save, every)
        try:
            refine(trace, guide, pixels, state, *goal, watch.going, watch.note_error, saver.save_if_due)
        finally:
            save()
        return result()

    def _begin(
        self, adaptive: bool, noise: float, samples: tuple[int, int], seed: int, size: tuple[int, int]
    ) -> Partial | PartialAdaptive:
        work = Work(self._scene_hash, *size, seed, str(self._device.info), __version__, kernels_hash())
        if adaptive:
            return begin_adaptive(work, noise, samples[1], tile_order(*size))
        return begin(work, *samples, tile_order(*size))

    @cached_property
    def _guide_kernels(self) -> dict[str, Any]:
        return self._device.build("adaptive.cl", build_options(self._features))

    @cached_property
    def _aov_kernels(self) -> dict[str, Any]:
        return self._device.build("aov.cl", build_options(self._features))

    @cached_property
    def _scene_hash(self) -> str:
        return scene_hash(self.scene)

    @cached_property
    def _primitives(self) -> Primitives:
        return Primitives.of(self.scene)

    def _aovs(self, names: Iterable[str], window: Window, seed: int, parameters: Any) -> dict[str, NDArray[Any]]:
        """Those that do not come with the samples, by name."""
        wanted = [name for name in names if name not in ("variance", "samples")]
        if not wanted:
            return {}
        plane = film_plane(self.scene.camera, window.width, window.height)
        kernels, primitives = self._aov_kernels, self._primitives
        tracer = AovTracer(self._device, kernels, self._buffers, parameters, primitives, plane, seed)
        return tracer.trace(wanted, window)

    def _beam_bytes(self) -> int:
        lights = int(self._packed.params["light_count"])
        return self._beams * dtypes()["Candidates"].itemsize * (1 + lights * (lights <= constants()["SHAFT_LIGHTS"]))

    def _scene_params(self, width: int, height: int) -> NDArray[Any]:
        params = self._packed.params.copy()
        params["max_depth"] = self.scene.max_depth
        params["camera"] = pack_camera(self._packed, self.scene.camera, width, height)
        return params

    def _result(self, refined: Refined, shape: tuple[int, int], tally: Tally) -> Result:
        stats = {**self._stats(tally), "noise": refined.noise}
        stats["dropped"]["samples"] = refined.dropped
        return Result(*film.picture(refined.sums, refined.count, tile_order(*shape[::-1]), shape), stats)

    def _stats(self, tally: Tally) -> dict[str, Any]:
        specular, shadow, dark, clear = (int(n) for n in tally.counts)
        return {
            "seconds": {**self._seconds, "render": tally.render_seconds, "reduce": tally.reduce_seconds},
            "samples": tally.samples,
            "rays": {"camera": tally.samples, "specular": specular, "shadow": shadow},
            "skipped": {"shadow_rays_to_dark_lights": dark, "shadow_rays_in_clear_shafts": clear},
            "dropped": {"triangles": self._packed.report["dropped_triangles"]},
            "scene": self._packed.report,
            "device": str(self._device.info),
            "features": {row.macro: row.on for row in self._features},
        }


def partial_result(partial: Partial, stats: dict[str, Any] | None = None) -> Result:
    """The picture of a film."""
    whole, shape = partial.film, (partial.work.height, partial.work.width)
    stats = {**(stats or {}), "noise": None}
    stats["dropped"] = {**stats.get("dropped", {}), "samples": whole.dropped}
    work, spp = partial.work, partial.end - partial.first
    metadata = sample_metadata(work.scene, work.seed, partial.first, spp, work.device)
    picture = film.picture(whole.totals(), whole.count, partial.order, shape)
    return Result(*picture, stats, partial, metadata=metadata)


def _whole_pixels(whole: film.Film, complete: int) -> Refined:
    """The film's sums, without the pixels that a stop left incomplete."""
    if complete == len(whole.count):
        return Refined(whole.totals(), whole.count, None, whole.dropped)
    sums, count = np.zeros((2, 3, len(whole.count))), np.zeros_like(whole.count)
    sums[:, :, :complete], count[:complete] = whole.totals()[:, :, :complete], whole.count[:complete]
    return Refined(sums, count, None, whole.dropped)
