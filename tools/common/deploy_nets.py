"""A deploy net from a training net: its layers of phase TEST between the data and the losses.

train_val.prototxt                       deploy.prototxt
Data            -> data, label           Input -> data
...                                      ...
InnerProduct    fc8                      InnerProduct    fc8
SoftmaxWithLoss fc8, label -> loss       Softmax         fc8 -> prob
Accuracy        fc8, label -> accuracy
"""

from __future__ import annotations

import dataclasses
import shlex
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from layers.normalization.bn import SEGNET
from netlib.errors import NetlibError, did_you_mean, some_of
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, NetState
from netlib.proto.net_parameter import load_parameter, select_layers
from netlib.proto.options import layer_types
from netlib.proto.prototxt import Message
from tools.common.commands import command
from tools.common.deploy_inputs import DeployInput, Shape
from tools.common.deploy_predictions import predictions_of
from tools.common.training_parts import Parts, parts_of, reads_data


@dataclass(frozen=True)
class DeployNet:
    """A deploy net, and comments for its file: where it comes from, and how its images
    were transformed.
    """

    param: NetParameter
    comments: list[str]


def refuse_training_net(model: str) -> None:
    """Raise NetlibError if the net reads its data in phase TEST, with the command that
    writes a deploy net.
    """
    readers = _readers(model)
    if readers:
        where = schema.position_of(readers[0], "type")
        raise NetlibError(
            f"{where}: this is a training net: layer {readers[0].name!r} of type {readers[0].type} reads "
            f"the data; expected a deploy net; {deploy_command(model)} writes it"
        )


def _readers(model: str) -> list[LayerParameter]:
    """The layers that read the data, in phase TEST or, if nothing makes them there, in TRAIN.

    In a net with inputs, DummyData are constants.
    """
    param = load_parameter(model)
    layers = select_layers(param, NetState("TEST"))
    if any(spec.type == "Input" for spec in layers):
        return [spec for spec in layers if reads_data(spec) and spec.type != "DummyData"]
    found = [spec for spec in layers if reads_data(spec)]
    return found or [spec for spec in param.layer if reads_data(spec)]


def deploy_command(model: str) -> str:
    """The command that writes the deploy net of a training net; empty for a net that does not read
    its data in phase TEST.
    """
    if not _readers(model):
        return ""
    return f"{command('deploy')} {shlex.quote(str(model))} deploy.prototxt"


def deploy_net(model: str, out: Path, shapes: Mapping[str, Shape]) -> DeployNet:
    """Make the deploy net for the file ``out``.

    ``shapes`` are those of inputs that neither the file nor its data tell. Raises NetlibError.
    """
    param = load_parameter(model)
    parts = parts_of(param, model)
    kept = _kept(parts, *predictions_of(parts, model))
    inputs = [DeployInput(reader, top) for reader, top in _inputs(parts, kept, model)]
    names = [one.name for one in inputs]
    if unknown := set(shapes) - set(names):
        raise NetlibError(f"{model}: there is no input {min(unknown)!r}{did_you_mean(min(unknown), names)}; its "
                          f"inputs: {', '.join(names)}")  # fmt: skip
    layers = [one.layer(shapes.get(one.name)) for one in inputs]
    layers += [_for_deployment(spec) for spec in kept]
    deployed = NetParameter(name=param.name, layer=tuple(layers))
    comments = [f"The deploy net of {Path(model).name}."]
    for one in inputs:
        comments += one.comments(out)
    unchecked = [spec for spec in kept if spec.type == "Python" or spec.type not in layer_types()]
    if unchecked:
        others = some_of(f"{spec.name!r} ({spec.type})" for spec in unchecked)
        comments.append(f"Not built here, because of layers of other programs: {others}")
    else:
        Net(deployed)  # raises an error if the shapes do not fit
    return DeployNet(deployed, comments)


def _kept(
    parts: Parts, outputs: Iterable[str], added: Sequence[LayerParameter]
) -> list[LayerParameter]:
    """The layers that the outputs depend on."""
    needed = set(outputs)
    kept: list[LayerParameter] = []
    for spec in reversed([*parts.body, *added]):
        if needed.intersection(spec.top):
            kept.append(spec)
            needed.update(spec.bottom)
    made = {name for spec in kept for name in spec.top}
    silent = [
        spec for spec in parts.body if spec.type == "Silence" and made.issuperset(spec.bottom)
    ]
    return [*reversed(kept), *silent]


def _inputs(
    parts: Parts, kept: Sequence[LayerParameter], model: str
) -> list[tuple[LayerParameter, int]]:
    """The readers' tops that these layers read: reader and index of the top.

    Raises NetlibError.
    """
    for spec in kept:
        for name in spec.bottom:
            if name in parts.labels:
                raise NetlibError(f"{model}: layer {spec.name!r} reads the labels {name!r}")
    needed = {name for spec in kept for name in spec.bottom}
    return [
        (reader, i)
        for reader in parts.readers
        for i, name in enumerate(reader.top)
        if name in needed
    ]


def _for_deployment(spec: LayerParameter) -> LayerParameter:
    """The layer without rules, and with the statistics of the training instead of
    those of the batch.
    """
    blocks = dict(spec.blocks)
    options = blocks.get("batch_norm_param")
    if options is not None and options.truth("use_global_stats") is False:
        blocks["batch_norm_param"] = options.without("use_global_stats")
    options = blocks.get("bn_param")
    if options is not None and _learns_statistics(options):
        options = options.without("bn_mode")
        options.fields.extend(prototxt.parse("bn_mode: INFERENCE").fields)
        blocks["bn_param"] = options
    rules = {"include": (), "exclude": (), "phase": None, "loss_weight": (), "propagate_down": ()}
    made = dataclasses.replace(spec, blocks=blocks, **rules)  # type: ignore[arg-type]
    tree = schema.tree_of(spec)
    return schema.placed(made, tree and tree.without(*rules))


def _learns_statistics(options: Message) -> bool:
    """Whether a BN is of SegNet's fork and uses the statistics of the batch, as it does by default.

    PSPNet's fork has no mode: in phase TEST it uses the statistics of the training.
    """
    return bool(options.named(*SEGNET)) and options.text("bn_mode") not in ("INFERENCE", "1")
