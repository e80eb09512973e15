#!/usr/bin/env python3
"""Upgrade a net of Caffe's older formats, or a solver, to the current format.

Replaces Caffe's upgrade_net_proto_text, upgrade_net_proto_binary and upgrade_solver_proto_text.

    python tools/upgrade_net.py lenet_v1.prototxt lenet.prototxt
    python tools/upgrade_net.py old.caffemodel new.caffemodel
    python tools/upgrade_net.py --solver old_solver.prototxt solver.prototxt

Text files stay text and binary files stay binary. Comments are lost, as in Caffe.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

from netlib import files
from netlib.building.create import check_options
from netlib.errors import NetlibError, PrototxtError
from netlib.files.atomic import replace_bytes
from netlib.files.paths import find
from netlib.proto import prototxt, schema, wire
from netlib.proto.messages import NetParameter, SolverParameter
from netlib.proto.net_parameter import input_layer
from netlib.proto.prototxt import Field, Message, Scalar
from netlib.proto.upgrade import AnyNetParameter, upgraded
from netlib.training.solver_parameter import OLD_TYPES
from tools.common.arguments import parser_of
from tools.common.console import guarded, notify, say

INPUTS = ("input", "input_shape", "input_dim")


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__)
    parser.add_argument("old", metavar="IN", help="net, or with --solver a solver")
    parser.add_argument("new", metavar="OUT", help="file to write")
    parser.add_argument("--solver", action="store_true", help="IN is a solver in text format")
    return guarded(run, parser.parse_args(argv))


def run(args: argparse.Namespace) -> None:
    """Upgrade the file."""
    old = str(find(args.old, None))
    content = files.read_bytes(old, "the net")
    if args.solver or _is_text(content):
        tree = prototxt.parse_file(old)
        new = current_solver(tree) if args.solver else current_net(tree)
        image = str(new).encode("utf-8", "surrogateescape")
    else:
        tree = wire.decode(content, AnyNetParameter, old)
        new = current_net(tree)
        image = wire.encode(new, NetParameter)
    if new.fields == tree.fields:
        notify(f"{old}: already in the current format")
    replace_bytes(Path(args.new), image)
    say(f"wrote {args.new}")


def _is_text(content: bytes) -> bool:
    """Whether the content is text; binary messages contain control characters, in
    keys or lengths.
    """
    return not any(byte < 32 and byte not in b"\t\n\v\f\r" for byte in content)


def current_net(tree: Message) -> Message:
    """Convert a net to the current format, with inputs as a layer.

    Raises PrototxtError if it is not a net.
    """
    if tree.values("lr_policy") or tree.values("base_lr"):
        raise NetlibError(f"{tree.position}: error: this is a solver; add --solver")
    new = upgraded(tree)
    net = schema.read(new, NetParameter, "net")
    for spec in net.layer:
        check_options(spec)
    if not net.layer and not net.input:
        raise PrototxtError(new.position, "this file has no layers; expected a net")
    if not net.input:
        return new
    fields = new.without(*INPUTS).fields
    # weights files name inputs without shapes; Caffe drops those
    if net.input_shape or net.input_dim:
        first = next((i for i, field in enumerate(fields) if field.name == "layer"), len(fields))
        layer = schema.to_tree(input_layer(net))
        fields.insert(first, Field("layer", layer, layer.position))
    return Message(fields, new.position)


def current_solver(tree: Message) -> Message:
    """Convert the solver's type to a name. Raises PrototxtError if it is not a solver."""
    solver = schema.read(tree, SolverParameter, "solver")
    if solver.solver_type is None:
        return tree
    place = schema.position_of(solver, "solver_type")
    if tree.values("type"):
        raise PrototxtError(place, "found both solver_type and type; expected one of them")
    new = Field("type", Scalar("string", OLD_TYPES[solver.solver_type], place), place)
    return Message(
        [new if field.name == "solver_type" else field for field in tree.fields], tree.position
    )


if __name__ == "__main__":
    sys.exit(main())
