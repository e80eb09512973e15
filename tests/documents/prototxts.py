"""Read a piece of prototxt in a document as a net, a solver, a skeleton, a prior, or another message."""

from __future__ import annotations

import dataclasses

from handpose.synthetic.prior_file import PosePrior
from layers.hand.skeleton_file import SkeletonParameter
from netlib.building import create
from netlib.proto import messages, options, prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, SolverParameter
from netlib.proto.net_parameter import load_parameter


def read(text: str) -> None:
    """Read the message whose fields the text has. Raises PrototxtError, NetlibError."""
    tree = prototxt.parse(text, "the block")
    names = {item.name for item in tree.fields}
    if names & {"layer", "layers"}:
        layers = load_parameter(tree).layer  # the blobs that they read need not be defined
    else:
        others = [kind for kind in vars(messages).values() if isinstance(kind, type) and dataclasses.is_dataclass(kind)]
        kinds = [SkeletonParameter, SolverParameter, NetParameter, PosePrior, LayerParameter, *others,
                 *options.option_blocks().values()]
        message = schema.read(tree, min(kinds, key=lambda kind: len(names - _fields(kind))))
        layers = [message] if isinstance(message, LayerParameter) else []
    for layer in layers:
        assert layer.type in {None, "", "Python", *options.layer_types()}, f"unknown layer type {layer.type!r}"
        create.check_options(layer)


def _fields(kind: type) -> set[str]:
    blocks = set(options.option_blocks()) if kind is LayerParameter else set()
    return {schema.written_name(field.name) for field in dataclasses.fields(kind)} | blocks
