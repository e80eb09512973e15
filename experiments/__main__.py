"""The command line of the experiments: ``python -m experiments ...``."""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import NoReturn

import tools

tools.begin(__name__)

from netlib.errors import did_you_mean
from tools.common.commands import summary_of
from tools.common.console import DONE, guarded

PROGRAM = "python -m experiments"
USAGE = 2
NAMES = (
    "table1",
    "bench",
    "parts",
    "fit",
    "tracking",
    "constants",
    "finder",
    "scenes",
    "package_model",
    "confidence",
)


class Parser(argparse.ArgumentParser):
    """A parser with one-line error messages."""

    def error(self, message: str) -> NoReturn:
        """Print the message and exit."""
        self.exit(USAGE, f"{self.prog}: error: {message}\n")


def main(argv: list[str] | None = None) -> int:
    """List the experiments, or run one; returns the exit status."""
    words = sys.argv[1:] if argv is None else argv
    if not words or words[0] in ("-h", "--help"):
        print(listing())
        return DONE
    name, *rest = words
    if name not in NAMES:
        Parser(PROGRAM).error(
            f"unknown experiment {name!r}{did_you_mean(name, NAMES)}; expected {', '.join(NAMES)}"
        )
    experiment = importlib.import_module(f"experiments.{name}")
    parser = Parser(
        f"{PROGRAM} {name}",
        description=experiment.__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    experiment.add_arguments(parser)
    return guarded(experiment.run, parser.parse_args(rest))


def listing() -> str:
    """The experiments, each with the first sentence of its docstring."""
    width = max(map(len, NAMES))
    folder = Path(__file__).parent
    lines = [f"  {name:{width}}  {summary_of(folder / f'{name}.py')}" for name in NAMES]
    return "\n".join(
        [f"usage: {PROGRAM} NAME ...", "", f"'{PROGRAM} NAME --help' describes one.", "", *lines]
    )


if __name__ == "__main__":
    sys.exit(main())
