"""`pyrt render`."""

from __future__ import annotations

import argparse
import os
from typing import TYPE_CHECKING, Any

from pyrt.cli_options import (
    Verbs,
    add_display,
    add_scene,
    add_verb,
    check_outputs,
    crop,
    load,
    number,
    sample_range,
    say,
    seconds,
    size,
    warn,
    whole,
)
from pyrt.cli_report import plan, summarise, warn_if_black, write_stats
from pyrt.errors import UsageError
from pyrt.signals import stop_requests

if TYPE_CHECKING:
    from pyrt.renderer import Renderer
    from pyrt.result import Result
    from pyrt.scene import Scene
    from pyrt.watch import Progress

_STOPPED = 5
_INTERRUPTED = 130
_EVERY = 60

_EXAMPLES = """\
  pyrt render scenes/cornell.json                        writes cornell.exr and cornell.png
  pyrt render example:showcase --spp 256 -o glass.png    a scene that comes with pyrt
  pyrt render scene.json --size 320x240 --set camera.fov=30
  pyrt render scene.json -o a.exr -o a.png --exposure 1  several files from one rendering
  pyrt render scene.json --aov z,normal,object --crop 0,0,320,240
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
    group.add_argument(
        "--crop", type=crop, metavar="X0,Y0,X1,Y1", help="render only the pixels X0 ... X1-1, Y0 ... Y1-1"
    )
    group.add_argument(
        "--aov",
        type=lambda text: text.split(","),
        default=(),
        metavar="NAME,...",
        help="channels beside the picture in EXR files: z, distance, position, normal, uv, object, triangle, material, "
        "albedo, denoising_albedo, denoising_normal, variance, samples",
    )
    group.add_argument(
        "--denoise", action="store_true", help="remove the noise (needs the package pyoidn); EXR files hold both"
    )
    add_display(group)
    group.add_argument("--float", action="store_true", help="32 bits for the colours of EXR files, not 16")
    group.add_argument("--no-clobber", action="store_true", help="refuse to replace a file")
    group.add_argument("--dry-run", action="store_true", help="check everything and say what would be done, no more")


def _add_sampling_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("samples", "The first limit reached, of --spp, --noise and --time, ends it.")
    group.add_argument(
        "--spp", type=whole, metavar="N", help="samples per pixel (default: the scene's; none with --noise or --time)"
    )
    group.add_argument(
        "--noise", type=number, metavar="E", help="stop at this estimated relative error (r.m.s.), such as 0.01"
    )
    group.add_argument(
        "--time",
        type=seconds,
        metavar="T",
        help="stop after rendering this long: 90, 90s, 5m or 2h. Loading and compiling come before, writing after",
    )
    group.add_argument(
        "--samples",
        type=sample_range,
        metavar="A:B",
        help="render only the samples A ... B-1 of each pixel, for pyrt merge",
    )
    group.add_argument("--seed", type=whole, default=0, metavar="N", help="seed of the sample points (default: 0)")


def _add_running_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("running")
    group.add_argument(
        "--device", metavar="NAME", help="index or part of the name of an OpenCL device (see: pyrt devices)"
    )
    group.add_argument(
        "--checkpoint",
        type=seconds,
        metavar="T",
        help="save the picture so far, in the first .exr: every T, such as 60s or 5m, and on Ctrl-C "
        f"(default: {_EVERY}s with --resume, else never)",
    )
    group.add_argument(
        "--resume", action="store_true", help="go on from the first .exr, if it is there; the bits will be the same"
    )
    group.add_argument("--threads", type=whole, metavar="N", help="so many of the processor's cores (default: all)")
    group.add_argument("--stats", metavar="FILE", help="write times and counts as JSON; - for standard output")
    group.add_argument(
        "--progress",
        choices=("auto", "bar", "json", "none"),
        default="auto",
        help="on stderr: a bar (auto: only on a terminal), or JSON, one object a line: stage (load, build, compile, "
        "render, save, done), done (0 to 1) and seconds; of render also samples, rays, rays_per_second, noise, eta",
    )
    words = group.add_mutually_exclusive_group()
    words.add_argument("-q", "--quiet", action="store_true", help="print nothing but errors and warnings")
    words.add_argument("-v", "--verbose", action="store_true", help="print what each stage took, and what was traced")


def _render(args: argparse.Namespace) -> int:
    _check_outputs(args.output or [], args)
    if args.dry_run:
        scene, outputs = _loaded(args)
        print(plan(args, scene, outputs, _checkpoint(args, outputs)))
        return 0
    if args.threads is not None:
        from pyrt.toolchain import limit_threads

        limit_threads(args.threads)
    from pyrt.doctor import open_device
    from pyrt.progress import show_progress
    from pyrt.renderer import Renderer

    mode = "none" if args.quiet and args.progress == "auto" else args.progress
    with show_progress(mode, stages=args.verbose) as progress:
        scene, outputs = _loaded(args)
        checkpoint = _checkpoint(args, outputs)
        device = open_device(args.device)
        if args.threads is not None:
            device.check_threads(args.threads)
        renderer = Renderer(scene, device, progress=progress)
        progress({"stage": "render", "done": 0.0, "samples": 0, "rays": 0, "noise": None})
        result, interrupted = _result(args, renderer, checkpoint, progress)
        if interrupted and not result.samples.any():
            say("pyrt: interrupted before the first samples")
            return _INTERRUPTED
        progress({"stage": "save", "done": 0.0})
        written = checkpoint if not interrupted and _is_saved(args, result) else None
        for path in (path for path in outputs if path != written):
            for text in result.save(path, exposure=args.exposure, view=args.view, half=not args.float):
                warn(text)
    warn_if_black(result)
    if args.stats:
        write_stats(args.stats, result)
    if interrupted:
        say(f"pyrt: interrupted with {result.samples.mean():.4g} samples per pixel; --resume continues")
        return _INTERRUPTED
    if not args.quiet:
        summarise(result, outputs, args.verbose)
    reached = result.stats["noise"]
    return _STOPPED if args.noise is not None and (reached is None or reached > args.noise) else 0


def _loaded(args: argparse.Namespace) -> tuple[Scene, list[str]]:
    """The scene, and the files to write, after all checks that need no device."""
    _check_channels(args)
    scene = load(args)
    outputs = args.output or [f"{scene.name}.exr", f"{scene.name}.png"]
    _check_outputs(outputs, args)
    return scene, outputs


def _result(
    args: argparse.Namespace, renderer: Renderer, checkpoint: str | None, progress: Progress
) -> tuple[Result, bool]:
    """Renders. With a checkpoint, Ctrl-C and SIGTERM end that with what there is so far; and whether they did."""
    limits = {"spp": args.spp, "noise": args.noise, "time_limit": args.time, "samples": args.samples}
    channels = {"crop": args.crop, "aovs": args.aov, "denoise": args.denoise}
    if checkpoint is None:
        return renderer.render(seed=args.seed, size=args.size, progress=progress, **limits, **channels), False
    with stop_requests() as stopped:

        def report(event: dict[str, Any]) -> bool:
            progress(event)
            return not stopped()

        result = renderer.render(
            seed=args.seed,
            size=args.size,
            checkpoint=checkpoint,
            checkpoint_every=_EVERY if args.checkpoint is None else args.checkpoint,
            resume=args.resume,
            progress=report,
            **limits,
            **channels,
        )
        partial = result.partial
        return result, stopped() and partial is not None and partial.traced() < partial.total()


def _checkpoint(args: argparse.Namespace, outputs: list[str]) -> str | None:
    """The output to save to while rendering, if any."""
    keep = args.resume or args.checkpoint is not None
    found = next((path for path in outputs if path.lower().endswith(".exr")), None)
    if found is None and (keep or args.samples):
        raise UsageError("--checkpoint, --resume, --samples: expected an output ending in .exr, which can be continued")
    return found if keep else None


def _is_saved(args: argparse.Namespace, result: Result) -> bool:
    """Whether the checkpoint, which was saved when the render ended, is what would be written: to write the sums of all
    pixels again takes as long as some of their samples."""
    from pyrt.image_file import MAX_HALF

    other = args.float or args.denoise or args.aov or not result.stats["samples"]
    return not other and bool(abs(result.image).max() <= MAX_HALF)  # brighter ones are clamped with a warning


def _check_outputs(paths: list[str], args: argparse.Namespace) -> None:
    from pyrt.files import check_target

    if args.stats and args.stats != "-":
        check_target(args.stats)
    check_outputs(paths, args)
    for path in paths:
        if args.no_clobber and os.path.exists(path):
            raise UsageError(f"{path}: exists already, and --no-clobber forbids to replace it")


def _check_channels(args: argparse.Namespace) -> None:
    from pyrt.aov import check_aovs
    from pyrt.denoise import require_denoiser

    check_aovs(args.aov)
    if (args.aov or args.float) and args.output and not any(path.lower().endswith(".exr") for path in args.output):
        raise UsageError("--aov, --float: expected an output ending in .exr, which has room for more")
    if args.denoise:
        require_denoiser()
