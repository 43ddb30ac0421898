"""`pyrt render`."""

from __future__ import annotations

import argparse
import json
import os
from typing import TYPE_CHECKING

from pyrt.cli_options import Verbs, add_scene, add_verb, load, say, seconds, size, warn
from pyrt.errors import PyrtError, UsageError

if TYPE_CHECKING:
    from pyrt.renderer import Result

_STOPPED = 5

_EXAMPLES = """\
  pyrt render scenes/cornell.json                        writes cornell.exr and cornell.png
  pyrt render example:showcase --spp 256 -o glass.png    a scene that comes with pyrt
  pyrt render scene.json --size 320x240 --set camera.fov=30
  pyrt render scene.json -o a.exr -o a.png --exposure 1  several files from one rendering
"""


def add_verbs(verbs: Verbs) -> None:
    """Declares `render`."""
    parser = add_verb(verbs, "render", "SCENE", _render, "render a scene to a picture", _EXAMPLES)
    add_scene(parser)
    _add_picture_options(parser)
    _add_sampling_options(parser)
    _add_running_options(parser)


def _add_picture_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("picture")
    group.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        action="append",
        help="picture to write, format by extension; may be repeated "
        "(default: SCENE.exr and SCENE.png in the current folder)",
    )
    group.add_argument("--size", type=size, metavar="WxH", help="picture size in pixels (default: the scene's)")
    group.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="brighten PNG and JPEG by 2^STOPS")
    group.add_argument("--no-clobber", action="store_true", help="refuse to replace a file")


def _add_sampling_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("samples")
    group.add_argument("--spp", type=int, metavar="N", help="samples per pixel (default: the scene's)")
    group.add_argument(
        "--noise", type=float, metavar="E", help="stop at this estimated relative error (r.m.s.), such as 0.01"
    )
    group.add_argument("--time", type=seconds, metavar="T", help="stop after this time: 90, 90s, 5m or 2h")
    group.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the sample points (default: 0)")


def _add_running_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("running")
    group.add_argument(
        "--device", metavar="NAME", help="index or part of the name of an OpenCL device (see: pyrt devices)"
    )
    group.add_argument("--stats", metavar="FILE", help="write times and counts as JSON; - for standard output")
    group.add_argument("--progress", choices=("auto", "bar", "json", "none"), default="auto")
    group.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors and warnings")


def _render(args: argparse.Namespace) -> int:
    from pyrt.progress import show_progress
    from pyrt.renderer import Renderer

    _check_outputs(args.output or [], args)
    with show_progress("none" if args.quiet else args.progress) as progress:
        progress({"stage": "load", "done": 0.0})
        scene = load(args)
        outputs = args.output or [f"{scene.name}.exr", f"{scene.name}.png"]
        _check_outputs(outputs, args)
        renderer = Renderer(scene, args.device, progress=progress)
        result = renderer.render(
            args.spp, args.seed, args.size, noise=args.noise, time_limit=args.time, progress=progress
        )
    for path in outputs:
        for text in result.save(path, exposure=args.exposure):
            warn(text)
    if args.stats:
        _write_stats(args.stats, result)
    if not args.quiet:
        _summarise(result, outputs)
    reached = result.stats["noise"]
    return _STOPPED if args.noise is not None and (reached is None or reached > args.noise) else 0


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
    stats, elapsed = result.stats, result.stats["seconds"]["render"]
    height, width = result.samples.shape
    dropped = stats["dropped"]
    for count, what in (
        (dropped["triangles"], "triangles without area or with bad coordinates"),
        (dropped["samples"], "samples that were not finite"),
    ):
        if count:
            warn(f"{count} {what} were left out")
    rate = stats["samples"] / max(elapsed, 1e-9) / 1e6
    noise = "" if stats["noise"] is None else f", estimated error {stats['noise']:.2g}"
    say(
        f"{', '.join(outputs)}: {width}x{height}, {stats['samples'] / (width * height):.4g} spp{noise}, "
        f"{elapsed:.2f} s at {rate:.1f} M samples/s on {stats['device']}"
    )
