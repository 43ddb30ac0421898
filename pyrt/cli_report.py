"""What `pyrt render` tells about a render: what it would do, what it did, and how long that took."""

from __future__ import annotations

import argparse
import json
import os
from dataclasses import replace
from typing import TYPE_CHECKING

from pyrt.cli_options import say, warn
from pyrt.errors import PyrtError

if TYPE_CHECKING:
    from pyrt.result import Result
    from pyrt.scene import Scene


def plan(args: argparse.Namespace, scene: Scene, outputs: list[str], checkpoint: str | None) -> str:
    """The text of --dry-run. Raises UsageError for what the render itself would refuse."""
    from pyrt.info import scene_report
    from pyrt.picture import required_bytes
    from pyrt.request import request_for
    from pyrt.scene import Film

    asked = {"noise": args.noise, "time_limit": args.time, "samples": args.samples, "crop": args.crop, "aovs": args.aov}
    request = request_for(scene, args.spp, args.seed, args.size, denoise=args.denoise, checkpoint=checkpoint, **asked)
    limits = [] if args.noise is None else [f"an error of {args.noise:g}"]
    limits += [] if args.time is None else [f"{args.time:g} s"]
    window, spp = request.window, request.spp
    width, height = window.width, window.height
    replaced = [path for path in outputs if os.path.exists(path)]
    lines = [
        scene_report(replace(scene, film=Film(width, height), spp=spp), required_bytes(scene, request)),
        f"stop at    {', or '.join([*limits, f'{spp} samples per pixel'])}",
        f"pixels     {window.x1 - window.x0}x{window.y1 - window.y0}, seed {args.seed}",
        f"write      {', '.join(outputs)}" + f", replacing {', '.join(replaced)}" * bool(replaced),
    ]
    return "\n".join(lines)


def write_stats(path: str, result: Result) -> None:
    """Writes times and counts as JSON; - is standard output. Raises PyrtError if that fails."""
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


def warn_if_black(result: Result) -> None:
    """Says why, as far as the rays tell, if there is nothing to be seen."""
    rays = result.stats["rays"]
    if result.image.any() or not rays["camera"]:
        return
    if rays["shadow"]:
        reason = "what the camera sees lies in shadow"
    elif result.stats["skipped"]["shadow_rays_to_dark_lights"]:
        reason = "no light shines on the sides of the surfaces that the camera sees"
    elif rays["specular"]:
        reason = "the camera sees glass and nothing else"
    else:
        reason = "the camera sees no surface that reflects light; check camera.position and camera.look_at"
    warn(f"the picture is black: {reason}")


def summarise(result: Result, outputs: list[str], verbose: bool) -> None:
    """Says in a line what was rendered; with `verbose` also what was traced."""
    stats, elapsed = result.stats, result.stats["seconds"]["render"]
    height, width = result.samples.shape
    dropped = stats["dropped"]
    for count, what in (
        (dropped["triangles"], "triangles without area or with bad coordinates"),
        (dropped["samples"], "samples that were not finite"),
    ):
        if count:
            warn(f"{count} {what} were left out")
    if verbose:
        for name in ("rays", "skipped"):
            say(f"{name:<8} " + ", ".join(f"{count:,} {what.replace('_', ' ')}" for what, count in stats[name].items()))
        say(f"features {', '.join(macro for macro, on in stats['features'].items() if on) or 'none'}")
    rate = stats["samples"] / max(elapsed, 1e-9) / 1e6
    noise = "" if stats["noise"] is None else f", estimated error {stats['noise']:.2g}"
    say(
        f"{', '.join(outputs)}: {width}x{height}, {result.samples.mean():.4g} spp{noise}, "
        f"{elapsed:.2f} s at {rate:.1f} M samples/s on {stats['device']}"
    )
