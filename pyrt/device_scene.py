"""A scene on a device: its tree, its kernels and its buffers."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import cached_property
from time import perf_counter
from typing import Any

from numpy.typing import NDArray

from pyrt.aov import AovTracer
from pyrt.camera import film_plane
from pyrt.device import Device
from pyrt.device_sah import splitter
from pyrt.features import build_options, feature_table
from pyrt.guide import Guide
from pyrt.layout import constants, dtypes
from pyrt.memory import buffer_bytes
from pyrt.pack import pack_camera, pack_scene
from pyrt.passes import SampleTracer, Scratch, Tally
from pyrt.primitives import Primitives
from pyrt.scene import Scene
from pyrt.scene_hash import scene_hash
from pyrt.settings import Window
from pyrt.watch import Progress


class DeviceScene:
    """What all pictures of a scene share. For the arguments see `Renderer`.

    Raises:
        DeviceError: the scene does not fit the device, or its compiler failed.
    """

    def __init__(
        self,
        scene: Scene,
        device: Device,
        *,
        all_features: bool,
        beams: bool,
        lines: bool,
        build_flags: tuple[str, ...],
        progress: Progress,
    ):
        self.scene = scene
        self.device = device
        self._seconds: dict[str, float] = {}
        self._features = feature_table(scene)
        for name, nbytes in buffer_bytes(scene).items():
            device.check_buffer(name, nbytes)
        start = perf_counter()
        self._packed = pack_scene(scene, splitter(device))
        self._seconds["build"] = perf_counter() - start
        progress({"stage": "compile", "done": 0.0})
        start = perf_counter()
        self._beams = beams
        shape = [f"-DHAS_BEAMS={int(beams)}", f"-DHAS_LINES={int(beams and lines)}", f"-DPACKET={device.packet}"]
        options = [*build_options(self._features, everything=all_features), *shape, *build_flags]
        self._kernels = device.build("render.cl", options)
        self._seconds["compile"] = perf_counter() - start
        start = perf_counter()
        arrays = self._packed.arrays  # each goes as soon as the device has it
        take = {"texels": device.upload}  # may be the scene's own; the others are of no use to anybody else
        self._buffers = {name: take.get(name, device.adopt)(name, arrays.pop(name)) for name in list(arrays)}
        self._seconds["upload"] = perf_counter() - start
        self._scratch = Scratch(device)

    def parameters(self, width: int, height: int) -> Any:
        """The buffer of SceneParams for a picture of that size."""
        params = self._packed.params.copy()
        params["max_depth"] = self.scene.max_depth
        params["camera"] = pack_camera(self._packed, self.scene.camera, width, height)
        return self.device.upload("parameters", params)

    def tracer(
        self, parameters: Any, seed: int, pass_samples: int, tally: Tally, after_pass: Callable[[], bool]
    ) -> SampleTracer:
        """What traces samples of the picture with these parameters; for the arguments see `SampleTracer`."""
        lights = int(self._packed.params["light_count"])
        candidates = 1 + min(lights, constants()["SHAFT_LIGHTS"])
        return SampleTracer(
            device=self.device,
            kernels=self._kernels,
            buffers=self._buffers,
            parameters=parameters,
            beam_bytes=self._beams * dtypes()["Candidates"].itemsize * candidates,
            scratch=self._scratch,
            seed=seed,
            pass_samples=pass_samples,
            tally=tally,
            after_pass=after_pass,
        )

    def guide(self, parameters: Any, shape: tuple[int, int]) -> Guide:
        """The guide of an adaptive render of a picture (height, width)."""
        return Guide.of(self.device, self._guide_kernels, self._buffers, parameters, shape)

    def aovs(self, names: Iterable[str], window: Window, seed: int, parameters: Any) -> dict[str, NDArray[Any]]:
        """Those that do not come with the samples, by name."""
        wanted = [name for name in names if name not in ("variance", "samples")]
        if not wanted:
            return {}
        plane = film_plane(self.scene.camera, window.width, window.height)
        kernels, primitives = self._aov_kernels, self._primitives
        return AovTracer(self.device, kernels, self._buffers, parameters, primitives, plane, seed).trace(wanted, window)

    def stats(self, tally: Tally) -> dict[str, Any]:
        """`Result.stats`, as far as it does not depend on how the render ended."""
        specular, shadow, dark, clear = (int(n) for n in tally.counts)
        return {
            "seconds": {**self._seconds, "render": tally.render_seconds, "reduce": tally.reduce_seconds},
            "samples": tally.samples,
            "rays": {"camera": tally.samples, "specular": specular, "shadow": shadow},
            "skipped": {"shadow_rays_to_dark_lights": dark, "shadow_rays_in_clear_shafts": clear},
            "dropped": {"triangles": self._packed.report["dropped_triangles"]},
            "scene": self._packed.report,
            "device": str(self.device.info),
            "features": {row.macro: row.on for row in self._features},
        }

    @cached_property
    def hash(self) -> str:
        """See `scene_hash`."""
        return scene_hash(self.scene)

    @cached_property
    def _guide_kernels(self) -> dict[str, Any]:
        double = f"-DHAS_DOUBLE={int(self.device.has_double)}"
        return self.device.build("adaptive.cl", [*build_options(self._features), double])

    @cached_property
    def _aov_kernels(self) -> dict[str, Any]:
        return self.device.build("aov.cl", build_options(self._features))

    @cached_property
    def _primitives(self) -> Primitives:
        return Primitives.of(self.scene)
