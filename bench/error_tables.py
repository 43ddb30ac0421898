"""The tables of `bench.error`, made from its data alone."""

from __future__ import annotations

import statistics
from collections.abc import Mapping
from typing import Any

from bench.measure import geometric_mean, seconds_to
from bench.report import Table, number


def tables(measured: Mapping[str, Any], how: str) -> tuple[Table, ...]:
    """All tables that have rows; `how` is a note on the settings."""
    parts = (_samples, _ladders, _noise, _stages, _bias)
    made = (_targets(measured, how), *(part(measured) for part in parts))
    return tuple(table for table in made if table.rows)


def _targets(measured: Mapping[str, Any], how: str) -> Table:
    rows, ratios = [], []
    for name, data in measured.items():
        for row in data["targets"]:
            ours, theirs = (
                f"{number(row[time])} ({row[who]})" if row[who] else "–"
                for who, time in (("ours", "seconds"), ("peer", "peer_seconds"))
            )
            rows.append((name, str(row["spp"]), number(row["relmse"], 2), ours, theirs, number(row["ratio"])))
            ratios += [row["ratio"]] if row["ratio"] else []
    notes = [
        "The target is the relMSE that Mitsuba's best sampler reaches with so many samples per pixel (without Mitsuba: "
        "that pyrt reaches). Times are renders only, warm, interpolated on log–log; a dash: out of the ladder's reach.",
        how,
    ]
    if ratios:
        mean, least = number(geometric_mean(ratios)), number(min(ratios))
        notes.insert(0, f"Geometric mean: pyrt is {mean} times as fast; least {least}.")
    columns = ("scene", "peer spp", "relMSE", "pyrt s", "Mitsuba s", "times faster")
    return Table("Time to an error", columns, tuple(rows), tuple(notes))


def _samples(measured: Mapping[str, Any]) -> Table:
    rows = []
    for name, data in measured.items():
        adaptive = [rung for rung in data["rungs"] if rung["stated"] is not None]
        errors, samples = ([rung[key] for rung in adaptive] for key in ("relmse", "spp"))
        for rung in data["rungs"]:
            if rung["contestant"] == "pyrt" and rung["setting"] in {row["spp"] for row in data["targets"]}:
                needed = seconds_to(rung["relmse"], errors, samples)
                fewer = rung["spp"] / needed if needed else None
                rows.append((name, str(int(rung["spp"])), number(rung["relmse"], 2), number(needed), number(fewer)))
    notes = ("Samples per pixel of pyrt --noise to the relMSE that pyrt reaches with the same number for every pixel.",)
    return Table("Samples to an error", ("scene", "spp", "relMSE", "--noise spp", "times fewer"), tuple(rows), notes)


def _ladders(measured: Mapping[str, Any]) -> Table:
    rows = []
    for name, data in measured.items():
        for rung in data["rungs"]:
            setting = "" if rung["stated"] is None else f" {number(rung['setting'], 2)}"
            seconds, errors = statistics.median(rung["seconds"]), (number(rung[key], 2) for key in ("relmse", "rmse"))
            rows.append((name, rung["contestant"] + setting, number(rung["spp"]), number(seconds), *errors))
    return Table("Ladders", ("scene", "sampler", "spp", "median s", "relMSE", "RMSE"), tuple(rows))


def _noise(measured: Mapping[str, Any]) -> Table:
    rows = []
    for name, data in measured.items():
        for rung in data["rungs"]:
            if rung["stated"] is not None:
                values = (number(rung[key], 2) for key in ("setting", "stated", "reached", "spp"))
                rows.append((name, *values, number(rung["reached"] / rung["stated"], 2)))
    columns = ("scene", "--noise", "stated", "reached", "spp", "reached / stated")
    notes = ("Root of the mean squared relative error of the whole picture, nothing trimmed. Honest: at most 1.5.",)
    return Table("Noise targets", columns, tuple(rows), notes)


def _stages(measured: Mapping[str, Any]) -> Table:
    stages = list(next(iter(measured.values()))["stages"]) if measured else []
    rows = [(name, *(number(data["stages"][stage]) for stage in stages)) for name, data in measured.items()]
    return Table("Stages at 16 spp", ("seconds", *stages), tuple(rows))


def _bias(measured: Mapping[str, Any]) -> Table:
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
