"""Read a piece of prototxt in a document as a net, a solver, a skeleton, a prior, or another message."""

from __future__ import annotations

import dataclasses

from handpose.synthetic.prior_file import PosePrior
from layers.hand.skeleton import Skeleton
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
        for layer in load_parameter(tree).layer:  # the blobs that they read need not be defined
            _check(layer)
        return
    others = [kind for kind in vars(messages).values() if isinstance(kind, type) and dataclasses.is_dataclass(kind)]
    kinds = [SkeletonParameter, SolverParameter, NetParameter, PosePrior, LayerParameter, *others,
             *options.option_blocks().values()]
    message = schema.read(tree, min(kinds, key=lambda kind: len(names - _fields(kind))))
    if isinstance(message, LayerParameter):
        _check(message)
    if isinstance(message, SkeletonParameter) and _is_whole(message):
        Skeleton(message)


def _check(layer: LayerParameter) -> None:
    assert layer.type in {None, "", "Python", *options.layer_types()}, f"unknown layer type {layer.type!r}"
    create.check_options(layer)


def _is_whole(skeleton: SkeletonParameter) -> bool:
    """Whether joints refer only to joints and DoFs of the same piece."""
    moved = {motion.dof for joint in skeleton.joint for motion in (*joint.translate, *joint.rotate)}
    joints, parents = ({getattr(joint, name) for joint in skeleton.joint} for name in ("name", "parent"))
    return bool(joints) and parents - {None} <= joints and moved <= {dof.name for dof in skeleton.dof}


def _fields(kind: type) -> set[str]:
    blocks = set(options.option_blocks()) if kind is LayerParameter else set()
    return {schema.written_name(field.name) for field in dataclasses.fields(kind)} - {"blocks"} | blocks
