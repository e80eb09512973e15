#!/usr/bin/env python3
"""Export a net to ONNX, for runtimes such as onnxruntime, OpenCV, browsers and phones.

    python tools/export_onnx.py prototxt/nyu_deploy.prototxt \\
        snapshots/nyu_iter_1000.caffemodel.h5 hand.onnx
    python tools/export_onnx.py deploy.prototxt net.caffemodel net.onnx --opset 13
    python tools/export_onnx.py models/synthetic_hand/deploy.prototxt \\
        models/synthetic_hand/synthetic_hand.caffemodel.h5 hand.onnx --blob DoF --check

The file uses only standard operators, including for the hand model, and accepts batches of any
size, but images of one size: that of the prototxt, or --size. Inputs and outputs have the names of
the prototxt; their meaning is in the file's metadata (docs/onnx.md). --opset 13 is for older
runtimes and converters; the numbers are the same.

--check runs it in onnxruntime on random inputs and compares outputs and layers with netlib in
float64. It fails if a difference is larger than rounding to float32 explains: 1e-5 of the largest
value plus 10 times the measured effect of rounding. Of a detector it compares locations,
confidences, and what is selected from the same ones. Requires pip install onnx onnxruntime.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from export.onnx.check import differences
from export.onnx.graph import IR_VERSIONS, OPSET
from export.onnx.net import load, onnx_image
from handpose.body.nyu import CUBE_MM
from handpose.estimate.nets import cube_of, hand_layer
from netlib.errors import NetlibError
from netlib.files import atomic, reading
from netlib.net import Net
from tools.common import outputs
from tools.common.arguments import parser_of, pixels, whole
from tools.common.console import DONE, FAILED, guarded, notify, say
from tools.common.deploy_nets import refuse_training_net
from tools.common.sources import cube

BATCHES = (1, 3)  # batch sizes of --check


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("net", metavar="NET", help="deploy prototxt of the net")
    parser.add_argument("weights", metavar="WEIGHTS", help="*.caffemodel or *.caffemodel.h5")
    parser.add_argument("out", metavar="OUT", type=Path, help="the file to write, *.onnx")
    parser.add_argument(
        "--blob",
        metavar="NAME",
        action="append",
        default=[],
        help="also output this blob, for example DoF; can be repeated",
    )
    parser.add_argument(
        "--cube",
        type=cube,
        metavar="MM",
        help="edge of the cube around a body in its crops, for the metadata "
        f"(default for hands: {CUBE_MM:g})",
    )
    parser.add_argument(
        "--size", type=pixels, metavar="WxH", help="size of images; the net is reshaped to it"
    )
    parser.add_argument(
        "--opset",
        type=whole(min(IR_VERSIONS), max(IR_VERSIONS)),
        metavar="N",
        default=OPSET,
        help="version of ONNX's operators, from 13, for some nets from 11 (default: %(default)s)",
    )
    parser.add_argument("--check", action="store_true", help="compare with onnxruntime")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Write and optionally check the file. Raises NetlibError."""
    outputs.refuse_inputs(args.out, [args.net, args.weights])
    refuse_training_net(args.net)
    net = load(args.net, args.weights)
    if args.size:
        _reshape(net, *args.size)
    hand = hand_layer(net)
    cube_mm = None if hand is None else cube_of(hand.skeleton, args.cube)
    image = onnx_image(net, args.blob, cube_mm, args.opset)
    with reading.refused(args.out, "the file", NetlibError, "write"):
        atomic.replace(args.out, lambda temporary: temporary.write_bytes(image))
    say(f"wrote {args.out}: {len(image) / 1e6:.2f} MB")
    if not args.check:
        return DONE
    of_outputs, of_layers = differences(args.out.read_bytes(), net, BATCHES)
    batches = " and ".join(map(str, BATCHES))
    for name, difference in of_outputs.items():
        say(
            f"{name}: largest difference {difference.found:.1e} of its largest value (float32 rounding: "
            f"{difference.rounding:.1e}), batch sizes {batches}"
        )
    for name, difference in [*of_layers.items(), *of_outputs.items()]:
        if difference.found > difference.limit:
            place = f"{args.out}: blob {name!r}"
            notify(
                f"{place}: onnxruntime's values differ by {difference.found:.1e} of the largest "
                f"value; expected at most {difference.limit:.1e}, which float32 rounding explains"
            )
            return FAILED
    return DONE


def _reshape(net: Net, width: int, height: int) -> None:
    """Reshape the inputs for images. Raises NetlibError."""
    blobs = [net.blobs[name] for name in net.inputs if len(net.blobs[name].shape) == 4]
    if not blobs:
        raise NetlibError(f"{net.source}: --size needs an input (N, C, H, W)")
    for blob in blobs:
        blob.reshape((*blob.shape[:2], height, width))
    net.reshape()


if __name__ == "__main__":
    sys.exit(main())
