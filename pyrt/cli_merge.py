"""`pyrt merge`."""

from __future__ import annotations

import argparse

from pyrt.cli_options import Verbs, add_display, add_verb, check_outputs, say, warn

_EXAMPLES = """\
  pyrt render scene.json --samples 0:512 -o a.exr        on one machine ...
  pyrt render scene.json --samples 512:1024 -o b.exr     ... and on another
  pyrt merge a.exr b.exr -o picture.exr -o picture.png   the same bits as --spp 1024 gives
"""


def add_verbs(verbs: Verbs) -> None:
    """Declares `merge`."""
    text = "add up renders of separate samples of one picture, exactly"
    parser = add_verb(verbs, "merge", "A B ... -o C", _merge, text, _EXAMPLES)
    parser.add_argument("parts", metavar="FILE", nargs="+", help="EXR that render wrote with --samples or --checkpoint")
    parser.add_argument(
        "-o",
        "--output",
        metavar="FILE",
        action="append",
        required=True,
        help="picture to write, format by extension; may be repeated; an .exr can be merged and continued in turn",
    )
    add_display(parser)


def _merge(args: argparse.Namespace) -> int:
    from pyrt.farm import merge

    check_outputs(args.output, args)
    result = merge(args.parts)
    if left_out := result.stats["left_out"]:
        warn(f"{', '.join(left_out)}: left out, as they are of single parts; pyrt denoise makes them of the whole")
    for path in args.output:
        for text in result.save(path, exposure=args.exposure, view=args.view):
            warn(text)
    say(f"{', '.join(args.output)}: {result.samples.max()} samples per pixel")
    return 0
