"""A classifier's deploy net for other classes: the net to train, with frozen layers, and the
net to deploy.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from netlib.errors import NetlibError, did_you_mean
from netlib.net import Net
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter, ParamSpec
from netlib.proto.prototxt import Message

# types of the last layer
HEADS = {"InnerProduct": "inner_product_param", "Convolution": "convolution_param"}
# those that may follow it
AFTER = {"Softmax", "Pooling", "ReLU", "Dropout", "Flatten", "Reshape", "Power", "Split"}
NEW_RATE = 10  # of the new layer, relative to that of the others
LOSSES = """layer {{ name: "loss" type: "SoftmaxWithLoss" bottom: "{logits}" bottom: "label" top: "loss" }}
layer {{
  name: "accuracy" type: "Accuracy" bottom: "{logits}" bottom: "label" top: "accuracy" include {{ phase: TEST }}
}}
"""


class NewClasses:
    """The nets for ``count`` classes.

    net     a deploy net with one input and one output, a probability for each class
    head    name of its last layer with weights, which is replaced
    name    name of the new layer, so that old weights are not copied to it
    logits  name of the blob before the Softmax

    Raises NetlibError for a net of another form.
    """

    def __init__(self, net: Net, count: int) -> None:
        _check_one_output(net)
        self._net = net
        self._count = count
        self._head_index = _last_with_weights(net)
        self.head = net.layers[self._head_index].name
        self.name = _free_name(net, f"{self.head}_new")
        self._body = [layer.spec for layer in net.layers]  # without the Softmax at the end
        self.logits = net.outputs[0]
        if self._body[-1].type == "Softmax":
            self.logits = self._body.pop().bottom[0]
        self._check_classes()

    def _check_classes(self) -> None:
        """Raise NetlibError if the new layer's outputs are not those of the net."""
        output = self._net.outputs[0]
        shape = Net(self.deploy()).blobs[output].shape
        if shape[1:2] != (self._count,) or any(size > 1 for size in shape[2:]):
            raise NetlibError(
                f"{self._net.source}: with {self._count} classes in layer {self.head!r} the output "
                f"{output!r} has shape {shape}; expected (N, {self._count})"
            )

    def deploy(self) -> NetParameter:
        """The net that classifies images."""
        layers = tuple(map(self._renewed, self._net.param.layer))
        return schema.changed(self._net.param, layer=layers)

    def training(self, data: str, frozen: Sequence[str]) -> NetParameter:
        """The net to train.

        data    text of the layers that make the blobs ``net.inputs[0]`` and ``label``
        frozen  names of the layers whose parameters stay as they are
        """
        (image,) = self._net.inputs
        reader = _layers(data)  # in the place of the Input layer
        body = [spec for spec in self._body if spec.bottom or image not in spec.top]
        body = [self._fixed(spec) if spec.name in frozen else spec for spec in body]
        body = [self._renewed(_with_statistics(spec)) for spec in body]
        losses = _layers(LOSSES.format(logits=self.logits))
        return schema.changed(self._net.param, layer=(*reader, *body, *losses))

    def frozen(self, last: str) -> list[str]:
        """The layers with parameters before the new one: ``all``, ``none``, or those up to a layer.

        Raises NetlibError.
        """
        layers = self._net.layers[: self._head_index]
        ends = {layer.name: number for number, layer in enumerate(layers, 1)}
        meant = did_you_mean(last, ends)
        ends |= {"none": 0, "all": len(layers)}
        if last not in ends:
            raise NetlibError(
                f"{self._net.source}: there is no layer {last!r} before {self.head!r}{meant}"
            )
        return [layer.name for layer in layers[: ends[last]] if layer.blobs]

    def _renewed(self, spec: LayerParameter) -> LayerParameter:
        """The layer; in the place of the head the new one."""
        if spec.name != self.head:
            return spec
        block = HEADS[spec.type]
        options = _with(spec.blocks[block], "num_output", f"num_output: {self._count}")
        options = _with(options, "weight_filler", 'weight_filler { type: "xavier" }')
        weights = ParamSpec(lr_mult=NEW_RATE, decay_mult=1)
        bias = ParamSpec(lr_mult=2 * NEW_RATE, decay_mult=0)
        params = (weights, bias)[: len(self._net.params[self.head])]
        blocks = {**spec.blocks, block: options}
        return schema.changed(spec, name=self.name, param=params, blocks=blocks)

    def _fixed(self, spec: LayerParameter) -> LayerParameter:
        """The layer with parameters that are not trained."""
        count = len(self._net.params[spec.name])
        given = (*spec.param, *[ParamSpec()] * count)[:count]
        fixed = tuple(schema.changed(one, lr_mult=0.0, decay_mult=0.0) for one in given)
        return schema.changed(spec, param=fixed)


def _check_one_output(net: Net) -> None:
    """Raise NetlibError for a net with several outputs, or none."""
    if len(net.outputs) != 1:
        raise NetlibError(
            f"{net.source}: the net has the outputs {', '.join(net.outputs) or 'none'}; expected "
            "one, the probabilities of the classes; delete the layers of the others from a copy"
        )


def _last_with_weights(net: Net) -> int:
    """The index of the last layer with weights.

    Raises NetlibError for one that cannot be replaced, or that is not at the end of a classifier.
    """
    specs = [layer.spec for layer in net.layers]
    with_weights = [i for i, layer in enumerate(net.layers) if layer.blobs]
    if not with_weights or specs[with_weights[-1]].type not in HEADS:
        found = "there is none"
        if with_weights:
            last = specs[with_weights[-1]]
            found = f"{last.name!r} has the type {last.type}"
        raise NetlibError(
            f"{net.source}: the last layer with weights: {found}; expected {' or '.join(HEADS)}"
        )
    at = with_weights[-1]
    for spec in specs[at + 1 :]:
        if spec.type not in AFTER:
            raise NetlibError(
                f"{net.source}: layer {spec.name!r} of type {spec.type} follows the last layer with "
                "weights; expected a classifier, which ends in a Softmax"
            )
    return at


def _free_name(net: Net, name: str) -> str:
    """A name that no layer of the net has: this one, if need be with a number."""
    names = (f"{name}{number or ''}" for number in itertools.count())
    return next(name for name in names if name not in net.layer_dict)


def _layers(text: str) -> tuple[LayerParameter, ...]:
    """The layers of a net's text."""
    return schema.read(prototxt.parse(text), NetParameter).layer


def _with_statistics(spec: LayerParameter) -> LayerParameter:
    """A BatchNorm that keeps its mean and variance; they would follow the new pictures too slowly
    for phase TEST.
    """
    if spec.type != "BatchNorm":
        return spec
    options = spec.blocks.get("batch_norm_param", prototxt.parse(""))
    options = _with(options, "use_global_stats", "use_global_stats: true")
    return schema.changed(spec, blocks={**spec.blocks, "batch_norm_param": options})


def _with(options: Message, name: str, text: str) -> Message:
    """Options with another value of a field, as ``text`` has it."""
    fields = [*prototxt.parse(text).fields, *options.without(name).fields]
    return Message(fields, options.position)
