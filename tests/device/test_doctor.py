"""The probe of a device's arithmetic: this device keeps every promise, and a device that breaks one is found out."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from pyrt.device import DeviceInfo
from pyrt.doctor import Finding, judge, measure, open_device, probe, require_sound
from pyrt.errors import DeviceError
from pyrt.layout import kernel_dir
from tests.controls import kernels
from tests.device.probe import device

PROMISES = {finding.what: finding.required for finding in probe(device())}


@pytest.mark.parametrize("what", PROMISES)
def test_the_device_keeps_the_promise(what):
    assert next(finding for finding in probe(device()) if finding.what == what).ok


def broken(findings: list[Finding]) -> list[str]:
    return [finding.what for finding in findings if not finding.ok]


@contextmanager
def edited(file: str, old: str, new: str) -> Iterator[None]:
    """Kernels with one edit."""
    text = (kernel_dir() / file).read_text(encoding="utf-8")
    assert text.count(old) == 1
    with kernels(files={file: text.replace(old, new)}):
        yield


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("{a * b + c,", "{fma(a, b, c),", "separate rounding of products and sums"),
        ("sum8 = a8 * b8 + c8", "sum8 = fma8(a8, b8, c8)", "separate rounding of products and sums"),
        ("fma1(a, b, c)", "a * b + c", "fused products and sums that round once"),
        ("fused8 = fma8(a8, b8, c8)", "fused8 = a8 * b8 + c8", "fused products and sums that round once"),
        ("(uint)(a < b)", "(uint)!(a >= b)", "false comparisons with NaN"),
        ("mask8(a8 <= b8)", "mask8(!(a8 > b8))", "false comparisons with NaN"),
        ("min1(a, b)", "(b < a ? b : a)", "minima that ignore NaN"),
        ("unit_float(bits[i])", "(float)bits[i] * 0x1p-32f", "random floats below 1"),
        ("a / b,", "a * (1.0f / b),", "correctly rounded divisions and square roots"),
    ],
)
def test_arithmetic_that_breaks_a_promise_is_found(old, new, what):
    with edited("probe.cl", old, new):
        assert broken(probe(device())) == [what]


def test_a_contracting_compiler_is_found():
    """The pragma is what keeps a compiler from fusing."""
    with edited("simd.h", "#pragma OPENCL FP_CONTRACT OFF", "#pragma OPENCL FP_CONTRACT ON"):
        assert "separate rounding of products and sums" in broken(probe(device()))


def test_a_compiler_that_assumes_finite_numbers_is_found():
    assert "false comparisons with NaN" in broken(judge(measure(device(), ("-cl-finite-math-only",))))


def test_flushed_denormals_are_a_note():
    measured = measure(device())
    quotient = measured.results["quotient"]
    flushed = np.where(np.abs(quotient) < 2.0**-126, np.float32(0), quotient)
    findings = judge(replace(measured, results={**measured.results, "quotient": flushed}))
    assert broken(findings) == ["denormal numbers"]
    assert not any(finding.required for finding in findings if not finding.ok)


@pytest.mark.parametrize("row", ["quotient", "quotient8", "root", "root8"])
def test_coarse_divisions_are_found(row):
    measured = measure(device())
    for ulps, expected in ((1, 1), (4, 2)):
        values = measured.results[row] * np.float32(1 + ulps * 2.0**-23)
        assert len(broken(judge(replace(measured, results={**measured.results, row: values})))) == expected


def test_a_broken_device_is_refused_with_one_sentence():
    require_sound(device())
    with edited("probe.cl", "fma1(a, b, c)", "a * b + c"), pytest.raises(DeviceError) as error:
        require_sound(device())
    assert str(error.value) == (
        f"{device().info}: expected fused products and sums that round once, without which "
        "rays could slip between triangles"
    )


def test_other_devices_than_pocl_are_probed_before_use(monkeypatch):
    with edited("probe.cl", "fma1(a, b, c)", "a * b + c"):
        open_device()
        monkeypatch.setattr(DeviceInfo, "is_pocl", False)
        with pytest.raises(DeviceError, match="rays could slip"):
            open_device()
