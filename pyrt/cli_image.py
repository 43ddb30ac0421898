"""The verbs about pictures: `view` and `diff`."""

from __future__ import annotations

import argparse
import json
from contextlib import suppress

from pyrt.cli_options import Verbs, add_scene, add_verb, load, nearest, number, say, warn, whole
from pyrt.cli_report import warn_if_black
from pyrt.errors import UsageError

_VIEW_SPP = 16

_VIEW_EXAMPLES = """\
  pyrt view cornell.exr --exposure 2            a picture in the terminal, also over ssh
  pyrt view example:cornell --exposure 2        renders a scene as small as the terminal is
  pyrt view scene.json --set camera.fov=30
  NO_COLOR=1 pyrt view cornell.png              with characters instead of colours
"""
_DIFF_EXAMPLES = """\
  pyrt diff out.exr reference.exr               RMSE, relMSE, mean and greatest difference, FLIP
  pyrt diff out.png reference.png --json        the same for a program
  pyrt diff out.exr reference.exr -o error.png --exposure 3
  pyrt diff out.exr reference.exr --fail-above flip=0.02 || echo "it looks different"
"""


def add_verbs(verbs: Verbs) -> None:
    """Declares `view` and `diff`."""
    _add_view(verbs)
    _add_diff(verbs)


def _add_view(verbs: Verbs) -> None:
    text = "show a picture, or a quick rendering of a scene, in the terminal"
    parser = add_verb(verbs, "view", "FILE|SCENE", _view, text, _VIEW_EXAMPLES)
    add_scene(parser, "FILE|SCENE", "a picture, a scene file, or example:NAME")
    parser.add_argument("--exposure", type=number, default=0.0, metavar="STOPS", help="brighten by 2^STOPS")
    parser.add_argument("--spp", type=whole, metavar="N", help=f"samples per pixel of a scene (default: {_VIEW_SPP})")
    parser.add_argument("--device", metavar="NAME", help="OpenCL device for a scene (see: pyrt devices)")


def _add_diff(verbs: Verbs) -> None:
    parser = add_verb(verbs, "diff", "A B", _diff, "how far a picture A is from a reference B", _DIFF_EXAMPLES)
    for name, text in (
        ("a", "a picture in any format that OpenImageIO reads"),
        ("b", "the reference, of the same size"),
    ):
        parser.add_argument(name, metavar=name.upper(), help=f"{text}; R, G and B are compared, as linear light")
    parser.add_argument("-o", "--output", metavar="FILE", help="write |A - B| as a picture, format by extension")
    parser.add_argument("--exposure", type=number, default=0.0, metavar="STOPS", help="brighten that PNG by 2^STOPS")
    parser.add_argument(
        "--fail-above",
        metavar="MEASURE=VALUE",
        type=_limit,
        action="append",
        help="exit with 1 if a measure (rmse, relmse, mean without its sign, max, flip) is above the value, or if "
        "pixels are not finite; may be repeated",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def _view(args: argparse.Namespace) -> int:
    from pyrt.image_io import check_exposure, is_picture, read_picture
    from pyrt.terminal import fitted, show

    check_exposure(args.exposure)
    if is_picture(args.scene):
        for option in ("set", "spp", "device"):
            if getattr(args, option) is not None:
                raise UsageError(f"--{option}: expected a scene to render, got the picture {args.scene}")
        image = read_picture(args.scene).pixels
    else:
        from pyrt.progress import show_progress
        from pyrt.renderer import Renderer

        with show_progress("auto") as progress:
            scene = load(args)
            size = fitted(scene.film.width, scene.film.height)
            spp = _VIEW_SPP if args.spp is None else args.spp
            result = Renderer(scene, args.device, progress=progress).render(spp, size=size)
        warn_if_black(result)
        image = result.image
    show(image, args.exposure)
    return 0


def _diff(args: argparse.Namespace) -> int:
    from pyrt.compare import MEASURES, difference
    from pyrt.image_io import check_output, read_picture, write_image

    for name, _ in args.fail_above or ():
        if name not in MEASURES:
            raise UsageError(f'--fail-above: no measure "{name}"{nearest(name, MEASURES)}')
    if args.output:
        check_output(args.output, args.exposure)
    a, b = read_picture(args.a), read_picture(args.b)
    found = difference(a.pixels, b.pixels, display=a.display and b.display)
    if args.json:
        print(json.dumps({**found.measures, "worst": found.worst, "not_finite": found.not_finite}))
    else:
        for name, text in MEASURES.items():
            place = f", at column {found.worst[0]}, row {found.worst[1]}" * (name == "max")
            print(f"{name:<7} {found.measures[name]:<12.6g} {text}{place}")
    if args.output:
        for text in write_image(args.output, found.image, exposure=args.exposure):
            warn(text)
    if found.not_finite:
        warn(f"{found.not_finite} pixels are not finite, and left out")
    above = [(name, limit) for name, limit in args.fail_above or () if abs(found.measures[name]) > limit]
    for name, limit in above:
        say(f"pyrt: {name} is {found.measures[name]:.6g}, expected at most {limit:g}")
    return int(bool(above or (args.fail_above and found.not_finite)))


def _limit(text: str) -> tuple[str, float]:
    """rmse=0.01 → ("rmse", 0.01)."""
    name, _, value = text.partition("=")
    with suppress(ValueError):
        if float(value) >= 0:
            return name, float(value)
    raise argparse.ArgumentTypeError(f'expected MEASURE=VALUE such as flip=0.02 or rmse=1e-3, got "{text}"')
