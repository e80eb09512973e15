#!/usr/bin/env python3
"""Plot the loss and test curves of training logs of this project or of Caffe.

    python tools/plot_log.py snapshots/train.log --out snapshots/train.png

Several logs share one figure. The log of a training run resumed with --snapshot can follow the first log in one file.
If there are many test outputs, those with the largest last values have their own panels; the others share one.
"""

from __future__ import annotations

import argparse
import math
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib import files
from netlib.errors import DataError, printable
from tools.common import outputs
from tools.common.arguments import parser_of
from tools.common.console import DONE, guarded, say

_NUMBER = r"([-+]?(?:\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|nan|inf))"
_ITERATION = re.compile(r"Iteration (\d{1,18})(?!\d)")
_LOSS = re.compile(rf"Iteration (\d{{1,18}})(?: \([^()]*\))?, loss = {_NUMBER}")
_OUTPUT = re.compile(rf"(Train|Test) net output #\d+: (\S+) = {_NUMBER}")

MAX_PANELS = 8  # for test outputs
MAX_LABELS = 12  # in a legend
MAX_LENGTH = 40  # characters of a name

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
            curves = log.train if found[1] == "Train" else log.test
            curves.setdefault(found[2], []).append((iteration, float(found[3])))
    if not log.loss and not log.test:
        raise DataError(f"{path}: it has no line like 'Iteration 20 (...), loss = 0.5'; expected a training log")
    return log


def plot(logs: dict[str, Log], out: str | Path) -> None:
    """Plot one panel for the loss and one per test output. Raises NetlibError if the figure cannot be written."""
    names = sorted({name for log in logs.values() for name in log.test})
    own = names if len(names) <= MAX_PANELS else sorted(_largest(logs, names))
    others = [name for name in names if name not in own]
    titles = ["training loss", *(f"test {shortened(name)}" for name in own)]
    if others:
        titles.append(f"{len(others)} more test outputs")
    figure = outputs.new_figure(5.2 * len(titles), 4)
    axes = figure.subplots(1, len(titles), squeeze=False)[0]
    stems = [Path(path).stem for path in logs]
    for path, log in logs.items():
        stem, folder = Path(path).stem, Path(path).parent.name
        label = shortened(f"{folder}/{stem}" if stems.count(stem) > 1 and folder else stem)
        _curve(axes[0], log.loss, f"{label}: train")
        for axis, name in zip(axes[1:], own):
            _curve(axis, log.test.get(name, []), label, marker="o")
        if others:
            _curve(axes[-1], _end_to_end([log.test.get(name, []) for name in others]), label)
    for axis, title in zip(axes, titles):
        axis.set_title(title)
        axis.set_xlabel("iteration")
        axis.grid(True, alpha=0.3)
        axis.set_ylim(bottom=0)
        if axis.lines:
            unnamed = len(axis.lines) - MAX_LABELS
            axis.legend(handles=axis.lines[:MAX_LABELS], frameon=False,
                        title=f"{unnamed} more without a label" if unnamed > 0 else None)
    outputs.write_figure(out, figure, dpi=110)


def shortened(name: str) -> str:
    """Shorten and escape a name for a label, because matplotlib interprets $ and rejects invalid UTF-8."""
    name = printable(name)
    kept = name if len(name) <= MAX_LENGTH else f"{name[: MAX_LENGTH - 15]}…{name[-14:]}"
    return kept.replace("$", r"\$")


def _largest(logs: dict[str, Log], names: list[str]) -> list[str]:
    """The outputs with their own panels if there are too many; one panel remains for the others."""
    last = {name: max(log.test[name][-1][1] for log in logs.values() if name in log.test) for name in names}
    return sorted(names, key=lambda name: math.inf if math.isnan(last[name]) else last[name])[1 - MAX_PANELS :]


def _end_to_end(curves: list[Curve]) -> Curve:
    """Join curves into one line with gaps, which is faster to draw."""
    return [point for curve in curves if curve for point in (*curve, (curve[-1][0], math.nan))]


def _curve(axis: Any, curve: Curve, label: str, marker: str = "") -> None:
    if curve:
        axis.plot(*zip(*curve), label=label, marker=marker, markersize=3)


if __name__ == "__main__":
    sys.exit(main())
