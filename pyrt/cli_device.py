"""The verbs about this machine: `devices` and `doctor`."""

from __future__ import annotations

import argparse

from pyrt.cli_options import Verbs, add_verb
from pyrt.errors import DeviceError

_DEVICES_EXAMPLES = """\
  pyrt devices                                  * marks the one that pyrt takes by default
"""
_DOCTOR_EXAMPLES = """\
  pyrt doctor                                   checks the default device
  pyrt doctor --device 1                        or another one of: pyrt devices
"""


def add_verbs(verbs: Verbs) -> None:
    """Declares `devices` and `doctor`."""
    add_verb(verbs, "devices", "", _devices, "list the OpenCL devices", _DEVICES_EXAMPLES)
    text = "check whether this machine can render, how exact it is, and what repairs it"
    doctor = add_verb(verbs, "doctor", "", _doctor, text, _DOCTOR_EXAMPLES)
    doctor.add_argument("--device", metavar="NAME", help="index or part of the name of the device to probe")


def _devices(args: argparse.Namespace) -> int:
    from pyrt.device import choose_device, list_devices

    default = choose_device()
    for device in list_devices():
        mark = "*" if device.index == default.index else " "
        size = f"{device.compute_units} compute units, {device.memory / 2**30:.1f} GiB"
        print(f"{mark} {device.index}: {device.kind}  {device.name}")
        print(f"      {device.platform}, {device.version}\n      {size}")
    return 0


def _doctor(args: argparse.Namespace) -> int:
    from pyrt.checkup import doctor_report

    report, sound = doctor_report(args.device)
    print(report)
    return 0 if sound else DeviceError.exit_code
