"""Run time against error: how long until the error of a picture is below what somebody needs."""

from __future__ import annotations

import hashlib
import pickle
import statistics
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import peers_mitsuba, report
from bench.measure import DARK, error, geometric_mean, interleaved, seconds_to, squared_errors
from bench.report import Outcome, Table, number
from bench.scenes import ERROR_SCENES, QUICK_SCENES
from pyrt.scene import Scene

OURS = "pyrt"
OUR_LADDER = (1, 4, 16, 36, 64, 144, 256, 576)
PEER_LADDER = {
    "independent": (4, 16, 36, 64, 144, 256),
    "stratified": (4, 16, 36, 64, 144, 256),
    "multijitter": (4, 16, 36, 64, 144, 256),
    "ldsampler": (4, 16, 64, 256),
}
TARGET_SPP = (16, 64, 256)  # what the best peer sampler reaches with so many samples is what the table asks for
REFERENCE_SEEDS = (0x5EED, 0xACC0)
BIAS_RENDERS = 8  # of 256 spp, in two halves

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Settings:
    """What `python -m bench error` may be told."""

    size: int = 512
    repeats: int = 5
    reference_spp: int = 1 << 14
    scenes: tuple[str, ...] = tuple(ERROR_SCENES)
    max_spp: int = 576
    device: str | None = None


QUICK = Settings(size=128, repeats=3, reference_spp=1 << 11, scenes=QUICK_SCENES, max_spp=256)


@dataclass(frozen=True)
class Rung:
    """One step of a ladder: the median of its seconds, and its mean error over the seeds."""

    contestant: str
    spp: int
    seconds: list[float]
    relmse: float
    rmse: float


def run(settings: Settings, out: Path) -> Outcome:
    """Measures every scene; writes plots, error maps and cached references into `out`."""
    measured = {name: _measure(name, settings, out) for name in settings.scenes}
    names = [name for name in settings.scenes if measured[name]["targets"]]
    ratios = {name: [row["ratio"] for row in measured[name]["targets"] if row["ratio"]] for name in names}
    every = [ratio for values in ratios.values() for ratio in values]
    figures = {f"{name}, times faster": geometric_mean(values) for name, values in ratios.items() if values}
    if every:
        figures["all scenes, times faster"] = geometric_mean(every)
    tables = (_target_table(measured, settings), _ladder_table(measured), _bias_table(measured))
    return Outcome(tuple(table for table in tables if table.rows), figures, measured)


def _measure(name: str, settings: Settings, out: Path) -> dict[str, Any]:
    """Everything about one scene, as plain data."""
    print(f"error: {name}", file=sys.stderr)
    scene, size = ERROR_SCENES[name](), (settings.size, settings.size)
    ours = pyrt.Renderer(scene, settings.device)
    halves = _reference(name, scene, ours, size, settings.reference_spp, out)
    reference = halves.mean(axis=0)
    contestants: dict[str, Callable[[int, int], Image]] = {OURS: lambda spp, seed: ours.render(spp, seed, size).image}
    ladders: dict[str, tuple[int, ...]] = {OURS: OUR_LADDER}
    bias = None
    if peers_mitsuba.version() and peers_mitsuba.can_express(scene):
        theirs = peers_mitsuba.renderer(scene, size)
        for sampler, ladder in PEER_LADDER.items():
            contestants[sampler] = partial(theirs, sampler)
            ladders[sampler] = ladder
        bias = _bias(theirs, halves)
    rungs, pictures = _climb(contestants, ladders, reference, settings)
    _draw(name, rungs, pictures, reference, out)
    return {
        "rungs": [asdict(rung) for rung in rungs],
        "targets": _targets(rungs),
        "bias": bias,
        "stages": ours.render(16, 0, size).stats["seconds"],
    }


def _reference(
    name: str, scene: Scene, ours: pyrt.Renderer, size: tuple[int, int], spp: int, out: Path
) -> NDArray[np.float64]:
    """pyrt's converged picture as two independent halves (2, height, width, 3), kept on disk by a hash of the scene."""
    key = hashlib.sha256(pickle.dumps(scene)).hexdigest()[:12]
    path = out / "reference" / f"{name.replace(' ', '_')}-{key}-{size[0]}x{size[1]}-{spp}.npy"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        np.save(path, [ours.render(spp // 2, seed, size).image for seed in REFERENCE_SEEDS])
    return np.asarray(np.load(path), np.float64)


def _climb(
    contestants: dict[str, Callable[[int, int], Image]],
    ladders: dict[str, tuple[int, ...]],
    reference: NDArray[np.float64],
    settings: Settings,
) -> tuple[list[Rung], dict[tuple[str, int], Image]]:
    """All rungs of all ladders, interleaved; and the last picture of each."""
    jobs = {
        (name, spp): lambda seed, name=name, spp=spp: contestants[name](spp, seed)
        for name, ladder in ladders.items()
        for spp in ladder
        if spp <= settings.max_spp
    }
    errors: dict[tuple[str, int], list[Any]] = {key: [] for key in jobs}
    pictures: dict[tuple[str, int], Image] = {}

    def done(key: tuple[str, int], image: Image) -> None:
        errors[key].append(error(image, reference))
        pictures[key] = image

    seconds = interleaved(jobs, settings.repeats, done)
    rungs = [
        Rung(
            *key,
            seconds[key],
            statistics.fmean(e.relmse for e in errors[key]),
            statistics.fmean(e.rmse for e in errors[key]),
        )
        for key in jobs
    ]
    return rungs, pictures


def _targets(rungs: list[Rung]) -> list[dict[str, Any]]:
    """For each target: the relMSE, and the seconds that we and the fastest peer sampler take to it.

    The ratio is the median over the repetitions, pair by pair. Without a peer our own errors are the targets.
    """
    names = sorted({rung.contestant for rung in rungs} - {OURS})
    rows = []
    for spp in TARGET_SPP:
        at = {rung.contestant: rung.relmse for rung in rungs if rung.spp == spp}
        if not at:
            continue
        target = min(at[name] for name in at if name != OURS or not names)
        ours = _times(rungs, OURS, target)
        times = {name: _times(rungs, name, target) for name in names}
        reached = {name: statistics.median(t) for name, t in times.items() if t}
        best = min(reached, key=lambda name: reached[name], default=None)
        ratio = statistics.median(b / a for a, b in zip(ours, times[best], strict=True)) if ours and best else None
        rows.append(
            {
                "spp": spp,
                "relmse": target,
                "seconds": statistics.median(ours) if ours else None,
                "peer": best,
                "peer_seconds": best and reached[best],
                "ratio": ratio,
            }
        )
    return rows


def _times(rungs: list[Rung], contestant: str, target: float) -> list[float]:
    """Seconds to the target in each repetition; empty where the ladder does not reach it."""
    ladder = [rung for rung in rungs if rung.contestant == contestant]
    errors = [rung.relmse for rung in ladder]
    times = [seconds_to(target, errors, seconds) for seconds in zip(*(rung.seconds for rung in ladder), strict=True)]
    return [t for t in times if t is not None] if None not in times else []


def _bias(theirs: Callable[[str, int, int], Image], halves: NDArray[np.float64]) -> dict[str, float]:
    """How far the peer's converged picture is from our reference, given as two halves.

    `mean`: relative difference of the whole picture, and the standard error of both together. `relmse`: the relMSE
    between the two without the noise of either, from the product of the differences of independent halves; `noisy`:
    that of one half.
    """
    renders = [np.asarray(theirs("multijitter", 256, 100 + seed), np.float64) for seed in range(BIAS_RENDERS)]
    reference = halves.mean(axis=0)
    means = np.array([image.mean() for image in renders]) / reference.mean() - 1
    own = abs(halves[0].mean() - halves[1].mean()) / 2 / reference.mean()
    differences = [np.mean(renders[half::2], axis=0) - halves[half] for half in (0, 1)]
    return {
        "mean": float(means.mean()),
        "deviation": float(np.hypot(means.std(ddof=1) / np.sqrt(len(means)), own)),
        "relmse": float((differences[0] * differences[1] / (reference**2 + DARK)).mean()),
        "noisy": float((differences[0] ** 2 / (reference**2 + DARK)).mean()),
    }


def _draw(name: str, rungs: list[Rung], pictures: dict[tuple[str, int], Image], reference: Any, out: Path) -> None:
    lines: dict[str, Any] = {}
    for rung in rungs:
        label = OURS if rung.contestant == OURS else f"Mitsuba {rung.contestant}"
        seconds, errors = lines.setdefault(label, ([], []))
        seconds.append(statistics.median(rung.seconds))
        errors.append(rung.relmse)
    stem = name.replace(" ", "_")
    report.curves(out / f"error_{stem}.png", name, lines)
    shown = {
        f"{who}, {spp} spp": squared_errors(image, reference).mean(axis=2)
        for (who, spp), image in pictures.items()
        if spp == 64
    }
    report.error_maps(out / f"map_{stem}.png", name, shown)


# Tables ---------------------------------------------------------------------------------------------------------------


def _target_table(measured: dict[str, Any], settings: Settings) -> Table:
    rows = []
    for name, data in measured.items():
        for row in data["targets"]:
            rows.append(
                (
                    name,
                    str(row["spp"]),
                    number(row["relmse"], 2),
                    number(row["seconds"]),
                    number(row["peer_seconds"]),
                    row["peer"] or "–",
                    number(row["ratio"]),
                )
            )
    ratios = [row["ratio"] for data in measured.values() for row in data["targets"] if row["ratio"]]
    notes = [
        "The target is the relMSE that Mitsuba's best sampler reaches with so many samples per pixel (without Mitsuba: "
        "that pyrt reaches). Times are renders only, warm, interpolated on log–log; a dash: out of the ladder's reach.",
        f"{settings.size}×{settings.size} pixels, {settings.repeats} interleaved repetitions, reference of "
        f"{settings.reference_spp} spp.",
    ]
    if ratios:
        mean, least = number(geometric_mean(ratios)), number(min(ratios))
        notes.insert(0, f"Geometric mean: pyrt is {mean} times as fast; least {least}.")
    columns = ("scene", "peer spp", "relMSE", "pyrt s", "Mitsuba s", "sampler", "times faster")
    return Table("Time to an error", columns, tuple(rows), tuple(notes))


def _ladder_table(measured: dict[str, Any]) -> Table:
    rows = []
    for name, data in measured.items():
        for rung in data["rungs"]:
            seconds, errors = statistics.median(rung["seconds"]), (number(rung[key], 2) for key in ("relmse", "rmse"))
            rows.append((name, rung["contestant"], str(rung["spp"]), number(seconds), *errors))
    return Table("Ladders", ("scene", "sampler", "spp", "median s", "relMSE", "RMSE"), tuple(rows))


def _bias_table(measured: dict[str, Any]) -> Table:
    rows = [
        (name, f"{b['mean']:+.1e}", f"{b['deviation']:.1e}", f"{b['relmse']:+.1e}", f"{b['noisy']:.1e}")
        for name, data in measured.items()
        if (b := data["bias"])
    ]
    columns = ("scene", "mean", "± standard error", "relMSE of bias", "relMSE with noise")
    notes = (
        "The peer's converged picture against our reference: whole picture, and per pixel with the noise taken out. "
        "Near zero on both proves that the scenes are the same.",
    )
    return Table("Bias of Mitsuba against pyrt", columns, tuple(rows), notes)
