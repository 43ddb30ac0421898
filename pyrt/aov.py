"""Channels beside the picture (AOVs): what each pixel shows, as numbers.

The geometry is that of the first surface behind the pixel's centre, unfiltered, so that depth, position, normal and ids
of a pixel belong together. The device finds the primitive; where the ray meets it is computed here, in float64 and
world units. Albedo and the denoiser's guides are averages over the pixel: of its first 16 samples, whatever the picture
has.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.camera import FilmPlane
from pyrt.device import Device
from pyrt.errors import UsageError
from pyrt.primitives import Hits, Primitives, meet_primitives
from pyrt.settings import Window

NONE = 0xFFFFFFFF  # the id of nothing
_SAMPLES = 16  # of each pixel, for what is filtered
_BATCH = 1 << 16  # pixels at a time, which bounds memory


@dataclass(frozen=True)
class Aov:
    """An AOV: `channels` of an EXR file, the `dtype` in Python, and `what` it holds, for people."""

    channels: tuple[str, ...]
    dtype: type
    what: str


def _named(name: str, parts: str) -> tuple[str, ...]:
    return tuple(f"{name}.{part}" for part in parts)


AOVS = {
    "z": Aov(("Z",), np.float32, "distance along the camera's axis; infinite where nothing is hit"),
    "distance": Aov(("distance",), np.float32, "distance from the camera's position; infinite where nothing is hit"),
    "position": Aov(_named("position", "XYZ"), np.float64, "point in the world; 0 where nothing is hit"),
    "normal": Aov(_named("N", "XYZ"), np.float32, "unit shading normal in the world, on the side that is seen"),
    "uv": Aov(_named("uv", "UV"), np.float32, "texture coordinates of the surface"),
    "object": Aov(("object",), np.uint32, "index of the object in the scene; 0xffffffff where nothing is hit"),
    "triangle": Aov(("triangle",), np.uint32, "index of the triangle in its object; 0xffffffff if there is none"),
    "material": Aov(("material",), np.uint32, "index of the material in the scene; 0xffffffff if there is none"),
    "albedo": Aov(_named("albedo", "RGB"), np.float32, "reflected share of the colour; 1 for glass; filtered"),
    "denoising_albedo": Aov(_named("denoising_albedo", "RGB"), np.float32, "albedo, seen through glass; filtered"),
    "denoising_normal": Aov(_named("denoising_normal", "XYZ"), np.float32, "normal, seen through glass; filtered"),
    "variance": Aov(_named("variance", "RGB"), np.float32, "estimated variance of the pixel's mean"),
    "samples": Aov(("samples",), np.uint32, "samples of the pixel"),
}
GUIDES = ("denoising_albedo", "denoising_normal")
_GEOMETRY = frozenset({"z", "distance", "position", "normal", "uv", "object", "triangle", "material"})


def check_aovs(names: Iterable[str]) -> tuple[str, ...]:
    """The names, each once. Raises UsageError for one that is not in AOVS."""
    unique = tuple(dict.fromkeys([names] if isinstance(names, str) else names))
    for name in unique:
        if name not in AOVS:
            raise UsageError(f'aov: expected some of {", ".join(AOVS)}, got "{name}"')
    return unique


def exr_planes(aovs: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """(height, width) arrays by the names of channels."""
    planes: dict[str, NDArray[Any]] = {}
    for name, array in aovs.items():
        channels = AOVS[name].channels
        planes |= zip(channels, np.moveaxis(array.reshape(*array.shape[:2], len(channels)), 2, 0), strict=True)
    return planes


def stored_aovs(planes: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """The AOVs whose channels are all among these planes, by name: what `exr_planes` made them of."""
    found: dict[str, NDArray[Any]] = {}
    for name, aov in AOVS.items():
        if set(aov.channels) <= set(planes):
            channels: list[NDArray[Any]] = [planes[channel].astype(aov.dtype) for channel in aov.channels]
            found[name] = np.stack(channels, axis=2) if len(channels) > 1 else channels[0]
    return found


@dataclass(frozen=True)
class AovTracer:
    """Computes AOVs of one picture.

    Attributes:
        kernels: of aov.cl, by name.
        buffers: the scene's arrays, in the order of the kernel's arguments.
        parameters: buffer of SceneParams.
        seed: of the picture's samples, whose first 16 place the rays of what is filtered.
    """

    device: Device
    kernels: dict[str, Any]
    buffers: dict[str, Any]
    parameters: Any
    primitives: Primitives
    plane: FilmPlane
    seed: int

    def trace(self, names: list[str], window: Window) -> dict[str, NDArray[Any]]:
        """Arrays (height, width) or (height, width, channels) of those AOVs that do not come with the samples."""
        y, x = np.mgrid[window.y0 : window.y1, window.x0 : window.x1].astype(np.uint32)
        shape, pixels = x.shape, (y << np.uint32(16) | x).ravel()
        out: dict[str, NDArray[Any]] = {
            name: np.empty((len(AOVS[name].channels), len(pixels)), AOVS[name].dtype) for name in names
        }
        for start in range(0, len(pixels), _BATCH):
            part = pixels[start : start + _BATCH]
            for name, values in self._batch(names, part).items():
                out[name][:, start : start + len(part)] = values
        flat = {name: array[0] if len(array) == 1 else np.ascontiguousarray(array.T) for name, array in out.items()}
        return {name: array.reshape(*shape, *array.shape[1:]) for name, array in flat.items()}

    def _batch(self, wanted: list[str], pixels: NDArray[np.uint32]) -> dict[str, NDArray[Any]]:
        found: dict[str, NDArray[Any]] = {}
        if _GEOMETRY.intersection(wanted):
            found |= _geometry(self._hits(pixels), self.plane)
        if "albedo" in wanted:
            found["albedo"] = self._features(pixels, 0)[:3]
        if set(GUIDES).intersection(wanted):
            features = self._features(pixels, self.primitives.scene.max_depth)
            found["denoising_albedo"], found["denoising_normal"] = features[:3], features[3:]
        return {name: found[name] for name in wanted}

    def _hits(self, pixels: NDArray[np.uint32]) -> Hits:
        upload, ids = self.device.upload("pixels", pixels), self.device.allocate(4 * len(pixels))
        scene = [self.buffers[name] for name in ("nodes", "triangle_blocks", "sphere_blocks")]
        head = (np.uint32(len(pixels)), self.parameters)
        self.device.run(self.kernels["aov_primitives"], len(pixels), *head, *scene, upload, ids)
        with self.device.mapped(ids, pixels.shape, np.int32) as array:
            primitive = array.copy()
        plane = self.plane
        x, y = (pixels & 0xFFFF) + 0.5, (pixels >> 16) + 0.5
        directions = plane.corner + x[:, None] * plane.dx + y[:, None] * plane.dy
        return meet_primitives(self.primitives, primitive, plane.position, directions)

    def _features(self, pixels: NDArray[np.uint32], depth: int) -> NDArray[np.float32]:
        """(6, pixels): albedo and normal behind at most `depth` specular surfaces."""
        count = len(pixels)
        upload, planes = self.device.upload("pixels", pixels), self.device.allocate(24 * count)
        numbers = (np.uint32(count), np.uint32(_SAMPLES), np.uint32(self.seed), np.int32(depth))
        scene = (self.parameters, *self.buffers.values())
        self.device.run(self.kernels["aov_features"], count, *numbers, *scene, upload, planes)
        with self.device.mapped(planes, (6, count), np.float32) as array:
            return array.copy()


def _geometry(hits: Hits, plane: FilmPlane) -> dict[str, NDArray[Any]]:
    hit = hits.shape >= 0
    away = hits.point - plane.position
    return {
        "z": np.where(hit, away @ plane.forward, np.inf),
        "distance": np.where(hit, np.linalg.norm(away, axis=1), np.inf),
        "position": hits.point.T,
        "normal": hits.normal.T,
        "uv": hits.uv.T,
        "object": hits.shape.astype(np.uint32),  # here and below −1 becomes NONE
        "triangle": hits.triangle.astype(np.uint32),
        "material": hits.material.astype(np.uint32),
    }
