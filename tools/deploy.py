#!/usr/bin/env python3
"""Write the deploy net of a training net: what classifies images, without the layers for data,
losses and scores.

    python tools/deploy.py train_val.prototxt deploy.prototxt
    python tools/deploy.py lenet_train_test.prototxt lenet.prototxt --shape data=1,1,28,28

The layers are those of phase TEST. A layer that reads data becomes an input, a SoftmaxWithLoss a
Softmax, other losses and Accuracy are removed, and so are auxiliary losses, such as those of
GoogLeNet, with the layers before them. The names are those of the training net, so its weights fit.
How the training transformed its images is in comments.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib.files import atomic
from netlib.proto import schema
from tools.common import outputs
from tools.common.arguments import expected, parser_of
from tools.common.console import guarded, say
from tools.common.deploy_nets import deploy_net


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("net", metavar="NET", help="training net, such as train_val.prototxt")
    parser.add_argument("out", metavar="OUT", type=Path, help="the deploy net to write")
    parser.add_argument(
        "--shape",
        metavar="NAME=N,C,H,W",
        type=shape,
        action="append",
        default=[],
        help="shape of an input, if neither the prototxt nor its data tell; can be repeated",
    )
    return guarded(run, parser.parse_args(argv))


def shape(text: str) -> tuple[str, tuple[int, ...]]:
    """Parse the name of an input and its shape: data=1,3,224,224."""
    name, _, numbers = text.rpartition("=")
    sizes = numbers.split(",")
    if not name or not all(
        size.isascii() and size.isdigit() and 0 < int(size) < 1 << 31 for size in sizes
    ):
        raise expected("NAME=N,C,H,W, such as data=1,3,224,224", text)
    return name, tuple(map(int, sizes))


def run(args: argparse.Namespace) -> None:
    """Write the net. Raises NetlibError."""
    outputs.check_place(args.out, [args.net])
    made = deploy_net(args.net, args.out, dict(args.shape))
    comments = "".join(f"# {line}\n" for line in made.comments)
    atomic.replace_text(args.out, comments + str(schema.to_tree(made.param)))
    say(f"wrote {args.out}: {len(made.param.layer)} layers", *made.comments[1:], sep="\n")


if __name__ == "__main__":
    sys.exit(main())
