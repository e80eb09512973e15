#!/usr/bin/env python3
"""Write a net as ONNX, so that any runtime of ONNX runs it: onnxruntime, OpenCV, a browser, a phone.

    python tools/export_onnx.py prototxt/nyu_deploy.prototxt snapshots/nyu_iter_1000.caffemodel.h5 hand.onnx
    python tools/export_onnx.py models/synthetic_hand/deploy.prototxt \
        models/synthetic_hand/synthetic_hand.caffemodel.h5 hand.onnx --blob DoF --check

The file has standard operators only, the hand model included, and takes batches of any size. Inputs and outputs are
called as in the prototxt; what they mean is in the file's metadata (docs/onnx.md).

--check runs it in onnxruntime, on random inputs, against this project's own computation. It fails if an output is off
by more than 1e-5 of the output's largest value. Needs the packages of pip install onnx onnxruntime.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from export.onnx.net import differences, load, onnx_image
from handpose.facts.nyu import CUBE_MM
from netlib.errors import NetlibError, reason_of
from netlib.files import atomic
from tools.common import outputs
from tools.common.arguments import cube, parser_of
from tools.common.console import DONE, FAILED, guarded, say

BATCHES = (1, 3)  # of --check
TOLERANCE = 1e-5


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("net", metavar="NET", help="the net's deploy prototxt")
    parser.add_argument("weights", metavar="WEIGHTS", help="*.caffemodel or *.caffemodel.h5")
    parser.add_argument("out", metavar="OUT", type=Path, help="the file to write, *.onnx")
    parser.add_argument("--blob", metavar="NAME", action="append", default=[],
                        help="give out this blob, too, for example DoF; may be given several times")  # fmt: skip
    parser.add_argument("--cube", type=cube, metavar="MM",
                        help="edge of the cube that crops of a body show, for the metadata "
                             f"(default of hands: {CUBE_MM:g})")  # fmt: skip
    parser.add_argument("--check", action="store_true", help="compare with onnxruntime")
    args = parser.parse_args(argv)
    return guarded(run, args)


def run(args: argparse.Namespace) -> int:
    """Write, and check, as the parsed arguments say. Raises NetlibError."""
    outputs.refuse_inputs(args.out, [args.net, args.weights])
    net = load(args.net, args.weights)
    image = onnx_image(net, args.blob, args.cube)
    try:
        atomic.replace(args.out, lambda temporary: temporary.write_bytes(image))
    except OSError as error:
        raise NetlibError(f"{args.out}: cannot write the file: {reason_of(error)}") from error
    say(f"wrote {args.out}: {len(image) / 1e6:.2f} MB")
    if not args.check:
        return DONE
    worst = differences(args.out.read_bytes(), net, BATCHES, args.blob)
    for name, difference in worst.items():
        say(f"{name}: largest difference {difference:.1e} of its largest value, batches of "
            f"{' and '.join(map(str, BATCHES))}")  # fmt: skip
    if max(worst.values()) > TOLERANCE:
        say(f"{args.out}: onnxruntime computes something else, by more than {TOLERANCE:g}", file=sys.stderr)
        return FAILED
    return DONE


if __name__ == "__main__":
    sys.exit(main())
