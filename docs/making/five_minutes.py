"""Chapter 0's second training: the paper's network on frames that are rendered first, in about five minutes.

python -m docs.making.five_minutes                                 4,096 frames; the picture is five_minutes.svg
python -m docs.making.five_minutes --frames 64 --out by_heart.svg  so few that the network learns them by heart

The errors are those of 256 held-out frames and of up to 256 training frames. The documents show the runs of 4,096 and
64 frames, and what docs/book/nano.py prints, as --record has written them (docs/results/five_minutes.json).
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from docs.making.figures import drawn, learned
from docs.making.training import CHECKS, FEW, FRAMES, HELD_OUT, ITERATIONS, RECORD, Point, learn, rendered
from netlib.errors import NetlibError
from netlib.files import atomic
from netlib.files.paths import ROOT
from tools.common.arguments import parser_of


def record() -> None:
    """Run both again, and nano.py, for several minutes."""
    command = [sys.executable, str(ROOT / "docs" / "book" / "nano.py")]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    pictured = (0, ITERATIONS // 10, ITERATIONS)
    runs = {
        frames: [
            point if point.iteration in pictured else point._replace(shown=[]) for point in run(frames, ITERATIONS)
        ]
        for frames in (FRAMES, FEW)
    }
    kept = {"nano": [line.rstrip() for line in done.stdout.splitlines()], "runs": runs}
    atomic.replace_text(RECORD, json.dumps(kept, separators=(",", ":")) + "\n")


def run(frames: int, iterations: int) -> list[Point]:
    """Render, train, and print a line for each measurement."""
    print(f"rendering {frames} + {HELD_OUT} frames", flush=True)
    training, held_out, points = rendered("train", frames), rendered("test", HELD_OUT), []
    for point in learn(training, held_out, iterations):
        errors = f"training frames {point.training_mm:5.1f} mm, held-out frames {point.held_out_mm:5.1f} mm"
        print(f"iteration {point.iteration:4}   {errors}", flush=True)
        points.append(point)
    return points


def main(argv: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("--frames", type=int, default=FRAMES, help=f"training frames (default: {FRAMES})")
    parser.add_argument("--iterations", type=int, default=ITERATIONS, help=f"default: {ITERATIONS}")
    parser.add_argument("--out", type=Path, default=Path("five_minutes.svg"), help="the picture (default: %(default)s)")
    parser.add_argument("--record", action="store_true", help="both runs of the documents, into their record")
    args = parser.parse_args(argv)
    if args.frames < 1 or args.iterations < CHECKS:
        parser.error(f"--frames must be at least 1 and --iterations at least {CHECKS}")
    try:
        if args.record:
            record()
            print(f"wrote {RECORD.relative_to(ROOT)}; run make docs")
            return 0
        points = run(args.frames, args.iterations)
        atomic.replace_bytes(args.out, drawn.as_svg(learned.hands_over_time(points)))
        print(f"wrote {args.out}")
    except (OSError, NetlibError) as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
