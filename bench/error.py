"""Run time against error: how long until the error of a picture is below what somebody needs."""

from __future__ import annotations

import hashlib
import pickle
import statistics
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import pyrt
from bench import error_tables, peers_mitsuba, report
from bench.generated import unseen
from bench.measure import DARK, error, geometric_mean, interleaved, paired_ratio, seconds_to, squared_errors
from bench.report import Outcome
from bench.scenes import ERROR_SCENES, QUICK_SCENES, error_scene
from pyrt.scene import Scene

UNIFORM, ADAPTIVE = "pyrt", "pyrt --noise"
OURS = (UNIFORM, ADAPTIVE)
OUR_LADDER = (1, 4, 16, 36, 64, 144, 256, 576)
NOISE_LADDER = tuple(0.1 * 2.0**-k for k in range(12))
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

    size: int = 256
    repeats: int = 5
    reference_spp: int = 1 << 14
    scenes: tuple[str, ...] = field(default_factory=lambda: (*ERROR_SCENES, *unseen()))
    max_spp: int = 576
    device: str | None = None


QUICK = Settings(size=96, repeats=3, reference_spp=1 << 11, scenes=QUICK_SCENES, max_spp=256)


@dataclass(frozen=True)
class Shot:
    """A picture, its samples per pixel, and the relative error that the renderer states."""

    image: Image
    spp: float
    stated: float | None = None


Contestants = dict[str, tuple[Callable[[float, int], Shot], tuple[float, ...]]]  # (setting, seed) -> picture; settings


@dataclass(frozen=True)
class Rung:
    """One step of a ladder: seconds of each repetition, and means over the seeds."""

    contestant: str
    setting: float
    spp: float
    seconds: list[float]
    relmse: float
    rmse: float
    reached: float  # root of the relMSE with nothing trimmed, without the reference's noise, which `stated` estimates
    stated: float | None


def run(settings: Settings, out: Path) -> Outcome:
    """Measures every scene; writes plots, error maps and cached references into `out`."""
    measured = {name: _measure(name, settings, out) for name in settings.scenes}
    ratios = {name: [row["ratio"] for row in data["targets"] if row["ratio"]] for name, data in measured.items()}
    every = [ratio for values in ratios.values() for ratio in values]
    figures = {f"{name}, times faster": geometric_mean(values) for name, values in ratios.items() if values}
    if every:
        figures["all scenes, times faster"] = geometric_mean(every)
    size = f"{settings.size}×{settings.size} pixels, {settings.repeats} interleaved repetitions, reference of "
    return Outcome(error_tables.tables(measured, size + f"{settings.reference_spp} spp."), figures, measured)


def _measure(name: str, settings: Settings, out: Path) -> dict[str, Any]:
    """Everything about one scene, as plain data."""
    print(f"error: {name}", file=sys.stderr)
    scene, size = error_scene(name), (settings.size, settings.size)
    ours = pyrt.Renderer(scene, settings.device)
    halves = _reference(name, scene, ours, size, settings.reference_spp, out)
    contestants = _ours(ours, size, settings.max_spp)
    bias = None
    if peers_mitsuba.version() and peers_mitsuba.can_express(scene):
        theirs = peers_mitsuba.renderer(scene, size)
        contestants |= _theirs(theirs, settings.max_spp)
        bias = _bias(theirs, halves)
    rungs, pictures = _climb(contestants, halves, settings.repeats)
    _draw(name, rungs, pictures, halves.mean(axis=0), out)
    seconds = ours.render(16, 0, size).stats["seconds"]
    return {"rungs": [asdict(rung) for rung in rungs], "targets": targets(rungs), "bias": bias, "stages": seconds}


def _ours(renderer: pyrt.Renderer, size: tuple[int, int], max_spp: int) -> Contestants:
    """pyrt with fixed samples and with noise targets, these down to about `max_spp` samples on average."""

    def uniform(spp: float, seed: int) -> Shot:
        return Shot(renderer.render(int(spp), seed, size).image, spp)

    def adaptive(noise: float, seed: int) -> Shot:
        result = renderer.render(None, seed, size, noise=noise)
        return Shot(result.image, float(result.samples.mean()), result.stats["noise"])

    noises: dict[float, float] = {}  # by the samples that they take: the first targets ask for no more than the least
    for noise in NOISE_LADDER:
        spp = adaptive(noise, 0).spp
        if spp > max_spp:
            break
        noises[spp] = noise
    ladder = tuple(float(spp) for spp in OUR_LADDER if spp <= max_spp)
    return {UNIFORM: (uniform, ladder), ADAPTIVE: (adaptive, tuple(noises.values()))}


def _theirs(render: Callable[[str, int, int], Image], max_spp: int) -> Contestants:
    def shot(sampler: str, spp: float, seed: int) -> Shot:
        return Shot(render(sampler, int(spp), seed), spp)

    ladders = {name: tuple(float(spp) for spp in ladder if spp <= max_spp) for name, ladder in PEER_LADDER.items()}
    return {sampler: (partial(shot, sampler), ladder) for sampler, ladder in ladders.items()}


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
    contestants: Contestants, halves: NDArray[np.float64], repeats: int
) -> tuple[list[Rung], dict[tuple[str, float], Image]]:
    """All rungs of all ladders, interleaved; and the last picture of each."""
    reference = halves.mean(axis=0)
    jobs = {(name, step): partial(render, step) for name, (render, ladder) in contestants.items() for step in ladder}
    shots: dict[tuple[str, float], list[Any]] = {key: [] for key in jobs}
    pictures: dict[tuple[str, float], Image] = {}

    def done(key: tuple[str, float], shot: Shot) -> None:
        found = error(shot.image, reference)
        shots[key].append((shot.spp, found.relmse, found.rmse, _product(shot.image, shot.image, halves), shot.stated))
        pictures[key] = shot.image

    seconds = interleaved(jobs, repeats, done)
    rungs = []
    for key in jobs:
        spp, relmse, rmse, untrimmed, stated = zip(*shots[key], strict=True)
        mean = statistics.fmean
        claim = mean(stated) if None not in stated else None
        reached = max(mean(untrimmed), 0.0) ** 0.5
        rungs.append(Rung(*key, mean(spp), seconds[key], mean(relmse), mean(rmse), reached, claim))
    return rungs, pictures


def targets(rungs: list[Rung]) -> list[dict[str, Any]]:
    """For each target: the relMSE, and the seconds that we and the fastest peer sampler take to it.

    The ratio is the median over the repetitions, pair by pair. Without a peer our own errors are the targets.
    """
    names = {rung.contestant for rung in rungs}
    peers = sorted(names - set(OURS))
    rows = []
    for spp in TARGET_SPP:
        reached = [rung.relmse for rung in rungs if rung.setting == spp and rung.contestant in (peers or [UNIFORM])]
        if not reached:
            continue
        target = min(reached)
        ours, our_times = _fastest(rungs, [name for name in OURS if name in names], target)
        theirs, their_times = _fastest(rungs, peers, target)
        both = bool(ours and theirs)
        rows.append(
            {
                "spp": spp,
                "relmse": target,
                "ours": ours,
                "seconds": statistics.median(our_times) if ours else None,
                "peer": theirs,
                "peer_seconds": statistics.median(their_times) if theirs else None,
                "ratio": paired_ratio(our_times, their_times) if both else None,
            }
        )
    return rows


def _fastest(rungs: list[Rung], names: list[str], target: float) -> tuple[str | None, list[float]]:
    """Which of the contestants gets to the target first, and its seconds in each repetition; None if none does."""
    best: tuple[str | None, list[float]] = (None, [])
    for name in names:
        ladder = [rung for rung in rungs if rung.contestant == name]
        errors = [rung.relmse for rung in ladder]
        found = [
            seconds_to(target, errors, seconds) for seconds in zip(*(rung.seconds for rung in ladder), strict=True)
        ]
        times = [t for t in found if t is not None]
        if (
            len(times) == len(found)
            and times
            and (not best[0] or statistics.median(times) < statistics.median(best[1]))
        ):
            best = name, times
    return best


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
    first, second = np.mean(renders[::2], axis=0), np.mean(renders[1::2], axis=0)
    return {
        "mean": float(means.mean()),
        "deviation": float(np.hypot(means.std(ddof=1) / np.sqrt(len(means)), own)),
        "relmse": _product(first, second, halves),
        "noisy": float(squared_errors(first, halves[0]).mean()),
    }


def _product(first: NDArray[Any], second: NDArray[Any], halves: NDArray[np.float64]) -> float:
    """The relMSE between pictures and reference, two of each, without the noise that the two do not share."""
    return float(((first - halves[0]) * (second - halves[1]) / (halves.mean(axis=0) ** 2 + DARK)).mean())


def _draw(name: str, rungs: list[Rung], pictures: dict[tuple[str, float], Image], reference: Any, out: Path) -> None:
    lines: dict[str, Any] = {}
    for rung in rungs:
        label = rung.contestant if rung.contestant in OURS else f"Mitsuba {rung.contestant}"
        seconds, errors = lines.setdefault(label, ([], []))
        seconds.append(statistics.median(rung.seconds))
        errors.append(rung.relmse)
    stem = name.replace(" ", "_")
    report.curves(out / f"error_{stem}.png", name, lines)
    near = {rung.contestant: rung for rung in sorted(rungs, key=lambda rung: -abs(np.log(rung.spp / 64)))}
    shown = {
        f"{who}, {rung.spp:.0f} spp": squared_errors(pictures[who, rung.setting], reference).mean(axis=2)
        for who, rung in near.items()
    }
    report.error_maps(out / f"map_{stem}.png", name, shown)
