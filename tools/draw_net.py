#!/usr/bin/env python3
"""Draw the graph of a net: its layers and blobs. The command line is that of Caffe's draw_net.py.

    python tools/draw_net.py prototxt/nyu_train_test.prototxt net.png --phase TRAIN --rankdir TB

Requires the packages pydot and protobuf (pip install pydot protobuf) and, except for .dot files, Graphviz.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib import TEST, TRAIN
from netlib.proto import prototxt, wire
from netlib.proto.messages import NetParameter
from netlib.proto.upgrade import upgraded
from tools.common.arguments import parser_of
from tools.common.console import DONE, guarded, say
from tools.common.deploy_nets import advice, is_training_net

PHASES = {"TRAIN": TRAIN, "TEST": TEST, "ALL": None}


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("input_net_proto_file", help="the net's prototxt, in any of Caffe's formats")
    parser.add_argument("output_image_file", help="image to write; its suffix selects the format: png, svg, pdf; dot "
                        "or raw is Graphviz's own language and does not need Graphviz")
    parser.add_argument("--rankdir", choices=["LR", "RL", "TB", "BT"], default="LR",
                        help="direction: left to right, top to bottom ... (default: %(default)s)")
    parser.add_argument("--phase", choices=list(PHASES), default="ALL",
                        help="draw the layers of this phase (default: %(default)s)")
    parser.add_argument("--display_lrm", action="store_true", help="show the lr_mult of layers with weights")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> int:
    """Draw the net."""
    from netlib.caffe import draw
    from netlib.caffe.proto import caffe_pb2

    tree = upgraded(prototxt.parse_file(args.input_net_proto_file))
    net = caffe_pb2.NetParameter.FromString(wire.encode(tree, NetParameter))
    draw.draw_net_to_file(net, args.output_image_file, args.rankdir, PHASES[args.phase], args.display_lrm)
    say(f"wrote {args.output_image_file}")
    if is_training_net(args.input_net_proto_file):
        say(f"this is a training net; {advice(args.input_net_proto_file)} writes it without data and losses",
            file=sys.stderr)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
