#!/usr/bin/env python3
"""Plot the loss and test curves of training logs of this project or of Caffe.

    python tools/plot_log.py snapshots/train.log --out snapshots/train.png

Several logs share one figure. The log of a training run resumed with --snapshot can follow
the first log in one file. Of more than eight test outputs, the first in the order of their
names are drawn.
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib import files
from netlib.errors import DataError
from tools.common import outputs
from tools.common.arguments import parser_of
from tools.common.console import guarded, notify, say

_NUMBER = r"([-+]?(?:\d+(?:\.\d*)?(?:[eE][-+]?\d+)?|nan|inf))"
_ITERATION = re.compile(r"Iteration (\d{1,18})(?!\d)")
_LOSS = re.compile(rf"Iteration (\d{{1,18}})(?: \([^()]*\))?, loss = {_NUMBER}")
_OUTPUT = re.compile(rf"Test net output #\d+: (\S+) = {_NUMBER}")

LOSS = "training loss"
MAX_MARKED = 10  # points of a curve of the loss that are marked
MARGIN = 0.03  # of the range of iterations
MAX_PANELS = 8  # for test outputs

Curve = list[tuple[int, float]]  # iteration, value


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument(
        "logs", metavar="LOG", nargs="+", help="log of tools/train.py --log, or stderr of Caffe"
    )
    parser.add_argument(
        "--out",
        metavar="FILE",
        default="log.png",
        help="figure; its suffix selects the format (default: %(default)s)",
    )
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Plot the logs."""
    outputs.refuse_inputs(args.out, args.logs)
    logs = {path: read_log(path) for path in args.logs}
    plot(logs, args.out)
    say(f"wrote {args.out}")


def read_log(path: str | Path) -> dict[str, Curve]:
    """The curves of a log: LOSS, and those of the test outputs by their names.

    Raises DataError if there is none.
    """
    text = files.read_text(path, "the log", errors="replace")
    curves: dict[str, Curve] = {}
    iteration = 0
    for line in text.splitlines():
        if found := _LOSS.search(line):
            curves.setdefault(LOSS, []).append((int(found[1]), float(found[2])))
        if found := _ITERATION.search(line):
            iteration = int(found[1])
        if found := _OUTPUT.search(line):
            curves.setdefault(f"test {found[1]}", []).append((iteration, float(found[2])))
    if not curves:
        raise DataError(
            f"{path}: it has no line like 'Iteration 20 (...), loss = 0.5'; expected a training log"
        )
    return curves


def plot(logs: dict[str, dict[str, Curve]], out: str | Path) -> None:
    """Plot one panel for the loss and one per test output.

    Raises NetlibError if the figure cannot be written.
    """
    names = sorted({name for log in logs.values() for name in log} - {LOSS})
    if len(names) > MAX_PANELS:
        notify(f"drew the first {MAX_PANELS} of {len(names)} test outputs")
    names = [LOSS, *names[:MAX_PANELS]]
    figure = outputs.new_figure(5.2 * len(names), 4)
    panels = dict(zip(names, figure.subplots(1, len(names), squeeze=False)[0]))
    for label, log in zip(_labels([*logs]), logs.values()):
        for name, curve in log.items():
            if name in panels:
                # a single point has no line
                marker = "" if name == LOSS and len(curve) > MAX_MARKED else "o"
                panels[name].plot(*zip(*curve), label=label, marker=marker, markersize=3)
    low, high = _range(logs)
    for name, axis in panels.items():
        axis.set_xlim(low, high)
        axis.set_title(outputs.label(name))
        axis.set_xlabel("iteration")
        axis.grid(True, alpha=0.3)
        axis.set_ylim(bottom=0)
        axis.legend(frameon=False)
    outputs.write_figure(out, figure, dpi=110)


def _labels(paths: Sequence[str]) -> list[str]:
    """The labels of logs: their names, with the folders of those that have the same name."""
    stems = [Path(path).stem for path in paths]
    folders = [Path(path).parent.name for path in paths]
    return [
        outputs.label(f"{folder}/{stem}" if folder and stems.count(stem) > 1 else stem)
        for folder, stem in zip(folders, stems)
    ]


def _range(logs: dict[str, dict[str, Curve]]) -> tuple[float, float]:
    """The range of the iterations of all curves, with a margin."""
    curves = [curve for log in logs.values() for curve in log.values()]
    iterations = [iteration for curve in curves for iteration, _ in curve]
    first = min(iterations)
    last = max(*iterations, first + 1)
    margin = MARGIN * (last - first)
    return first - margin, last + margin


if __name__ == "__main__":
    sys.exit(main())
