#!/usr/bin/env python3
"""Plot the loss and test curves of training logs of this project or of Caffe.

    python tools/plot_log.py snapshots/train.log --out snapshots/train.png

Several logs share one figure. The log of a training run resumed with --snapshot can follow the first log in one file.
Of more than eight test outputs, the first in the order of their names are drawn.
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
from tools.common import outputs
from tools.common.arguments import parser_of
from tools.common.console import DONE, guarded, say

_NUMBER = r"([-+]?(?:\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|nan|inf))"
_ITERATION = re.compile(r"Iteration (\d{1,18})(?!\d)")
_LOSS = re.compile(rf"Iteration (\d{{1,18}})(?: \([^()]*\))?, loss = {_NUMBER}")
_OUTPUT = re.compile(rf"Test net output #\d+: (\S+) = {_NUMBER}")

MAX_PANELS = 8  # for test outputs

Curve = list[tuple[int, float]]


@dataclass
class Log:
    """The curves of one log: (iteration, value) pairs."""

    loss: Curve = field(default_factory=list)
    test: dict[str, Curve] = field(default_factory=dict)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("logs", metavar="LOG", nargs="+", help="log of tools/train.py --log, or stderr of Caffe")
    parser.add_argument("--out", metavar="FILE", default="log.png",
                        help="figure; its suffix selects the format (default: %(default)s)")
    args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Plot the logs."""
    outputs.refuse_inputs(args.out, args.logs)
    logs = {path: read_log(path) for path in args.logs}
    plot(logs, args.out)
    say(f"wrote {args.out}")
    return DONE


def read_log(path: str | Path) -> Log:
    """Parse a log. Raises DataError if it cannot be read or has no iterations."""
    text = files.read_text(path, "the log", errors="replace")
    log, iteration = Log(), 0
    for line in text.splitlines():
        if found := _LOSS.search(line):
            log.loss.append((int(found[1]), float(found[2])))
        if found := _ITERATION.search(line):
            iteration = int(found[1])
        if found := _OUTPUT.search(line):
            log.test.setdefault(found[1], []).append((iteration, float(found[2])))
    if not log.loss and not log.test:
        raise DataError(f"{path}: it has no line like 'Iteration 20 (...), loss = 0.5'; expected a training log")
    return log


def plot(logs: dict[str, Log], out: str | Path) -> None:
    """Plot one panel for the loss and one per test output. Raises NetlibError if the figure cannot be written."""
    names = sorted({name for log in logs.values() for name in log.test})
    if len(names) > MAX_PANELS:
        say(f"drew the first {MAX_PANELS} of {len(names)} test outputs", file=sys.stderr)
    titles = ["training loss", *(f"test {outputs.label(name)}" for name in names[:MAX_PANELS])]
    figure = outputs.new_figure(5.2 * len(titles), 4)
    axes = figure.subplots(1, len(titles), squeeze=False)[0]
    stems = [Path(path).stem for path in logs]
    for path, log in logs.items():
        stem, folder = Path(path).stem, Path(path).parent.name
        label = outputs.label(f"{folder}/{stem}" if stems.count(stem) > 1 and folder else stem)
        axes[0].plot([i for i, _ in log.loss], [loss for _, loss in log.loss], label=label)
        for axis, name in zip(axes[1:], names):
            if curve := log.test.get(name):
                axis.plot(*zip(*curve), label=label, marker="o", markersize=3)
    for axis, title in zip(axes, titles):
        axis.set_title(title)
        axis.set_xlabel("iteration")
        axis.grid(True, alpha=0.3)
        axis.set_ylim(bottom=0)
        axis.legend(frameon=False)
    outputs.write_figure(out, figure, dpi=110)


if __name__ == "__main__":
    sys.exit(main())
