"""The measures of the benchmark: error of a picture, time to an error, interleaving, and how results are shown."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest

from bench import error, growth, measure, process, report
from bench.error import Rung
from bench.report import Outcome, Table

ABOUT = {
    "date": "2026-01-02 03:04 UTC",
    "machine": "abacus",
    "command": "python -m bench",
    "peers": "no Mitsuba",
    "device": "beads",
    "versions": {"python": "3"},
}


def test_error_of_a_constant_offset():
    """(0.1)² / (ref² + 0.01) is 0.01 / 0.01 where the reference is black and 0.01 / 1.01 where it is 1."""
    reference = np.zeros((10, 10, 3))
    reference[:5] = 1
    found = measure.error(reference + 0.1, reference)
    assert found.relmse == pytest.approx((1 + 0.01 / 1.01) / 2)
    assert found.rmse == pytest.approx(0.1)


def test_the_worst_tenth_of_a_percent_is_trimmed():
    reference = np.ones((100, 100, 1))
    image = reference.copy()
    image.flat[:10] = 1000.0
    assert measure.error(image, reference).relmse == 0
    image.flat[10] = 1000.0
    assert measure.error(image, reference).relmse > 1


def test_error_is_symmetric_in_sign_and_squares_with_noise():
    random = np.random.default_rng(0)
    reference, noise = random.random((64, 64, 3)), random.normal(size=(64, 64, 3))
    small, large = (measure.error(reference + scale * noise, reference).relmse for scale in (0.01, -0.02))
    assert large == pytest.approx(4 * small)


def test_time_to_an_error_is_interpolated_on_logarithms():
    """On a ladder where the error is 1 / t² any target e is met at 1 / √e, whatever the order of the rungs."""
    seconds = [4.0, 1.0, 16.0]
    errors = [1 / t**2 for t in seconds]
    for target in (0.5, 1 / 16, 0.01, 1 / 256):
        assert measure.seconds_to(target, errors, seconds) == pytest.approx(target**-0.5)


def test_time_to_an_error_out_of_reach():
    assert measure.seconds_to(1e-9, [1e-2, 1e-4], [1, 2]) is None
    assert measure.seconds_to(1.0, [1e-2, 1e-4], [1, 2]) == 1
    assert measure.seconds_to(1.0, [], []) is None


def test_a_step_backwards_on_the_ladder_is_no_obstacle():
    found = measure.seconds_to(1e-3, [1e-2, 3e-2, 1e-4], [1, 2, 4])
    assert 2 < found < 4


def test_jobs_take_turns_after_one_warm_up_each():
    order, results = [], []
    jobs = {name: lambda repetition, name=name: order.append((name, repetition)) or name for name in "AB"}
    seconds = measure.interleaved(jobs, 3, lambda name, result: results.append((name, result)))
    assert order == [("A", 3), ("B", 3), ("A", 0), ("B", 0), ("A", 1), ("B", 1), ("A", 2), ("B", 2)]
    assert results == [("A", "A"), ("B", "B")] * 3
    assert [len(times) for times in seconds.values()] == [3, 3]


def test_ratios_are_pair_by_pair():
    """Twice as fast in every pair, though the machine slowed down a hundredfold in between."""
    assert measure.paired_ratio([1, 100, 3], [2, 200, 6]) == 2
    assert measure.geometric_mean([1, 4]) == pytest.approx(2)
    assert math.isnan(measure.geometric_mean([]))


def ladder(contestant: str, rate: float, quality: float) -> list[Rung]:
    """Rungs whose error is quality / spp and whose time is spp / rate, twice as long in the second repetition."""
    return [
        Rung(contestant, spp, spp, [spp / rate, 2 * spp / rate], quality / spp, 0.0, 0.0, None)
        for spp in (4, 16, 64, 256)
    ]


def test_targets_are_what_the_best_peer_reaches():
    """Against a peer with half the error at an eighth of the rate, the same error takes a quarter of the time."""
    rungs = [*ladder("pyrt", 8, 2.0), *ladder("slow peer", 0.1, 9.0), *ladder("peer", 1, 1.0)]
    rows = error.targets(rungs)
    assert [row["spp"] for row in rows] == [16, 64, 256]
    for row in rows[:2]:
        assert row["relmse"] == pytest.approx(1 / row["spp"])
        assert (row["ours"], row["peer"]) == ("pyrt", "peer")
        assert row["seconds"] == pytest.approx(1.5 * row["spp"] * 2 / 8)
        assert row["ratio"] == pytest.approx(4)
    assert rows[2]["ours"] is None
    assert rows[2]["ratio"] is None


def test_the_faster_of_our_two_ways_counts():
    rungs = [*ladder("pyrt", 1, 1.0), *ladder("pyrt --noise", 1, 0.5), *ladder("peer", 1, 1.0)]
    assert {row["ours"] for row in error.targets(rungs)} == {"pyrt --noise"}
    assert error.targets(rungs)[0]["ratio"] == pytest.approx(2)


def test_without_a_peer_our_own_errors_are_the_targets():
    row = error.targets(ladder("pyrt", 1, 1.0))[0]
    assert row["relmse"] == pytest.approx(1 / 16)
    assert row["seconds"] == pytest.approx(1.5 * 16)
    assert row["peer"] is None
    assert row["ratio"] is None


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (math.nan, "–"),
        (0, "0"),
        (1.2345, "1.23"),
        (12345.6, "12,346"),
        (2e-6, "2.00e-06"),
        (3e7, "3.00e+07"),
    ],
)
def test_numbers(value, text):
    assert report.number(value) == text


def test_a_table_is_aligned_markdown_with_its_provenance():
    table = Table("Ray rates", ("scene", "Mrays/s"), (("Cornell", "9.5"), ("mesh", "10.25")), ("higher is better",))
    lines = report.markdown(table, ABOUT).splitlines()
    assert lines[0] == "### Ray rates"
    assert lines[2:4] == ["2026-01-02 03:04 UTC; abacus; `python -m bench`", "beads; no Mitsuba; python 3"]
    assert lines[5:9] == [
        "| scene   | Mrays/s |",
        "|---------|--------:|",
        "| Cornell |     9.5 |",
        "| mesh    |   10.25 |",
    ]
    assert lines[10] == "* higher is better"


def test_two_runs_are_compared_by_their_figures(tmp_path):
    path = tmp_path / "old.json"
    report.write_json(path, ABOUT, {"rays": Outcome((), {"rate": 4.0, "gone": 1.0}, {"seconds": [1.0]})})
    old = json.loads(path.read_text(encoding="utf-8"))
    table = report.comparison(old, {"rays": Outcome((), {"rate": 6.0, "added": 2.0}, {})})
    assert set(table.rows) == {
        ("rays: rate", "4", "6", "1.5"),
        ("rays: added", "–", "2", "–"),
        ("rays: gone", "1", "–", "–"),
    }


def test_a_run_says_what_it_ran_on():
    about = report.provenance(["error", "--scene", "mesh room"], "beads", "no Mitsuba")
    assert about["command"] == "python -m bench error --scene 'mesh room'"
    assert about["versions"]["numpy"] == np.__version__
    assert "cores" in about["machine"]


SIZES = [10.0, 20.0, 80.0, 320.0]


@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0, 2.0])
def test_exponents_of_powers(exponent):
    cost = [3 * size**exponent for size in SIZES]
    assert growth.exponents(SIZES, cost) == pytest.approx([exponent] * 3)
    assert growth.cliffs(SIZES, cost, exponent) == [False] * 3
    assert growth.cliffs(SIZES, cost, exponent - 0.5) == [True] * 3


def test_a_cliff_is_found_where_it_is():
    """Of a fifth between two sizes of otherwise linear cost; a tenth, as times are not exact, is none."""
    assert growth.cliffs(SIZES, [1, 2, 8 * 1.2, 32 * 1.2], 1) == [False, True, False]
    assert growth.cliffs(SIZES, [1, 2, 8 * 1.1, 32 * 1.1], 1) == [False] * 3


def test_the_table_of_growth_marks_cliffs():
    found = {"load": [1.0, 1, 1, 1], "build": SIZES, "render": [1.0, 2, 8, 320], "peak": [100.0, 101, 103, 200]}
    limits = {"build": 1, "render": 1}
    rows = growth.table("lights", [10, 20, 80, 320], found, limits).rows
    assert rows[0] == ("10", "1", "", "10", "", "1", "", "100", "")
    assert rows[3] == ("320", "1", "0.00", "320", "1.00", "320", "2.66 *", "200", "0.48 *")
    assert not any("*" in cell for row in rows[:3] for cell in row)


def test_processes_are_measured_by_themselves():
    """Not with the memory of this one, which is larger."""
    held = np.ones(1 << 24)
    small, large = (process.run_python(["-c", code]) for code in ("print(1)", "print(len(b'x' * (1 << 26)))"))
    assert (small.output, large.output) == ("1\n", f"{1 << 26}\n")
    assert small.peak < 64 < large.peak < held.nbytes >> 20
    with pytest.raises(RuntimeError, match=r"failed: .*no such thing"):
        process.run_python(["-c", "raise SystemExit('no such thing')"])
