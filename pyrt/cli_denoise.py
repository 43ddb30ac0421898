"""`pyrt denoise`."""

from __future__ import annotations

import argparse

from pyrt.cli_options import Verbs, add_display, add_verb, check_outputs, warn

_EXAMPLES = """\
  pyrt render scene.json --denoise                               the same while rendering: scene.exr and scene.png
  pyrt render scene.json --aov denoising_albedo,denoising_normal
  pyrt denoise scene.exr -o clean.exr                            keeps what it holds, adds denoised.R, .G and .B
  pyrt denoise scene.exr -o clean.png --exposure 1
"""


def add_verbs(verbs: Verbs) -> None:
    """Declares `denoise`."""
    text = "remove the noise of a rendered picture (needs the package pyoidn)"
    parser = add_verb(verbs, "denoise", "IN", _denoise, text, _EXAMPLES)
    parser.add_argument("input", metavar="IN", help="an EXR file, best with denoising_albedo and denoising_normal")
    parser.add_argument("-o", "--output", metavar="OUT", required=True, help="picture to write, format by extension")
    add_display(parser)


def _denoise(args: argparse.Namespace) -> int:
    from pyrt.denoise import denoised, require_denoiser, stored_guides
    from pyrt.exr_state import stored_state
    from pyrt.image_file import read_exr
    from pyrt.image_io import write_image

    require_denoiser()
    check_outputs([args.output], args)
    layers = read_exr(args.input)
    guides = stored_guides(layers.planes)
    if guides is None:
        warn(
            f"{args.input}: it has no channels denoising_albedo and denoising_normal, which keep details; "
            "pyrt render --aov denoising_albedo,denoising_normal writes them"
        )
    clean = denoised(layers.pixels, *(guides or ()))
    exr = args.output.lower().endswith(".exr")
    planes = layers.planes | {f"denoised.{c}": clean[..., i] for i, c in enumerate("RGB")}
    for text in write_image(
        args.output,
        layers.pixels if exr else clean,
        exposure=args.exposure,
        view=args.view,
        metadata=layers.metadata,
        planes=planes,
        half=layers.half,
        window=layers.window,
        state=stored_state(args.input) if exr else None,
    ):
        warn(text)
    return 0
