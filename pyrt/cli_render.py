"""`pyrt render`."""

from __future__ import annotations

import argparse
import json
import os
from typing import TYPE_CHECKING, Any

from pyrt.cli_options import Verbs, add_scene, add_verb, load, sample_range, say, seconds, size, warn
from pyrt.errors import PyrtError, UsageError
from pyrt.signals import stop_requests

if TYPE_CHECKING:
    from pyrt.renderer import Progress, Renderer
    from pyrt.result import Result

_STOPPED = 5
_INTERRUPTED = 130
_EVERY = 60

_EXAMPLES = """\
  pyrt render scenes/cornell.json                        writes cornell.exr and cornell.png
  pyrt render example:showcase --spp 256 -o glass.png    a scene that comes with pyrt
  pyrt render scene.json --size 320x240 --set camera.fov=30
  pyrt render scene.json -o a.exr -o a.png --exposure 1  several files from one rendering
  pyrt render scene.json --spp 9999 --checkpoint 60s     Ctrl-C saves what is done ...
  pyrt render scene.json --spp 9999 --resume             ... and this goes on from there
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
    group.add_argument(
        "--samples",
        type=sample_range,
        metavar="A:B",
        help="render only the samples A ... B-1 of each pixel, for pyrt merge",
    )
    group.add_argument("--seed", type=int, default=0, metavar="N", help="seed of the sample points (default: 0)")


def _add_running_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("running")
    group.add_argument(
        "--device", metavar="NAME", help="index or part of the name of an OpenCL device (see: pyrt devices)"
    )
    group.add_argument(
        "--checkpoint",
        type=seconds,
        metavar="T",
        help=f"save the picture so far every T, such as 60s or 5m, and on Ctrl-C, in the first .exr (default: {_EVERY} s "
        "with --resume, else never)",
    )
    group.add_argument(
        "--resume", action="store_true", help="go on from the first .exr, if it is there; the bits will be the same"
    )
    group.add_argument("--stats", metavar="FILE", help="write times and counts as JSON; - for standard output")
    group.add_argument("--progress", choices=("auto", "bar", "json", "none"), default="auto")
    group.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors and warnings")


def _render(args: argparse.Namespace) -> int:
    from pyrt.doctor import start_opening

    _check_outputs(args.output or [], args)
    device = start_opening(args.device)  # while the imports and the scene come
    from pyrt.progress import show_progress
    from pyrt.renderer import Renderer

    with show_progress("none" if args.quiet else args.progress) as progress:
        progress({"stage": "load", "done": 0.0})
        scene = load(args)
        outputs = args.output or [f"{scene.name}.exr", f"{scene.name}.png"]
        _check_outputs(outputs, args)
        checkpoint = _checkpoint(args, outputs)
        renderer = Renderer(scene, device.result(), progress=progress)
        result = _result(args, renderer, checkpoint, progress)
    if interrupted := _interrupted(result):
        say(f"pyrt: {interrupted}")
        if not result.samples.any():
            return _INTERRUPTED
    for path in outputs:
        for text in result.save(path, exposure=args.exposure):
            warn(text)
    if args.stats:
        _write_stats(args.stats, result)
    if interrupted:
        return _INTERRUPTED
    if not args.quiet:
        _summarise(result, outputs)
    reached = result.stats["noise"]
    return _STOPPED if args.noise is not None and (reached is None or reached > args.noise) else 0


def _result(args: argparse.Namespace, renderer: Renderer, checkpoint: str | None, progress: Progress) -> Result:
    """Renders. With a checkpoint, Ctrl-C and SIGTERM end that with what there is so far."""
    limits = {"spp": args.spp, "noise": args.noise, "time_limit": args.time, "samples": args.samples}
    if checkpoint is None:
        return renderer.render(seed=args.seed, size=args.size, progress=progress, **limits)
    with stop_requests() as stopped:

        def report(event: dict[str, Any]) -> bool:
            progress(event)
            return not stopped()

        return renderer.render(
            seed=args.seed,
            size=args.size,
            checkpoint=checkpoint,
            checkpoint_every=_EVERY if args.checkpoint is None else args.checkpoint,
            resume=args.resume,
            progress=report,
            **limits,
        )


def _checkpoint(args: argparse.Namespace, outputs: list[str]) -> str | None:
    """The output to save to while rendering, if any."""
    keep = args.resume or args.checkpoint is not None
    found = next((path for path in outputs if path.lower().endswith(".exr")), None)
    if found is None and (keep or args.samples):
        raise UsageError("--checkpoint, --resume, --samples: expected an output ending in .exr, which can be continued")
    return found if keep else None


def _interrupted(result: Result) -> str:
    """What became of a render that a signal stopped, or "" if none did."""
    partial = result.partial
    if partial is None or partial.end == partial.spp:
        return ""
    if not result.samples.any():
        return "interrupted before the first samples"
    return f"interrupted with {partial.end} of {partial.spp} samples per pixel; --resume continues"


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
