"""What the device tells adaptive sampling about the pixels of a picture: their classes, and means over neighbours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.device import Device
from pyrt.passes import beam_count

_MARGIN = 2  # pixels around a picture
_PRIOR = 0.25  # weight of a class's mean, where a pixel next to another has 0.73
_NAMES = ("plain", "edge", "penumbra", "unknown")  # PIXEL_… of types.h


@dataclass(frozen=True)
class Guide:
    """For the pixels of one picture, in the order of `tiled_pixels`.

    Attributes:
        kernels: of adaptive.cl, by name.
        buffers: the scene's arrays, by name.
        parameters: buffer of SceneParams.
        shape: (height, width).
        order: (height · width,), where each pixel, row by row, stands in the list.
    """

    device: Device
    kernels: dict[str, Any]
    buffers: dict[str, Any]
    parameters: Any
    shape: tuple[int, int]
    order: NDArray[np.intp]

    def classify(self, params: NDArray[Any], pixels: Any, beams: Any) -> NDArray[np.uint8]:
        """PIXEL_… of types.h for each pixel of a pass; the arguments are those that `SampleTracer.trace` shows."""
        classes = np.empty(int(params["pixel_count"]), np.uint8)
        out = self.device.share(classes)
        scene = [self.buffers[name] for name in ("triangles", "corners", "materials", "textures", "lights")]
        head = (params.tobytes(), self.parameters)
        self.device.run(self.kernels["classify"], beam_count(params), *head, *scene, pixels, beams, out)
        self.device.receive(out, classes)
        return classes

    def pool(
        self, values: NDArray[np.float32], classes: NDArray[np.uint8], means: NDArray[np.float32]
    ) -> NDArray[np.float32]:
        """For each pixel the mean of `values` over the others of its class in 5 × 5 pixels, weighted by distance, and a
        little of the mean of its class. Its own value has no part in it."""
        height, width = self.shape
        stride = -(-width // 8) * 8 + 2 * _MARGIN
        pictures = np.zeros((3, height + 2 * _MARGIN, stride), np.float32)  # values, classes, result
        pictures[1] = -1
        inner = pictures[:, _MARGIN:-_MARGIN, _MARGIN : width + _MARGIN]
        inner[0], inner[1] = values[self.order].reshape(self.shape), classes[self.order].reshape(self.shape)
        shared = [self.device.share(array) for array in (means, *pictures)]
        head = (np.uint32(width), np.uint32(height), np.uint32(stride), np.float32(_PRIOR))
        self.device.run(self.kernels["pool"], height * -(-width // 8), *head, *shared)
        self.device.receive(shared[-1], pictures[2])
        pooled = np.empty_like(values)
        pooled[self.order] = inner[2].ravel()
        return pooled


def pixel_counts(classes: NDArray[np.uint8], samples: NDArray[np.uint32]) -> dict[str, dict[str, int]]:
    """For each class of pixels: how many have how many samples."""
    counts = {}
    for index, name in enumerate(_NAMES):
        values, pixels = np.unique(samples[classes == index], return_counts=True)
        counts[name] = {str(value): int(number) for value, number in zip(values, pixels, strict=True)}
    return counts
