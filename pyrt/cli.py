"""The command line: `python -m pyrt VERB …`, or `pyrt VERB …`. Heavy imports wait until a verb needs them.

Each verb lives in one of the `cli_*` modules: its options, its examples, and the function that runs it.
"""

from __future__ import annotations

import argparse
import io
import sys
from collections.abc import Sequence

from pyrt import __version__, cli_device, cli_render, cli_scene
from pyrt.cli_options import EXIT_CODES
from pyrt.errors import PyrtError, SceneError

_VERBS = (cli_render, cli_scene, cli_device)  # in the order of --help


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


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="pyrt",
        description="A ray tracer that Python drives and OpenCL runs.",
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"pyrt {__version__}")
    verbs = parser.add_subparsers(metavar="VERB", required=True)
    for module in _VERBS:
        module.add_verbs(verbs)
    return parser
