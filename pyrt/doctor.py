"""Whether a device computes as the kernels need it, which `pyrt doctor` reports and other devices than PoCL's must.

Watertight intersection, bounded errors and the absence of NaN rest on a few properties of the arithmetic. `probe` runs
kernels/probe.cl, built like every kernel, and compares it with float32 arithmetic of the host, which follows IEEE 754.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pyrt.device import Device
from pyrt.errors import DeviceError

_COUNT = 8192  # random numbers, beside the special ones
_ROWS = ("sum", "sum8", "fma", "fma8", "quotient", "quotient8", "root", "root8", "min", "unit")
_SPECIAL = np.array([0, -0.0, 1, -1, 2.0**-149, 2.0**-130, 2.0**-126, 3e38, np.inf, -np.inf, np.nan], np.float32)
_SMALLEST = 2.0**-126  # normal number

Floats = NDArray[np.float32]


@dataclass(frozen=True)
class Finding:
    """One property of a device's arithmetic. The kernels cannot do without the `required` ones."""

    what: str
    ok: bool
    required: bool
    otherwise: str  # what follows where it is missing

    def __str__(self) -> str:
        mark = "ok    " if self.ok else "broken" if self.required else "note  "
        return f"{mark}  {self.what}" + ("" if self.ok else f": missing, so that {self.otherwise}")


@dataclass(frozen=True)
class Measured:
    """The numbers a, b, c and bits that went in, (n,) each, and what came out."""

    a: Floats
    b: Floats
    c: Floats
    bits: NDArray[np.uint32]
    results: dict[str, Floats]
    comparisons: NDArray[np.uint32]


def probe(device: Device) -> list[Finding]:
    """What the device's arithmetic keeps of what the kernels rely on.

    Raises:
        DeviceError: the probe does not compile or run.
    """
    return judge(measure(device))


def open_device(wanted: str | int | None = None) -> Device:
    """Opens the device, and probes it unless it is PoCL's CPU device, which the tests hold to the same promises.

    Raises:
        DeviceError: there is none, or it breaks a promise.
    """
    device = Device(wanted)
    if not (device.info.is_pocl and device.info.kind == "cpu"):
        require_sound(device)
    return device


def require_sound(device: Device) -> None:
    """Accepts the device.

    Raises:
        DeviceError: it breaks a promise that the kernels cannot do without.
    """
    for finding in probe(device):
        if finding.required and not finding.ok:
            raise DeviceError(f"{device.info}: expected {finding.what}, without which {finding.otherwise}")


def measure(device: Device, options: tuple[str, ...] = ()) -> Measured:
    """Runs kernels/probe.cl; `options` go to the compiler."""
    rng = np.random.default_rng(0)
    a, b = (rng.normal(size=_COUNT) * 2.0 ** rng.integers(-20, 20, _COUNT) for _ in "ab")
    special_a, special_b = (grid.ravel() for grid in np.meshgrid(_SPECIAL, _SPECIAL))
    a, b = np.r_[a, special_a].astype(np.float32), np.r_[b, special_b].astype(np.float32)
    with np.errstate(all="ignore"):
        c = -(a * b)  # the sum is zero if the product was rounded before, and what was rounded off if not
    bits = rng.integers(0, 2**32, len(a), dtype=np.uint32)
    bits[:3] = 0, 255, 2**32 - 1
    kernel = device.build("probe.cl", options)["probe"]
    inputs = [device.upload("numbers", np.concatenate([a, b, c])), device.upload("bits", bits)]
    outputs = [device.allocate(4 * len(_ROWS) * len(a)), device.allocate(4 * len(a))]
    device.run(kernel, len(a), np.uint32(len(a)), *inputs, *outputs)
    with device.mapped(outputs[0], (len(_ROWS), len(a)), np.float32) as array:
        results = dict(zip(_ROWS, array.copy(), strict=True))
    with device.mapped(outputs[1], (len(a),), np.uint32) as array:
        return Measured(a, b, c, bits, results, array.copy())


def judge(m: Measured) -> list[Finding]:
    """The findings, by comparison with what IEEE 754 says."""
    with np.errstate(all="ignore"):
        product, quotient, root = m.a * m.b, m.a / m.b, np.sqrt(np.abs(m.a))
        fused = (m.a.astype(np.float64) * m.b + m.c).astype(np.float32)
    plain = _normal(product) & (np.abs(product) > 2.0**-100)
    divisible = _normal(quotient) & _normal(m.a) & _normal(m.b)
    rooted = _normal(m.a)
    correct = _within(m, "quotient", quotient, divisible, 0) and _within(m, "root", root, rooted, 0)
    close = _within(m, "quotient", quotient, divisible, 3) and _within(m, "root", root, rooted, 3)
    tiny = (m.b == 1) & (np.abs(m.a) < _SMALLEST) & (m.a != 0)
    kept = bool((m.results["quotient"][tiny] == m.a[tiny]).all())
    leaks, differs = "rays could slip between triangles", "pictures differ from other devices' in the last digits"
    return [
        Finding("separate rounding of products and sums", _within(m, "sum", np.zeros_like(m.c), plain, 0), True, leaks),
        Finding("fused products and sums that round once", _within(m, "fma", fused, plain, 0), True, leaks),
        Finding("false comparisons with NaN", _comparisons_hold(m), True, "bad rays could hit"),
        Finding("minima that ignore NaN", _minima_hold(m), True, "NaN could reach a picture"),
        Finding("random floats below 1", _units_hold(m), True, "samples could leave their pixel"),
        Finding("divisions and square roots within 3 ulp", close, True, "error bounds could be too small"),
        Finding("correctly rounded divisions and square roots", correct, False, differs),
        Finding("denormal numbers", kept, False, "lengths below 1e-38 of the scene count as 0"),
    ]


def _normal(x: Floats) -> NDArray[np.bool_]:
    return np.isfinite(x) & (np.abs(x) >= _SMALLEST)


def _within(m: Measured, row: str, truth: Floats, where: NDArray[np.bool_], ulps: int) -> bool:
    """The row is the truth, alone and as one of eight lanes."""
    limit = ulps * np.spacing(np.abs(truth[where]))
    return all(bool((np.abs(m.results[name][where] - truth[where]) <= limit).all()) for name in (row, f"{row}8"))


def _comparisons_hold(m: Measured) -> bool:
    less, greater, equal = m.a < m.b, m.a > m.b, m.a == m.b
    truth = np.stack([less, greater, less | equal, greater | equal, equal] * 2)  # alone, and as a lane
    return bool((m.comparisons == (truth << np.arange(10)[:, None]).sum(0)).all())


def _minima_hold(m: Measured) -> bool:
    where = np.isnan(m.a) & ~np.isnan(m.b)
    return bool((m.results["min"][where] == m.b[where]).all())


def _units_hold(m: Measured) -> bool:
    return bool((m.results["unit"] == (m.bits >> np.uint32(8)) * 2.0**-24).all())
