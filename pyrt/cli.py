"""The command line: `python -m pyrt VERB …`, or `pyrt VERB …`. Heavy imports wait until a verb needs them."""

from __future__ import annotations

import argparse
import io
import json
import os
import sys
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from pyrt import __version__
from pyrt.errors import DeviceError, PyrtError, SceneError, UsageError

if TYPE_CHECKING:
    from pyrt.renderer import Result
    from pyrt.scene import Scene

_EXIT_CODES = """exit codes:
  0 done   1 rendering failed   2 wrong usage   3 invalid scene   4 no usable OpenCL device
  5 stopped by a limit before the noise target, with a valid picture   130 interrupted"""
_STOPPED = 5

_RENDER_EXAMPLES = """examples:
  pyrt render scenes/cornell.json                        writes cornell.exr and cornell.png
  pyrt render example:showcase --spp 256 -o glass.png    a scene that comes with pyrt
  pyrt render scene.json --size 320x240 --set camera.fov=30
  pyrt render scene.json -o a.exr -o a.png --exposure 1  several files from one rendering
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Runs one command; returns the exit code."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # names of files need not be text
    parser = _parser()
    args = parser.parse_args(argv)
    if any(value == [] or (isinstance(value, list) and [] in value) for value in vars(args).values()):
        parser.error("an option has the value --")  # `--spp=--`, which Python's argparse before 3.13 takes for []
    try:
        status: int = args.run(args)
        return status
    except PyrtError as error:
        print(f"pyrt: {error}" if not isinstance(error, SceneError) else error, file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print("pyrt: interrupted", file=sys.stderr)
        return 130
    except BrokenPipeError:
        sys.stderr.close()
        return 1


# --- verbs ------------------------------------------------------------------------------------------------------------


def _render(args: argparse.Namespace) -> int:
    from pyrt.progress import show_progress
    from pyrt.renderer import Renderer

    _check_outputs(args.output or [], args)
    with show_progress("none" if args.quiet else args.progress) as progress:
        progress({"stage": "load", "done": 0.0})
        scene = _load(args)
        outputs = args.output or [f"{scene.name}.exr", f"{scene.name}.png"]
        _check_outputs(outputs, args)
        renderer = Renderer(scene, args.device, progress=progress)
        result = renderer.render(
            args.spp, args.seed, args.size, noise=args.noise, time_limit=args.time, progress=progress
        )
    for path in outputs:
        for warning in result.save(path, exposure=args.exposure):
            print(f"warning: {warning}", file=sys.stderr)
    if args.stats:
        _write_stats(args.stats, result)
    if not args.quiet:
        _summarise(result, outputs)
    reached = result.stats["noise"]
    return _STOPPED if args.noise is not None and (reached is None or reached > args.noise) else 0


def _info(args: argparse.Namespace) -> int:
    from pyrt.info import scene_report

    print(scene_report(_load(args)))
    return 0


def _validate(args: argparse.Namespace) -> int:
    scene = _load(args)
    print(f"{args.scene}: valid, {len(scene.shapes)} objects")
    return 0


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
    from pyrt.doctor import doctor_report

    report, sound = doctor_report(args.device)
    print(report)
    return 0 if sound else DeviceError.exit_code


# --- helpers ----------------------------------------------------------------------------------------------------------


def _load(args: argparse.Namespace) -> Scene:
    from pyrt.scene_io import load_scene

    scene = load_scene(args.scene, overrides=dict(args.set or ()))
    for warning in scene.warnings:
        print(f"warning: {warning}", file=sys.stderr)
    return scene


def _check_outputs(paths: list[str], args: argparse.Namespace) -> None:
    from pyrt.image_io import check_output

    for path in paths:
        check_output(path, args.exposure)
        if args.no_clobber and os.path.exists(path):
            raise UsageError(f"{path}: exists already, and --no-clobber forbids to replace it")


def _write_stats(path: str, result: Result) -> None:
    text = json.dumps(result.stats, indent=2)
    if path == "-":
        print(text)
        return
    from pyrt.files import replacing

    try:
        with replacing(path) as temporary:
            temporary.write_text(text + "\n", encoding="utf-8")
    except OSError as error:
        raise PyrtError(f"{path}: cannot be written: {(error.strerror or str(error)).lower()}") from None


def _summarise(result: Result, outputs: list[str]) -> None:
    stats, seconds = result.stats, result.stats["seconds"]
    height, width = result.samples.shape
    dropped = stats["dropped"]
    for count, what in (
        (dropped["triangles"], "triangles without area or with bad coordinates"),
        (dropped["samples"], "samples that were not finite"),
    ):
        if count:
            print(f"warning: {count} {what} were left out", file=sys.stderr)
    rate = stats["samples"] / max(seconds["render"], 1e-9) / 1e6
    noise = "" if stats["noise"] is None else f", estimated error {stats['noise']:.2g}"
    print(
        f"{', '.join(outputs)}: {width}x{height}, {stats['samples'] / (width * height):.4g} spp{noise}, "
        f"{seconds['render']:.2f} s at {rate:.1f} M samples/s on {stats['device']}",
        file=sys.stderr,
    )


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.lower().partition("x")
    try:
        return int(width), int(height)
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected WIDTHxHEIGHT such as 640x480, got "{text}"') from None


def _seconds(text: str) -> float:
    number, unit = (text[:-1], text[-1]) if text[-1:] in ("s", "m", "h") else (text, "s")
    try:
        return float(number) * {"s": 1, "m": 60, "h": 3600}[unit]
    except ValueError:
        raise argparse.ArgumentTypeError(f'expected a time such as 90, 90s, 5m or 2h, got "{text}"') from None


def _setting(text: str) -> tuple[str, Any]:
    path, equals, value = text.partition("=")
    if not (equals and path):
        raise argparse.ArgumentTypeError(f'expected PATH=VALUE such as camera.fov=40, got "{text}"')
    try:
        return path, json.loads(value)
    except (ValueError, RecursionError):
        return path, value


def _parser() -> argparse.ArgumentParser:
    formatter = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(
        prog="pyrt",
        description="A ray tracer that Python drives and OpenCL runs.",
        epilog=_EXIT_CODES,
        formatter_class=formatter,
    )
    parser.add_argument("--version", action="version", version=f"pyrt {__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)

    on_scene = argparse.ArgumentParser(add_help=False)
    on_scene.add_argument("scene", metavar="SCENE", help="a scene file, or example:NAME")
    on_scene.add_argument(
        "--set", metavar="PATH=VALUE", type=_setting, action="append", help="replace a value of the scene"
    )

    render = verbs.add_parser(
        "render",
        parents=[on_scene],
        help="render a scene to a picture",
        epilog=_RENDER_EXAMPLES + _EXIT_CODES,
        formatter_class=formatter,
    )
    render.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        action="append",
        help="picture to write, format by extension; "
        "may be repeated (default: SCENE.exr and SCENE.png in the current folder)",
    )
    render.add_argument("--spp", type=int, metavar="N", help="samples per pixel (default: the scene's)")
    render.add_argument(
        "--noise", type=float, metavar="E", help="stop at this estimated relative error (r.m.s.), such as 0.01"
    )
    render.add_argument("--time", type=_seconds, metavar="T", help="stop after this time: 90, 90s, 5m or 2h")
    render.add_argument("--size", type=_size, metavar="WxH", help="picture size in pixels (default: the scene's)")
    render.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the sample points (default: 0)")
    render.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="brighten PNG and JPEG by 2^STOPS")
    render.add_argument(
        "--device", metavar="NAME", help="index or part of the name of an OpenCL device (see: pyrt devices)"
    )
    render.add_argument("--no-clobber", action="store_true", help="refuse to replace a file")
    render.add_argument("--stats", metavar="FILE", help="write times and counts as JSON; - for standard output")
    render.add_argument("--progress", choices=("auto", "bar", "json", "none"), default="auto")
    render.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors and warnings")
    render.set_defaults(run=_render)

    for name, run, text in (
        ("info", _info, "what a scene holds, and which features it compiles in"),
        ("validate", _validate, "check a scene and the files it names, all errors at once"),
    ):
        verbs.add_parser(name, parents=[on_scene], help=text).set_defaults(run=run)
    verbs.add_parser("devices", help="list the OpenCL devices").set_defaults(run=_devices)
    doctor = verbs.add_parser("doctor", help="check whether this machine's OpenCL can render, and how exact it is")
    doctor.add_argument("--device", metavar="NAME", help="index or part of the name of the device to probe")
    doctor.set_defaults(run=_doctor)
    return parser
