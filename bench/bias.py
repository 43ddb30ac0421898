"""The bias floor: does the error of every shipped scene keep falling, against an independent float64 renderer?

The reference (tests/reference/pictures.cl) can take the very samples that pyrt takes: what remains is rounding and
mistakes, without the noise of edges and lights. It can also choose its own points on the lights: then noise remains,
but it owes nothing to pyrt's way of sampling them.
"""

from __future__ import annotations

import sys
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench.report import Outcome, Table, number
from bench.scenes import shipped
from tests.reference.pictures import Pictures

Array = NDArray[np.float64]
Ladder = tuple[int, ...]

SIZE = 32
LADDER = (1 << 6, 1 << 10, 1 << 14, 1 << 18)
QUICK_LADDER = LADDER[:2]
LIMIT = 1e-5  # relative
SCENES = (
    "cornell",
    "cornell_refraction",
    "cornell_textured",
    "cornell_area_light",
    "cornell_two_lights",
    "mesh_room",
    "showcase",
)
QUICK_SCENES = ("cornell", "cornell_area_light")


@dataclass(frozen=True)
class Bias:
    """Errors relative to the picture's mean."""

    rounding: dict[int, float]  # by samples: root mean square over the pixels, against the same samples
    median: float  # of the absolute values of the same at the most samples
    floor: float  # root mean square of what both halves of the samples have in common, and two standard errors
    error: dict[int, float]  # by samples: root mean square against a picture of other samples
    mean: float  # of the difference from uniform points on lights, and its standard error
    deviation: float


def run(quick: bool) -> Outcome:
    """Both comparisons of every shipped scene."""
    ladder = QUICK_LADDER if quick else LADDER
    same, other, figures, data = [], [], {}, {}
    for name in QUICK_SCENES if quick else SCENES:
        print(f"bias: {name}", file=sys.stderr)
        scene = shipped(name)
        bias = compare(pyrt.Renderer(scene), Pictures(scene), ladder)
        data[name] = asdict(bias)
        figures[f"{name}, floor"] = bias.floor
        rounding = [number(bias.rounding[n], 2) for n in ladder]
        same.append((name, *rounding, number(bias.median, 2), f"< {number(bias.floor, 2)}"))
        mean = f"{bias.mean:+.1e} ± {bias.deviation:.0e}"
        other.append((name, *(number(bias.error[n], 2) for n in ladder), mean))
    rungs = tuple(f"{n} spp" for n in ladder)
    where = f"{SIZE}×{SIZE} pixels, relative to the picture's mean"
    first = Table(
        "Bias floor: against the same samples in float64",
        ("scene", *rungs, "median", "floor"),
        tuple(same),
        (
            f"RMSE over {where}. What remains is rounding: a ray that passes an edge on the other side counts as one "
            f"whole sample, so the error falls with their number. Median: of the pixels' errors at {ladder[-1]} spp.",
            "Floor: what the two halves of the samples have in common, with two standard errors.",
        ),
    )
    second = Table(
        "Bias floor: against uniform points on the lights, in float64",
        ("scene", *rungs, f"mean at {ladder[-1]} spp"),
        tuple(other),
        (
            f"RMSE over {where}, against a reference of other samples, {ladder[-1]} of them: in the last column of "
            "errors, half of the variance is the reference's.",
            "Mean: of the difference with the same places in the pixels, ± its standard error.",
        ),
    )
    return Outcome((first, second), figures, data)


def compare(renderer: pyrt.Renderer, reference: Pictures, ladder: Ladder) -> Bias:
    """Bias of a renderer; the highest number of samples is more than twice the next."""
    top = ladder[-1]
    rungs = (*ladder[:-1], top // 2, top)
    ours, twins = _pictures(renderer, rungs, 0), reference.render(rungs, 0, SIZE)
    scale = float(twins[top].mean())
    gaps = {n: (ours[n] - twins[n]) / scale for n in rungs}
    uniform = reference.render((top,), 1, SIZE, uniform=True)[top]
    difference = (_pictures(renderer, (top,), 1)[top] - uniform).mean(2) / scale
    return Bias(
        rounding={n: _rms(gaps[n]) for n in ladder},
        median=float(np.median(np.abs(gaps[top]))),
        floor=_common(gaps[top // 2], 2 * gaps[top] - gaps[top // 2]),
        error={n: _rms((ours[n] - uniform) / scale) for n in ladder},
        mean=float(difference.mean()),
        deviation=float(difference.std(ddof=1) / np.sqrt(difference.size)),
    )


def _pictures(renderer: pyrt.Renderer, rungs: Ladder, seed: int) -> dict[int, Array]:
    return {n: np.asarray(renderer.render(n, seed, (SIZE, SIZE)).image, np.float64) for n in rungs}


def _rms(values: Array) -> float:
    return float(np.sqrt((values**2).mean()))


def _common(first: Array, second: Array) -> float:
    """Bound on the root mean square of what two pictures of errors, whose noise is independent, have in common."""
    products = (first * second).mean(2)
    return float(np.sqrt(max(products.mean(), 0.0) + 2 * products.std(ddof=1) / np.sqrt(products.size)))
