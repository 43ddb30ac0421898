"""The bias floor: does the error of every shipped scene keep falling, against an independent float64 renderer?

The reference (tests/reference/pictures.cl) can take the very samples that pyrt takes without lines: what remains is
rounding and mistakes, without the noise of edges and lights. It can also choose its own points on the lights: then
noise remains, but it owes nothing to pyrt's way of sampling them.
"""

from __future__ import annotations

import hashlib
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench.report import Outcome, Table, number
from bench.scenes import shipped
from pyrt.scene import Scene
from pyrt.scene_hash import scene_hash
from tests.reference import pictures

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
    rounding_floor: float  # root mean square of what both halves of the samples have in common, and two standard errors
    error: dict[int, float]  # by samples: root mean square against a picture of other points on the lights
    floor: float  # as above
    mean: float  # of the difference at the most samples, and its standard error
    deviation: float


def run(quick: bool, out: Path, names: tuple[str, ...] = ()) -> Outcome:
    """Both comparisons of the named scenes, or of every shipped one; the float64 pictures are kept in `out`."""
    ladder = QUICK_LADDER if quick else LADDER
    same, other, figures, data = [], [], {}, {}
    for name in names or (QUICK_SCENES if quick else SCENES):
        print(f"bias: {name}", file=sys.stderr)
        scene = shipped(name)
        bias = compare(scene, *references(scene, ladder, out / "reference"), ladder)
        data[name] = asdict(bias)
        figures[f"{name}, floor"] = max(bias.rounding_floor, bias.floor)
        rounding = [number(bias.rounding[n], 2) for n in ladder]
        same.append((name, *rounding, number(bias.median, 2), f"< {number(bias.rounding_floor, 2)}"))
        mean = f"{bias.mean:+.1e} ± {bias.deviation:.0e}"
        other.append((name, *(number(bias.error[n], 2) for n in ladder), f"< {number(bias.floor, 2)}", mean))
    rungs = tuple(f"{n} spp" for n in ladder)
    where = f"{SIZE}×{SIZE} pixels, relative to the picture's mean"
    first = Table(
        "Bias floor: without lines, against the same samples in float64",
        ("scene", *rungs, "median", "floor"),
        tuple(same),
        (
            f"RMSE over {where}. What remains is rounding: a ray that passes an edge on the other side counts as one "
            f"whole sample, so the error falls with their number. Median: of the pixels' errors at {ladder[-1]} spp.",
            "Floor: what the two halves of the samples have in common, with two standard errors.",
        ),
    )
    second = Table(
        "Bias floor: as shipped, against uniform points on the lights, in float64",
        ("scene", *rungs, "floor", f"mean at {ladder[-1]} spp"),
        tuple(other),
        (
            f"RMSE over {where}, against a reference of {ladder[-1]} samples at the same places in the pixels: in the "
            "last column of errors, most of it is the reference's. Mean: of the difference, ± its standard error.",
        ),
    )
    return Outcome((first, second), figures, data)


def references(scene: Scene, ladder: Ladder, folder: Path | None = None) -> tuple[dict[int, Array], dict[int, Array]]:
    """By number of samples, the float64 pictures of the samples that pyrt takes with seed 0 without lines, and of those
    with seed 1 with uniform points on the lights; kept in the folder, if there is one."""
    half, top = ladder[-1] // 2, ladder[-1]
    source = (Path(pictures.__file__).with_suffix(".cl")).read_bytes()
    key = hashlib.sha256(scene_hash(scene).encode() + source).hexdigest()[:12]
    found = []
    for uniform, rungs in ((False, (*ladder[:-1], half, top)), (True, (half, top))):
        path = folder and folder / f"float64-{key}-{SIZE}x{SIZE}-{'-'.join(map(str, rungs))}-{uniform}.npy"
        if path and path.exists():
            images = np.load(path)
        else:
            made = pictures.Pictures(scene).render(rungs, int(uniform), SIZE, uniform)
            images = np.array([made[n] for n in rungs])
            if path:
                path.parent.mkdir(parents=True, exist_ok=True)
                np.save(path, images)
        found.append(dict(zip(rungs, images, strict=True)))
    return found[0], found[1]


def compare(scene: Scene, twins: dict[int, Array], uniform: dict[int, Array], ladder: Ladder) -> Bias:
    """Bias of pyrt's pictures of a scene; the references are as above."""
    half, top = ladder[-1] // 2, ladder[-1]
    scale = float(twins[top].mean())
    plain = _pictures(pyrt.Renderer(scene, lines=False), (*ladder[:-1], half, top), 0)
    gaps = {n: (picture - twins[n]) / scale for n, picture in plain.items()}
    shipped_renderer = pyrt.Renderer(scene)
    errors = {n: (picture - uniform[n]) / scale for n, picture in _pictures(shipped_renderer, (half, top), 1).items()}
    difference = errors[top].mean(2)
    return Bias(
        rounding={n: _rms(gaps[n]) for n in ladder},
        median=float(np.median(np.abs(gaps[top]))),
        rounding_floor=_common(gaps[half], 2 * gaps[top] - gaps[half]),
        error={n: _rms((p - uniform[top]) / scale) for n, p in _pictures(shipped_renderer, ladder, 0).items()},
        floor=_common(errors[half], 2 * errors[top] - errors[half]),
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
