"""What the device tells adaptive sampling about the pixels of a picture: their classes, and how neighbours err."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pyrt.device import Device
from pyrt.layout import constants, dtypes
from pyrt.partial import Adaptive
from pyrt.passes import Ahead, Scratch, Traced, tile_order

GAIN_STEPS = 4  # bins per octave
LOW_GAIN, GAIN_BINS = -80.0, 88 * GAIN_STEPS  # logarithm of the first bin's lower end, and their number

_PRIOR = 0.25  # weight of a class's mean, where a pixel next to another has 0.73
_MARGIN = 2  # pixels around a picture
_NAMES = ("plain", "edge", "penumbra", "unknown", "light edge")  # PIXEL_… of types.h


@dataclass(frozen=True)
class Guide:
    """For the pixels of one picture, in the order of `tiled_pixels`.

    Attributes:
        kernels: of adaptive.cl, by name.
        buffers: the scene's arrays, by name.
        parameters: buffer of SceneParams.
        size: (width, height, floats of a row of `pictures`), uint32.
        order: (height · width,) uint32, where each pixel, row by row, stands in the list.
        pictures: (2, height + 4, row) float32, for `gains`: values and kinds of pixels.
    """

    device: Device
    kernels: dict[str, Any]
    buffers: dict[str, Any]
    parameters: Any
    size: NDArray[np.uint32]
    order: NDArray[np.uint32]
    pictures: NDArray[np.float32]

    @classmethod
    def of(
        cls, device: Device, kernels: dict[str, Any], buffers: dict[str, Any], parameters: Any, shape: tuple[int, int]
    ) -> Guide:
        """For pictures of `shape` (height, width)."""
        height, width = shape
        row = -(-width // 8) * 8 + 2 * _MARGIN
        pictures = np.full((2, height + 2 * _MARGIN, row), -1, np.float32)
        order = tile_order(width, height).astype(np.uint32)
        return cls(device, kernels, buffers, parameters, np.array([width, height, row], np.uint32), order, pictures)

    def classify(self, ahead: Ahead, scratch: Scratch) -> NDArray[np.uint8]:
        """PIXEL_… of types.h for each pixel of a picture."""
        classes = np.empty(len(ahead.beams), np.uint8)
        names = ("triangles", "corners", "materials", "textures", "lights", "triangle_blocks")
        head = (ahead.params.tobytes(), self.parameters, *(self.buffers[name] for name in names))
        layout = dtypes()
        gathered = ahead.candidates.size // layout["Candidates"].itemsize * layout["TriangleBlock"].itemsize
        lists = (ahead.pixels, ahead.starts, ahead.candidates, scratch.buffer("gathered", gathered))
        self.device.run(self.kernels["classify"], int(ahead.params["beam_count"]), *head, *lists, fill=[classes])
        return classes

    @property
    def can_refine(self) -> bool:
        """Whether the device computes in float64."""
        return "refine" in self.kernels

    def refine(self, traced: Traced, state: Adaptive, steady: int, floor: float) -> None:
        """Adds a pass's samples to the state, with the bits of `adaptive.add`.

        Args:
            traced: a pass with all samples that its pixels are to have now; its `places` are those in the state.
            steady: the level from which on errors are averaged.
            floor: of squared radiance.
        """
        items = -(-int(traced.params["pixel_count"]) // constants()["PIXELS_REFINED"])
        falls = np.empty((items, state.falls.size + 1))
        share = self.device.share
        head = (traced.params.tobytes(), np.uint32(len(state.count)), np.uint32(steady), np.float64(floor))
        arrays = (traced.planes, traced.places, share(state.classes), share(state.wanted), share(state.decay))
        changed: list[NDArray[Any]] = [state.sums, state.error, state.level, state.count, falls]
        state.torn = True
        self.device.run(self.kernels["refine"], items, *head, *arrays, fill=changed)
        total = falls.sum(axis=0)
        state.falls += total[:-1].reshape(state.falls.shape)
        state.dropped += int(total[-1])
        state.torn = False

    def gains(
        self,
        values: NDArray[np.float32],
        kinds: NDArray[np.uint8],
        factors: NDArray[np.float32],
        means: NDArray[np.float32],
        shifts: NDArray[np.float32],
    ) -> NDArray[np.uint32]:
        """GAIN_BINS · kind + bin of each pixel, the bin that of log2(mean of its neighbours) + shift of its kind.

        The mean is over the other pixels of its class in 5 × 5 pixels, weighted by distance, of values times the
        factors of their kinds, and a little of the mean of the class. Its own value has no part in it. `factors` and
        `shifts` are (classes, levels), `means` (classes,); a kind is level + levels · class.
        """
        width, height, _ = self.size
        share = self.device.share
        order, scaled, pictured = share(self.order), share(self.pictures[0]), share(self.pictures[1])
        lists = [share(array) for array in (values, kinds, factors)]
        self.device.run(self.kernels["spread"], len(values), *self.size, order, *lists, scaled, pictured)
        keys = np.empty(len(values), np.uint32)
        levels, bins = np.uint32(factors.shape[1]), np.uint32(GAIN_BINS)
        head = (*self.size, levels, np.float32(_PRIOR), np.float32(LOW_GAIN), np.float32(GAIN_STEPS), bins)
        rows = int(height) * -(-int(width) // 8)
        self.device.run(
            self.kernels["gains"], rows, *head, order, share(means), share(shifts), scaled, pictured, fill=[keys]
        )
        return keys


def pixel_counts(classes: NDArray[np.uint8], samples: NDArray[np.uint32]) -> dict[str, dict[str, int]]:
    """For each class of pixels: how many have how many samples."""
    counts = {}
    for index, name in enumerate(_NAMES):
        numbers = np.bincount(samples[classes == index])
        counts[name] = {str(n): int(numbers[n]) for n in np.flatnonzero(numbers)}
    return counts
