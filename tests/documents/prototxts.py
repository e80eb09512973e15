"""Read a piece of prototxt in a document, like a file, as a net, a solver, a skeleton, a prior, or another message."""

from __future__ import annotations

import dataclasses

from handpose.synthetic.prior_file import PosePrior
from layers.hand.skeleton import Skeleton
from layers.hand.skeleton_file import SkeletonParameter
from netlib.building import create
from netlib.errors import PrototxtError
from netlib.proto import messages, options, prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, SolverParameter
from netlib.proto.net_parameter import load_parameter
from netlib.proto.prototxt import Message


def read(text: str, source: str) -> object:
    """Return the message in the text. Raises PrototxtError, NetlibError."""
    tree = prototxt.parse(text, source)
    names = {item.name for item in tree.fields}
    if not names:
        raise PrototxtError(tree.position, "nothing in it")
    if names & {"layer", "layers"}:
        return _net(tree)
    if names <= _fields(SkeletonParameter):
        return _skeleton(tree)
    for kind in (SolverParameter, NetParameter, PosePrior):
        if names <= _fields(kind):
            return schema.read(tree, kind)
    if "type" in names or all(name.endswith("_param") for name in names):
        return _checked(schema.read(tree, LayerParameter, "layer"))
    errors = []
    for kind in _other_kinds():
        try:
            return schema.read(tree, kind)
        except PrototxtError as error:
            errors.append((len(names - _fields(kind)), error))
    raise min(errors, key=lambda pair: pair[0])[1]


def _net(tree: Message) -> NetParameter:
    """Read a net, or some of its layers; the blobs that they read need not be defined."""
    net = load_parameter(tree)
    for layer in net.layer:
        _checked(layer)
    return net


def _checked(layer: LayerParameter) -> LayerParameter:
    if layer.type and layer.type not in {*options.layer_types(), "Python"}:
        raise PrototxtError(schema.position_of(layer, "type"), f"unknown layer type {layer.type!r}")
    create.check_options(layer)
    return layer


def _skeleton(tree: Message) -> SkeletonParameter:
    """Build a skeleton; of a piece that refers to joints or DoFs outside it, only read the fields."""
    skeleton = schema.read(tree, SkeletonParameter, "skeleton")
    joints, dofs = {joint.name for joint in skeleton.joint}, {dof.name for dof in skeleton.dof}
    parents = {joint.parent for joint in skeleton.joint} - {None}
    moved = {motion.dof for joint in skeleton.joint for motion in (*joint.translate, *joint.rotate)}
    if joints and parents <= joints and moved <= dofs:
        Skeleton(skeleton)
    return skeleton


def _fields(kind: type) -> set[str]:
    return {schema.written_name(field.name) for field in dataclasses.fields(kind)} - {"blocks"}


def _other_kinds() -> list[type]:
    kinds = [kind for kind in vars(messages).values() if isinstance(kind, type) and dataclasses.is_dataclass(kind)]
    return [*kinds, *options.option_blocks().values()]
