#!/usr/bin/env python3
"""Draw the graph of a net: its layers, blobs and their shapes.

The command line is that of Caffe's draw_net.py.

    python tools/draw_net.py prototxt/nyu_train_test.prototxt net.png --phase TRAIN --rankdir TB
    python tools/draw_net.py deploy.prototxt --out net.svg

A layer in place stands in the box of the layer before it. The shapes are those of phase TEST, if
the net can be built. Requires the packages pydot and protobuf (pip install pydot protobuf) and,
except for .dot files, Graphviz. The program Netron (netron.app) shows prototxts interactively.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib import TEST, TRAIN
from netlib.errors import NetlibError
from netlib.net import Net
from netlib.proto import prototxt, wire
from netlib.proto.messages import NetParameter
from netlib.proto.upgrade import upgraded
from tools.common.arguments import parser_of
from tools.common.console import guarded, notify, say
from tools.common.deploy_nets import deploy_command

PHASES = {"TRAIN": TRAIN, "TEST": TEST, "ALL": None}


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument(
        "input_net_proto_file", help="the net's prototxt, in any of Caffe's formats"
    )
    image = parser.add_mutually_exclusive_group(required=True)
    image.add_argument(
        "output_image_file",
        nargs="?",
        help="image to write; its suffix selects the format: png, svg, "
        "pdf; dot or raw is Graphviz's own language and does not need Graphviz",
    )
    image.add_argument("--out", metavar="FILE", help="the same")
    parser.add_argument(
        "--rankdir",
        choices=["LR", "RL", "TB", "BT"],
        default="LR",
        help="direction: left to right, top to bottom ... (default: %(default)s)",
    )
    parser.add_argument(
        "--phase",
        choices=list(PHASES),
        default="ALL",
        help="draw the layers of this phase (default: %(default)s)",
    )
    parser.add_argument(
        "--display_lrm", action="store_true", help="show the lr_mult of layers with weights"
    )
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Draw the net."""
    from netlib.caffe import draw
    from netlib.caffe.proto import caffe_pb2

    out = args.out or args.output_image_file
    tree = upgraded(prototxt.parse_file(args.input_net_proto_file))
    net = caffe_pb2.NetParameter.FromString(wire.encode(tree, NetParameter))
    shapes = _shapes(args.input_net_proto_file)
    draw.draw_net_to_file(net, out, args.rankdir, PHASES[args.phase], args.display_lrm, shapes)
    say(f"wrote {out}")
    if shapes and (deploy := deploy_command(args.input_net_proto_file)):
        notify(f"this is a training net; {deploy} writes it without data and losses")


def _shapes(model: str) -> dict[str, tuple[int, ...]]:
    """The shapes of the blobs in phase TEST; without any, and with a line, if the net
    cannot be built.
    """
    try:
        return {name: blob.shape for name, blob in Net(model, TEST).blobs.items()}
    except NetlibError as error:
        deploy = deploy_command(model)
        about = f"; the deploy net has some: {deploy} writes it" if deploy else ""
        notify(f"without shapes: {error}{about}")
        return {}


if __name__ == "__main__":
    sys.exit(main())
