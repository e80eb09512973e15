#!/usr/bin/env python3
"""Draw the loss and test curves of training logs, this project's or Caffe's.

    python tools/plot_log.py snapshots/train.log --out snapshots/train.png

Several logs share one picture. The log of a training that was continued with --snapshot may follow the first log.
"""

from __future__ import annotations

import argparse
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib import files
from netlib.errors import DataError
from tools import outputs, pictures
from tools.arguments import parser_of
from tools.console import DONE, guarded, say

_NUMBER = r"([-+]?(?:\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|nan|inf))"
_ITERATION = re.compile(r"Iteration (\d{1,18})(?!\d)")
_LOSS = re.compile(rf"Iteration (\d{{1,18}})(?: \([^()]*\))?, loss = {_NUMBER}")
_OUTPUT = re.compile(rf"(Train|Test) net output #\d+: (\S+) = {_NUMBER}")

Curve = list[tuple[int, float]]


@dataclass
class Log:
    """The curves of one log: (iteration, value) pairs."""

    loss: Curve = field(default_factory=list)
    train: dict[str, Curve] = field(default_factory=dict)
    test: dict[str, Curve] = field(default_factory=dict)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("logs", metavar="LOG", nargs="+", help="what tools/train.py --log wrote, or Caffe's stderr")
    parser.add_argument("--out", metavar="FILE", default="log.png",
                        help="the picture; the ending of its name says the format (default: %(default)s)")  # fmt: skip
    args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Draw as the parsed arguments say."""
    outputs.refuse_inputs(args.out, args.logs)
    logs = {path: read_log(path) for path in args.logs}
    plot(logs, args.out)
    say(f"wrote {args.out}")
    return DONE


def read_log(path: str | Path) -> Log:
    """Parse a log. Raises DataError if it cannot be read or has no iteration in it."""
    text = files.read_text(path, "the log", errors="replace")
    log, iteration = Log(), 0
    for line in text.splitlines():
        if found := _LOSS.search(line):
            log.loss.append((int(found[1]), float(found[2])))
        if found := _ITERATION.search(line):
            iteration = int(found[1])
        if found := _OUTPUT.search(line):
            curves = log.train if found[1] == "Train" else log.test
            curves.setdefault(found[2], []).append((iteration, float(found[3])))
    if not log.loss and not log.test:
        raise DataError(f"{path}: no line like 'Iteration 20 (...), loss = 0.5' in it; expected a training log")
    return log


def plot(logs: dict[str, Log], out: str | Path) -> None:
    """One panel for the loss, and one per test output. Raises NetlibError if the picture cannot be written."""
    names = sorted({name for log in logs.values() for name in log.test})
    figure = pictures.new_figure(5.2 * (1 + len(names)), 4)
    axes = figure.subplots(1, 1 + len(names), squeeze=False)
    stems = [Path(path).stem for path in logs]
    for path, log in logs.items():
        stem, folder = Path(path).stem, Path(path).parent.name
        label = f"{folder}/{stem}" if stems.count(stem) > 1 and folder else stem
        _curve(axes[0, 0], log.loss, f"{label}: train")
        for axis, name in zip(axes[0, 1:], names):
            _curve(axis, log.test.get(name, []), label, marker="o")
    for axis, title in zip(axes[0], ["training loss", *(f"test {name}" for name in names)]):
        axis.set_title(title)
        axis.set_xlabel("iteration")
        axis.grid(True, alpha=0.3)
        axis.set_ylim(bottom=0)
        if axis.lines:
            axis.legend(frameon=False)
    pictures.write_figure(out, figure, dpi=110)


def _curve(axis: object, curve: Curve, label: str, marker: str = "") -> None:
    if curve:
        axis.plot(*zip(*curve), label=label, marker=marker, markersize=3)  # type: ignore[attr-defined]


if __name__ == "__main__":
    sys.exit(main())
