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

from netlib.errors import NetlibError, did_you_mean, some_of
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, NetState
from netlib.proto.net_parameter import load_parameter, select_layers
from netlib.proto.options import layer_types
from tools.common.commands import command
from tools.common.deploy_inputs import DeployInput, Shape

STAGE = "deploy"  # of the layers that DIGITS puts into deploy nets only
# What SSD's scripts write after the layers of its loss, MultiBoxLoss; options with their defaults
SSD_DEFAULTS = {
    "num_classes": "21",
    "share_location": "true",
    "background_label_id": "0",
    "code_type": "CORNER",
}
DETECTIONS = """
layer {{ name: "mbox_conf_reshape" type: "Reshape" bottom: "{confidences}" top: "mbox_conf_reshape"
        reshape_param {{ shape {{ dim: 0 dim: -1 dim: {num_classes} }} }} }}
layer {{ name: "mbox_conf_softmax" type: "Softmax" bottom: "mbox_conf_reshape" top: "mbox_conf_softmax"
        softmax_param {{ axis: 2 }} }}
layer {{ name: "mbox_conf_flatten" type: "Flatten" bottom: "mbox_conf_softmax" top: "mbox_conf_flatten"
        flatten_param {{ axis: 1 }} }}
layer {{ name: "detection_out" type: "DetectionOutput" top: "detection_out"
        bottom: "{locations}" bottom: "mbox_conf_flatten" bottom: "{priors}"
        detection_output_param {{
          num_classes: {num_classes} share_location: {share_location} background_label_id: {background_label_id}
          code_type: {code_type} keep_top_k: 200 confidence_threshold: 0.01
          nms_param {{ nms_threshold: 0.45 top_k: 400 }} }} }}
"""
# Types with parameters; what they compute may be a prediction. Types that are unknown here may
# have some, too.
LEARNED = {
    "BatchNorm", "Bias", "BN", "Convolution", "ConvolutionDepthwise", "Deconvolution", "DepthwiseConvolution", "Embed",
    "InnerProduct", "LSTM", "Normalize", "PReLU", "Parameter", "Python", "RNN", "Scale",
}  # fmt: skip


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
    for spec in _readers(model):
        where = schema.position_of(spec, "type")
        raise NetlibError(
            f"{where}: this is a training net: layer {spec.name!r} of type {spec.type} reads the data; "
            f"expected a deploy net; {deploy_command(model)} writes it"
        )


def _readers(model: str) -> list[LayerParameter]:
    """The layers that read the data, in phase TEST or, if nothing makes them there, in TRAIN.

    In a net with inputs, DummyData are constants.
    """
    param = load_parameter(model)
    layers = select_layers(param, NetState("TEST"))
    if any(spec.type == "Input" for spec in layers):
        return [spec for spec in layers if _reads_data(spec) and spec.type != "DummyData"]
    found = [spec for spec in layers if _reads_data(spec)]
    return found or [spec for spec in param.layer if _reads_data(spec)]


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
    parts = _parts(param, model)
    kept = _kept(parts, *_predictions(parts, model))
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


# ----------------------------------------------------------------------------- parts of the net


def _reads_data(spec: LayerParameter) -> bool:
    return (
        not spec.bottom
        and spec.type != "Input"
        and (spec.type.endswith("Data") or spec.type == "Python")
    )


def _is_loss(spec: LayerParameter) -> bool:
    return "Loss" in spec.type or any(spec.loss_weight)


def _is_score(spec: LayerParameter) -> bool:
    return spec.type.endswith(("Accuracy", "Evaluate", "Evaluation", "HDF5Output"))


@dataclass(frozen=True)
class _Parts:
    """The parts of a training net.

    readers  the layers that make the data and the labels
    body     the other layers of phase TEST without losses and scores, and without what reads or
             computes labels
    ends     the losses and scores of any phase
    heads    what reads predictions: the main losses, or if there is none the scores, and the layers
             that compare predictions with labels
    labels   names of the blobs that only losses and scores read
    """

    readers: Sequence[LayerParameter]
    body: Sequence[LayerParameter]
    ends: Sequence[LayerParameter]
    heads: Sequence[LayerParameter]
    labels: set[str]


def _parts(param: NetParameter, model: str) -> _Parts:
    """Divide a net into its parts. Raises NetlibError if it is not a training net."""
    chosen = _chosen(param)
    losses = [spec for spec in param.layer if _is_loss(spec)]
    scores = [spec for spec in param.layer if _is_score(spec)]
    readers = _distinct_readers(param, chosen)
    if not losses and not scores and not any(map(_reads_data, readers)):
        raise NetlibError(
            f"{model}: this is a deploy net already: it has no layer for data, losses or scores"
        )
    if not readers:
        raise NetlibError(
            f"{model}: no layer reads data; expected a training net, with a data layer"
        )
    inner = [spec for spec in chosen if not (_is_source(spec) or _is_loss(spec) or _is_score(spec))]
    ends = [*losses, *scores]
    labels = _labels(readers, inner, ends)
    body: list[LayerParameter] = []
    heads = [spec for spec in losses if not _is_auxiliary(spec, losses)] or [*scores]
    for spec in inner:
        if not labels.intersection(spec.bottom):
            body.append(spec)
        elif labels.issuperset(spec.bottom):
            labels.update(spec.top)  # what is computed from labels alone are labels
        elif spec.type != "Silence":
            heads.append(spec)
    return _Parts(readers, body, ends, heads, labels)


def _is_source(spec: LayerParameter) -> bool:
    return _reads_data(spec) or spec.type == "Input"


def _distinct_readers(
    param: NetParameter, chosen: Sequence[LayerParameter]
) -> list[LayerParameter]:
    """The readers of phase TEST, or if there is none those of any phase; of several stages'
    readers of the same blobs the first.
    """
    in_test = [spec for spec in chosen if _is_source(spec)]
    readers: dict[tuple[str, ...], LayerParameter] = {}
    for reader in in_test or [spec for spec in param.layer if _reads_data(spec)]:
        readers.setdefault(reader.top, reader)
    return list(readers.values())


def _labels(
    readers: Sequence[LayerParameter],
    inner: Sequence[LayerParameter],
    ends: Sequence[LayerParameter],
) -> set[str]:
    """Tops of readers from which the targets of losses and scores are computed
    without parameters.

    The first top of a reader is none if parameters are applied to it, as in an autoencoder.
    """
    tops = [name for reader in readers for name in reader.top]
    sources = {name: {name} for name in tops}  # blob -> tops that it is computed from

    def together(names: Iterable[str]) -> set[str]:
        return set[str]().union(*(sources.get(name, set()) for name in names))

    for spec in inner:
        sources.update(dict.fromkeys(spec.top, together(spec.bottom)))
    learned = _learned(inner)
    used = together(learned)
    of_targets = together({name for spec in ends for name in spec.bottom} - learned)
    first = {reader.top[0] for reader in readers if reader.top}
    by_name = {name for name in tops if name.startswith("label")}
    return (of_targets - (first & used)) | (by_name - first)


def _is_auxiliary(loss: LayerParameter, losses: Sequence[LayerParameter]) -> bool:
    """Whether a loss of the same type on the same labels has a larger weight, as in GoogLeNet."""
    alike = [
        other for other in losses if (other.type, other.bottom[1:]) == (loss.type, loss.bottom[1:])
    ]
    return _weight(loss) < max(map(_weight, alike))


def _kept(
    parts: _Parts, outputs: Iterable[str], added: Sequence[LayerParameter]
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
    parts: _Parts, kept: Sequence[LayerParameter], model: str
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


# -------------------------------------------------------------------------------------- predictions


def _predictions(parts: _Parts, model: str) -> tuple[list[str], list[LayerParameter]]:
    """Names of the blobs with predictions, and the layers that have to be added for them: those
    that turn scores into probabilities or detections.

    Raises NetlibError.
    """
    read = {name for spec in (*parts.body, *parts.ends, *parts.heads) for name in spec.bottom}
    outputs = [name for spec in parts.body for name in spec.top if name not in read]
    added: list[LayerParameter] = []
    for head in parts.heads:
        if head.type == "MultiBoxLoss":
            added += _detection_layers(head)
            outputs.append(added[-1].top[0])
    predicted = _predicted(parts)
    if not predicted and not outputs:
        raise NetlibError(
            f"{model}: no loss, score or output of phase TEST tells what the net predicts"
        )
    is_single = sum(map(bool, predicted.values())) == 1
    for name, kind in predicted.items():
        if not kind:
            outputs.append(name)
            continue
        made = [spec for spec in parts.body if (spec.type, spec.bottom) == (kind, (name,))]
        if not made:
            made = [_probability_layer(parts, name, kind, "prob" if is_single else f"{name}_prob")]
            added += made
        outputs.append(made[0].top[0])
    return outputs, added


def _predicted(parts: _Parts) -> dict[str, str]:
    """The blobs that the heads read as predictions, with the type of the layer that makes
    probabilities of each; empty if none does.
    """
    made = {name for spec in parts.body for name in spec.top}
    learned = _learned(parts.body)
    predicted: dict[str, str] = {}
    for head in parts.heads:
        if head.type == "MultiBoxLoss":
            continue
        names = [name for name in head.bottom if name in learned] or head.bottom[:1]
        for name in names:
            if name in made:
                kind = _probability(head) if name == head.bottom[0] else ""
                predicted[name] = predicted.get(name) or kind
    return predicted


def _detection_layers(head: LayerParameter) -> tuple[LayerParameter, ...]:
    """The layers of SSD's deploy nets in the place of its loss, as its scripts write them; the last
    one makes the detections.
    """
    locations, confidences, priors = head.bottom[:3]
    given = head.blocks.get("multibox_loss_param", prototxt.parse(""))
    options = {name: given.text(name) or default for name, default in SSD_DEFAULTS.items()}
    names = {"locations": locations, "confidences": confidences, "priors": priors}
    return schema.read(prototxt.parse(DETECTIONS.format(**names, **options)), NetParameter).layer


def _probability_layer(parts: _Parts, name: str, kind: str, top: str) -> LayerParameter:
    """A layer of this type that reads a blob; its top is called ``top``, or the next free name."""
    taken = {other for spec in parts.body for other in (spec.name, *spec.top)}
    while top in taken:
        top += "_"
    head = next(head for head in parts.heads if head.bottom[:1] == (name,))
    block = f"{kind.lower()}_param"
    own = {block: head.blocks[block]} if block in head.blocks else {}
    return LayerParameter(name=top, type=kind, bottom=(name,), top=(top,), blocks=own)


def _probability(head: LayerParameter) -> str:
    """The type of the layer that makes probabilities of what a loss reads: the loss of both is
    usually one layer.
    """
    if not _is_loss(head):
        return ""
    if head.type == "InfogainLoss" or "Softmax" in head.type:
        return "Softmax"
    return "Sigmoid" if "Sigmoid" in head.type else ""


# ------------------------------------------------------------------------------------------ layers


def _chosen(param: NetParameter) -> list[LayerParameter]:
    """The layers of phase TEST: in DIGITS' stage for deploy nets, or else in the first stage
    without missing blobs.
    """
    rules = [rule for spec in param.layer for rule in (*spec.include, *spec.exclude)]
    stages = dict.fromkeys(stage for rule in rules for stage in (*rule.stage, *rule.not_stage))
    tried: list[tuple[str, ...]] = [(), *((stage,) for stage in stages)]
    if STAGE in stages:
        tried = [(STAGE,)]
    choices = [select_layers(param, NetState("TEST", stage=names)) for names in tried]
    return next((layers for layers in choices if _is_complete(layers)), choices[0])


def _is_complete(layers: Sequence[LayerParameter]) -> bool:
    """Whether all blobs are made before they are read."""
    made: set[str] = set()
    for spec in layers:
        if not made.issuperset(spec.bottom):
            return False
        made.update(spec.top)
    return True


def _learned(body: Sequence[LayerParameter]) -> set[str]:
    """Blobs that depend on parameters."""
    learned: set[str] = set()
    for spec in body:
        if (
            spec.type in LEARNED
            or spec.type not in layer_types()
            or learned.intersection(spec.bottom)
        ):
            learned.update(spec.top)
    return learned


def _weight(loss: LayerParameter) -> float:
    return abs(loss.loss_weight[0]) if loss.loss_weight else 1.0


def _for_deployment(spec: LayerParameter) -> LayerParameter:
    """The layer without rules, and with the statistics of the training instead of
    those of the batch.
    """
    blocks = dict(spec.blocks)
    options = blocks.get("batch_norm_param")
    if options is not None and options.text("use_global_stats") == "false":
        blocks["batch_norm_param"] = options.without("use_global_stats")
    options = blocks.get("bn_param")
    if options is not None and options.text("bn_mode") == "LEARN":
        options = options.without("bn_mode")
        options.fields.extend(prototxt.parse("bn_mode: INFERENCE").fields)
        blocks["bn_param"] = options
    rules = {"include": (), "exclude": (), "phase": None, "loss_weight": (), "propagate_down": ()}
    made = dataclasses.replace(spec, blocks=blocks, **rules)  # type: ignore[arg-type]
    tree = schema.tree_of(spec)
    return schema.placed(made, tree and tree.without(*rules))
