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
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from netlib.errors import DataError, LayerError, NetlibError, PrototxtError, did_you_mean
from netlib.files.paths import find
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.binaryproto import read_blob
from netlib.proto.messages import LayerParameter, NetParameter, NetState
from netlib.proto.net_parameter import load_parameter, select_layers
from netlib.proto.options import layer_types
from netlib.proto.prototxt import Message, Scalar
from tools.common.commands import command

Shape = tuple[int, ...]

STAGE = "deploy"  # of the layers that DIGITS puts into deploy nets only
COLORS = 3
# Pairs of options of readers with the height and the width of their images, in the
# order of precedence
SIZES = (
    ("crop_size", "crop_size"), ("crop_height", "crop_width"), ("crop_h", "crop_w"), ("new_height", "new_width"),
    ("height", "width"),
)  # fmt: skip
MAX_NAMED = 3  # layers in a comment
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
            f"expected a deploy net; {advice(model)} writes it"
        )


def is_training_net(model: str) -> bool:
    """Whether the net reads its data in phase TEST."""
    return bool(_readers(model))


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


def advice(model: str) -> str:
    """The command that writes the deploy net of a training net."""
    return f"{command('deploy')} {shlex.quote(str(model))} deploy.prototxt"


def deploy_net(model: str, out: Path, shapes: Mapping[str, Shape]) -> DeployNet:
    """Make the deploy net for the file ``out``.

    ``shapes`` are those of inputs that neither the file nor its data tell. Raises NetlibError.
    """
    param = load_parameter(model)
    found = _Parts(param, model)
    kept = found.kept()
    inputs = [_Input(reader, top) for reader, top in found.inputs(kept)]
    names = [one.name for one in inputs]
    if unknown := set(shapes) - set(names):
        raise NetlibError(f"{model}: there is no input {min(unknown)!r}{did_you_mean(min(unknown), names)}; its "
                          f"inputs: {', '.join(names)}")  # fmt: skip
    layers = [one.layer(shapes.get(one.name)) for one in inputs] + [
        _for_deployment(spec) for spec in kept
    ]
    deployed = NetParameter(name=param.name, layer=tuple(layers))
    comments = [line for one in inputs for line in one.comments(out)]
    unchecked = [spec for spec in kept if spec.type == "Python" or spec.type not in layer_types()]
    if unchecked:
        others = ", ".join(f"{spec.name!r} ({spec.type})" for spec in unchecked[:MAX_NAMED])
        more = " ..." if len(unchecked) > MAX_NAMED else ""
        comments.append(f"Not built here, because of layers of other programs: {others}{more}")
    else:
        Net(deployed)  # raises an error if the shapes do not fit
    return DeployNet(deployed, [f"The deploy net of {Path(model).name}.", *comments])


# -------------------------------------------------------------------------------- layers of the net


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


class _Parts:
    """The parts of a training net.

    readers  the layers that make the data and the labels
    body     the other layers of phase TEST without losses and scores, and without what reads or
             computes labels
    heads    the losses, or if there is none the scores, of any phase
    labels   names of the blobs that only losses and scores read
    """

    def __init__(self, param: NetParameter, model: str) -> None:
        self._model = model
        chosen = _chosen(param)
        in_test = [spec for spec in chosen if _reads_data(spec) or spec.type == "Input"]
        readers = in_test or [spec for spec in param.layer if _reads_data(spec)]
        firsts: dict[
            tuple[str, ...], LayerParameter
        ] = {}  # there may be one for each of several stages
        for reader in readers:
            firsts.setdefault(reader.top, reader)
        self.readers = list(firsts.values())
        losses, scores = (
            [spec for spec in param.layer if test(spec)] for test in (_is_loss, _is_score)
        )
        if not losses and not scores and not any(map(_reads_data, self.readers)):
            raise NetlibError(
                f"{model}: this is a deploy net already: it has no layer for data, losses or scores"
            )
        if not self.readers:
            raise NetlibError(
                f"{model}: no layer reads data; expected a training net, with a data layer"
            )
        ends = {id(spec) for spec in (*losses, *scores, *readers)}
        body = [spec for spec in chosen if id(spec) not in ends]
        self.labels = self._labels([*losses, *scores], body)
        self._ends = [*losses, *scores]
        self.heads = [spec for spec in losses if not self._is_auxiliary(spec, losses)] or scores
        self.body = self._without_labels(body)
        self._added: list[LayerParameter] = []

    def _labels(self, ends: Sequence[LayerParameter], body: Sequence[LayerParameter]) -> set[str]:
        """Tops of readers from which the targets of losses and scores are computed
        without parameters.

        The first top of a reader is none if parameters are applied to it, as in an autoencoder.
        """
        tops = [(i, name) for reader in self.readers for i, name in enumerate(reader.top)]
        sources = {name: {name} for _, name in tops}  # blob -> tops that it is computed from

        def together(names: Iterable[str]) -> set[str]:
            return set[str]().union(*(sources.get(name, set()) for name in names))

        for spec in body:
            sources.update(dict.fromkeys(spec.top, together(spec.bottom)))
        learned = _learned(body)
        used = together(learned)
        of_targets = together({name for spec in ends for name in spec.bottom} - learned)
        first = {name for i, name in tops if i == 0}
        by_name = {name for _, name in tops if name.startswith("label")}
        return (of_targets - (first & used)) | (by_name - first)

    def _is_auxiliary(self, loss: LayerParameter, losses: Sequence[LayerParameter]) -> bool:
        """Whether a loss of the same type on the same labels has a larger weight,
        as in GoogLeNet.
        """
        others = [
            other
            for other in losses
            if (other.type, other.bottom[1:]) == (loss.type, loss.bottom[1:])
        ]
        return _weight(loss) < max(map(_weight, others))

    def _without_labels(self, body: Sequence[LayerParameter]) -> list[LayerParameter]:
        """The layers that read no labels.

        What they compute from labels alone are labels; else they are heads.
        """
        result = []
        for spec in body:
            if not self.labels.intersection(spec.bottom):
                result.append(spec)
            elif self.labels.issuperset(spec.bottom):
                self.labels.update(spec.top)
            elif spec.type != "Silence":
                self.heads.append(spec)
        return result

    def kept(self) -> list[LayerParameter]:
        """The layers that the predictions depend on, and those that turn scores into
        probabilities.
        """
        outputs = self._outputs()
        needed, kept = set(outputs), list[LayerParameter]()
        for spec in reversed([*self.body, *self._added]):
            if needed.intersection(spec.top):
                kept.append(spec)
                needed.update(spec.bottom)
        made = {name for spec in kept for name in spec.top}
        silent = [
            spec for spec in self.body if spec.type == "Silence" and made.issuperset(spec.bottom)
        ]
        return [*reversed(kept), *silent]

    def inputs(self, kept: Sequence[LayerParameter]) -> Iterator[tuple[LayerParameter, int]]:
        """The readers' tops that these layers read: reader and index of the top.

        Raises NetlibError.
        """
        made = {name for reader in self.readers for name in reader.top}
        needed = dict.fromkeys(name for spec in kept for name in spec.bottom)
        for spec in kept:
            missing = [name for name in spec.bottom if name in self.labels]
            if missing:
                raise NetlibError(
                    f"{self._model}: layer {spec.name!r} reads the labels {missing[0]!r}"
                )
        for reader in self.readers:
            yield from (
                (reader, i) for i, name in enumerate(reader.top) if name in needed and name in made
            )

    def _outputs(self) -> list[str]:
        """Names of the blobs with predictions; adds a Softmax or Sigmoid to ``_added``.

        Raises NetlibError.
        """
        made = {name for spec in self.body for name in spec.top}
        read = {name for spec in self.body for name in spec.bottom}
        read |= {name for spec in (*self._ends, *self.heads) for name in spec.bottom}
        learned = _learned(self.body)
        leaves = [name for spec in self.body for name in spec.top if name not in read]
        found: dict[str, str] = {}  # prediction -> type of the layer that makes probabilities of it
        for head in self.heads:
            if head.type == "MultiBoxLoss":
                leaves.append(self._detections(head))
                continue
            predicted = [name for name in head.bottom if name in learned] or list(head.bottom[:1])
            for name in predicted:
                if name in made:
                    found.setdefault(name, "")
                    found[name] = found[name] or (
                        _probability(head) if name == head.bottom[0] else ""
                    )
        if not found and not leaves:
            raise NetlibError(
                f"{self._model}: no loss, score or output of phase TEST tells what the net predicts"
            )
        outputs = list(leaves)
        for name, kind in found.items():
            outputs.append(
                self._probabilities(name, kind, len([k for k in found.values() if k]))
                if kind
                else name
            )
        return outputs

    def _detections(self, head: LayerParameter) -> str:
        """The top of the DetectionOutput layer for SSD's loss, as its scripts write it; adds the
        layers before it.
        """
        locations, confidences, priors = head.bottom[:3]
        given = head.blocks.get("multibox_loss_param", prototxt.parse(""))
        options = {name: _text(given, name) or default for name, default in SSD_DEFAULTS.items()}
        names = {"locations": locations, "confidences": confidences, "priors": priors}
        layers = schema.read(
            prototxt.parse(DETECTIONS.format(**names, **options)), NetParameter
        ).layer
        self._added += layers
        return layers[-1].top[0]

    def _probabilities(self, name: str, kind: str, count: int) -> str:
        """The top of the layer of this type that reads a blob; it is added if there is none."""
        for spec in self.body:
            if spec.type == kind and spec.bottom == (name,):
                return spec.top[0]
        taken = {other for spec in self.body for other in (spec.name, *spec.top)}
        top = "prob" if count == 1 else f"{name}_prob"
        while top in taken:
            top += "_"
        blocks = next(
            (head.blocks for head in self.heads if head.bottom and head.bottom[0] == name), {}
        )
        own = {block: tree for block, tree in blocks.items() if block == f"{kind.lower()}_param"}
        self._added.append(
            LayerParameter(name=top, type=kind, bottom=(name,), top=(top,), blocks=own)
        )
        return top


def _chosen(param: NetParameter) -> list[LayerParameter]:
    """The layers of phase TEST: in DIGITS' stage for deploy nets, or else in the first stage
    without missing blobs.
    """
    rules = [rule for spec in param.layer for rule in (*spec.include, *spec.exclude)]
    stages = list(
        dict.fromkeys(stage for rule in rules for stage in (*rule.stage, *rule.not_stage))
    )
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


def _probability(head: LayerParameter) -> str:
    """The type of the layer that makes probabilities of what a loss reads: the loss of both is
    usually one layer.
    """
    if not _is_loss(head):
        return ""
    if head.type == "InfogainLoss" or "Softmax" in head.type:
        return "Softmax"
    return "Sigmoid" if "Sigmoid" in head.type else ""


def _for_deployment(spec: LayerParameter) -> LayerParameter:
    """The layer without rules, and with the statistics of the training instead of
    those of the batch.
    """
    blocks = dict(spec.blocks)
    if spec.type == "BatchNorm" and "batch_norm_param" in blocks:
        blocks["batch_norm_param"] = _without(
            blocks["batch_norm_param"], "use_global_stats", "false"
        )
    if spec.type == "BN" and _text(blocks.get("bn_param"), "bn_mode") == "LEARN":
        mode = prototxt.parse("bn_mode: INFERENCE").fields
        blocks["bn_param"] = Message(
            [*_without(blocks["bn_param"], "bn_mode", "LEARN").fields, *mode], mode[0].position
        )
    rules = {"include": (), "exclude": (), "phase": None, "loss_weight": (), "propagate_down": ()}
    made = dataclasses.replace(spec, blocks=blocks, **rules)  # type: ignore[arg-type]
    return schema.placed(made, _tree_without(schema.tree_of(spec), set(rules)))


def _tree_without(tree: Message | None, names: set[str]) -> Message | None:
    return tree and Message([item for item in tree.fields if item.name not in names], tree.position)


def _without(options: Message, name: str, value: str) -> Message:
    """Options without a field of this value."""
    given = [item for item in options.fields if item.name == name]
    unwanted = [
        item for item in given if isinstance(item.value, Scalar) and item.value.text == value
    ]
    kept = [item for item in options.fields if item not in unwanted]
    return Message(kept, options.position)


def _text(options: Message | None, name: str) -> str:
    values = options.values(name) if options else []
    return next((value.text for value in values if isinstance(value, Scalar)), "")


# ------------------------------------------------------------------------------------------- inputs


class _Input:
    """An input in the place of the top of a reader.

    name       of the blob
    transform  the options of the reader's transform_param, with those of its own block
               for older nets
    """

    def __init__(self, reader: LayerParameter, index: int) -> None:
        self._reader, self._index = reader, index
        self.name = reader.top[index]
        own = [tree for block, tree in reader.blocks.items() if block != "transform_param"]
        self._blocks = [*(tree for tree in [reader.blocks.get("transform_param")] if tree), *own]

    def layer(self, given: Shape | None) -> LayerParameter:
        """The Input layer. Raises NetlibError if its shape is unknown."""
        dims = "".join(f" dim: {n}" for n in given or self._shape())
        block = prototxt.parse(f"shape {{{dims} }}")
        return LayerParameter(
            name=self.name, type="Input", top=(self.name,), blocks={"input_param": block}
        )

    def comments(self, out: Path) -> list[str]:
        """What the training did to images before the net read them, and the options of the command
        that repeats it.
        """
        reader = self._reader
        lines = [
            f"Input {self.name!r} is in the place of layer {reader.name!r} of type {reader.type}."
        ]
        transform = reader.blocks.get("transform_param")
        given = transform.fields if transform else []
        if given:
            text = "; ".join(
                " ".join(str(Message([item], item.position)).split()) for item in given
            )
            lines.append(f"Its images were transformed by: {text}")
        means, scale, file = (
            self._numbers("mean_value"),
            self._numbers("scale"),
            self._word("mean_file"),
        )
        options = [f"--mean {','.join(f'{mean:.9g}' for mean in means)}"] if means else []
        options += [f"--mean-file {shlex.quote(file)}"] if file else []
        options += [f"--scale {scale[0]:.9g}"] if scale else []
        if self._index == 0 and reader.type != "HDF5Data" and (options or given):
            run = f"{command('run_net')} {shlex.quote(str(out))} WEIGHTS IMAGE"
            lines.append(" ".join([f"Run it: {run}", *options]))
        return lines

    def _shape(self) -> Shape:
        """The shape of one item, from the data themselves, or else from the options.

        Raises NetlibError.
        """
        if self._reader.type in layer_types():
            try:
                reader = dataclasses.replace(self._reader, include=(), exclude=())
                net = Net(
                    NetParameter(layer=(schema.placed(reader, schema.tree_of(self._reader)),))
                )
                batch = 1 if self._reader.type != "Input" else net.blobs[self.name].shape[0]
                return (batch, *net.blobs[self.name].shape[1:])
            except (DataError, LayerError, PrototxtError):
                pass  # the data are not here, or in a format that only Caffe reads
        size = self._size()
        mean = self._mean_shape()
        if self._index > 0 or not (size or mean):
            raise NetlibError(
                f"{schema.position_of(self._reader)}: the shape of {self.name!r} is not in the prototxt, and its data "
                f"are not here; give it by --shape, for example --shape {self.name}=1,{self._channels(())},224,224"
            )
        return (1, self._channels(mean), *(size or mean[1:]))

    def _size(self) -> Shape:
        """Height and width from the options; empty if unknown."""
        for names in SIZES:
            found = [self._numbers(name) for name in names]
            if all(value and value[0] > 0 for value in found):
                return tuple(int(value[0]) for value in found)
        return ()

    def _mean_shape(self) -> Shape:
        """Channels, height and width of the mean image, if it is here."""
        name = self._word("mean_file")
        try:
            shape = (
                read_blob(find(name, schema.position_of(self._reader).source)).shape if name else ()
            )
        except NetlibError:
            return ()
        return shape[-3:]

    def _channels(self, mean: Shape) -> int:
        grey = self._word("is_color") == "false" or self._word("force_gray") == "true"
        if given := self._numbers("channels"):
            return int(given[0])
        return 1 if grey else mean[0] if mean else max(COLORS, len(self._numbers("mean_value")))

    def _numbers(self, name: str) -> list[float]:
        """The numbers of the first block with this option, also in messages inside it."""
        for block in self._blocks:
            for tree in (
                block,
                *(value for item in block.fields if isinstance(value := item.value, Message)),
            ):
                values = [value.text for value in tree.values(name) if isinstance(value, Scalar)]
                if values:
                    return [float(text.removesuffix("f")) for text in values]
        return []

    def _word(self, name: str) -> str:
        return next((text for block in self._blocks if (text := _text(block, name))), "")
