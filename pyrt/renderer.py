"""A scene on a device, and the pictures that it renders."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from pyrt.device import Device
from pyrt.device_scene import DeviceScene
from pyrt.doctor import open_device
from pyrt.errors import UsageError
from pyrt.memory import estimate
from pyrt.passes import PASS_SAMPLES
from pyrt.picture import render_picture
from pyrt.request import request_for
from pyrt.result import Result
from pyrt.scene import Scene
from pyrt.watch import Progress


class Renderer:
    """A scene on a device: tree, kernels and buffers are made once, `render` may be called many times.

    Args:
        scene: what to render.
        device: index or part of the name of an OpenCL device; None chooses. Or an open one.
        all_features: compile every feature in, needed or not (the image is the same).
        beams: look ahead what the rays of neighbouring pixels can hit (without lines, the image is the same).
        lines: sample rectangle lights by whole lines where that tells what may hide them: less noise, the same mean.
        build_flags: more options for the OpenCL compiler.
        progress: called with a dict at each stage ("build", "compile", then as for `render`).

    Raises:
        UsageError: `scene` is something else, such as a file's name.
        DeviceError: no device can be used, or the scene does not fit it.
    """

    def __init__(
        self,
        scene: Scene,
        device: str | int | Device | None = None,
        *,
        all_features: bool = False,
        beams: bool = True,
        lines: bool = True,
        build_flags: tuple[str, ...] = (),
        progress: Progress | None = None,
    ):
        if not isinstance(scene, Scene):
            raise UsageError(f"scene: expected what load_scene returns, got {type(scene).__name__}")
        self.scene = scene
        self._progress = progress or (lambda event: None)
        estimate(scene).require(scene.name)
        self._progress({"stage": "build", "done": 0.0})
        self._on_device = DeviceScene(
            scene,
            device if isinstance(device, Device) else open_device(device),
            all_features=all_features,
            beams=beams,
            lines=lines,
            build_flags=build_flags,
            progress=self._progress,
        )

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
        request = request_for(
            self.scene,
            spp,
            seed,
            size,
            noise=noise,
            time_limit=time_limit,
            samples=samples,
            checkpoint=checkpoint,
            checkpoint_every=checkpoint_every,
            resume=resume,
            crop=crop,
            aovs=aovs,
            denoise=denoise,
            pass_samples=pass_samples,
        )
        return render_picture(self._on_device, request, progress or self._progress)
