"""The command line: `python -m bench [error|rays|build|start|growth|cost|numerics]`."""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from bench import bias, build, cost, error, growth, numerics, peers_embree, peers_mitsuba, rays, report, start
from bench.generated import GENERATORS, generated
from bench.report import Outcome
from bench.scenes import ERROR_SCENES
from pyrt.device import choose_device
from pyrt.errors import PyrtError

PARTS = ("error", "rays", "build", "start", "growth", "cost", "numerics")


def main(argv: Sequence[str] | None = None) -> int:
    """Runs parts of the benchmark, prints their tables and writes JSON and plots; returns the exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    args = _parser().parse_args(arguments)
    try:
        old = json.loads(Path(args.against).read_text(encoding="utf-8")) if args.against else None
        about = report.provenance(arguments, str(choose_device(args.device)), _peers())
    except OSError as problem:
        print(f"{args.against}: cannot be read: {(problem.strerror or str(problem)).lower()}", file=sys.stderr)
        return 1
    except (PyrtError, ValueError) as problem:
        print(f"bench: {problem}", file=sys.stderr)
        return 1
    out: Path = args.out
    out.mkdir(parents=True, exist_ok=True)
    outcomes: dict[str, Outcome] = {}
    for part in [args.part] if args.part else PARTS:
        outcomes[part] = _jobs(args, out)[part]()
        for table in outcomes[part].tables:
            print(report.markdown(table, about), flush=True)
        report.write_json(out / f"{args.part or 'all'}.json", about, outcomes)
    if old:
        print(report.markdown(report.comparison(old, outcomes), about))
    return 0


def _jobs(args: argparse.Namespace, out: Path) -> dict[str, Callable[[], Outcome]]:
    """The parts, with the options that each understands."""
    settings = error.QUICK if args.quick else error.Settings()
    given = {
        "size": args.size,
        "repeats": args.repeats,
        "reference_spp": args.reference_spp,
        "device": args.device,
        "scenes": tuple(args.scene) if args.scene else None,
    }
    settings = replace(settings, **{name: value for name, value in given.items() if value is not None})
    repeats = args.repeats or (3 if args.quick else 7)
    names = tuple(name.replace(" ", "_") for name in args.scene or ())
    return {
        "error": lambda: error.run(settings, out),
        "rays": lambda: rays.run(args.quick, repeats, args.mesh),
        "build": lambda: build.run(args.quick, repeats, args.mesh),
        "start": lambda: start.run(args.quick, repeats),
        "growth": lambda: growth.run(args.quick, min(repeats, 3), out),
        "cost": lambda: cost.run(args.quick, repeats),
        "numerics": lambda: bias.run(args.quick, out, names) if args.bias else numerics.run(args.quick),
    }


def _peers() -> str:
    """The peers with their versions; says how to get those that are missing."""
    found = {"Mitsuba": peers_mitsuba.version(), "embreex": peers_embree.version()}
    missing = [name for name, version in found.items() if not version]
    if missing:
        print(f"without {' and '.join(missing)}; to have all peers: pip install -e '.[bench]'", file=sys.stderr)
    return ", ".join(version or f"no {name}" for name, version in found.items())


def _scene_name(text: str) -> str:
    try:
        if text not in ERROR_SCENES:
            generated(text)
    except ValueError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from problem
    return text


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m bench", description="Where pyrt stands, peers beside it.")
    parser.add_argument("part", nargs="?", choices=PARTS, help="one part (default: all)")
    parser.add_argument("--quick", action="store_true", help="small settings: all parts within two minutes")
    parser.add_argument("--against", metavar="OLD.json", help="compare with an earlier run")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "out", metavar="DIR")
    parser.add_argument("--repeats", type=int, metavar="N", help="repetitions of each measurement")
    parser.add_argument("--device", metavar="NAME", help="error: OpenCL device")
    parser.add_argument(
        "--scene",
        action="append",
        type=_scene_name,
        metavar="NAME",
        help="error, numerics --bias: only this one; may be repeated "
        f"({', '.join(ERROR_SCENES)}; with a seed: {', '.join(GENERATORS)})",
    )
    parser.add_argument("--size", type=int, metavar="N", help="error: pictures of N×N pixels")
    parser.add_argument("--reference-spp", type=int, metavar="N", help="error: samples of the reference")
    parser.add_argument(
        "--mesh",
        action="append",
        type=Path,
        default=[],
        metavar="FILE",
        help="rays, build: this mesh, too; may be repeated",
    )
    parser.add_argument("--bias", action="store_true", help="numerics: the bias floor of every scene instead")
    return parser


if __name__ == "__main__":
    sys.exit(main())
