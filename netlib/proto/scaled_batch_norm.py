"""BatchNorm with a scale and a bias of its own, as in NVIDIA's and Intel's Caffe, as a
BatchNorm and a Scale.

    layer { name: "bn" type: "BatchNorm" bottom: "x" top: "y"
            batch_norm_param { scale_bias: true } }

NVIDIA's option is ``scale_bias``, which a filler of either also sets; Intel's is
``use_weight_bias``.
"""

from __future__ import annotations

from collections.abc import Iterable

from netlib.proto import prototxt
from netlib.proto.prototxt import Field, Message, Scalar

OPTIONS = {"scale_bias", "use_weight_bias", "bias_term", "scale_filler", "filler", "bias_filler"}
_FILLERS = {
    "scale_filler": "filler",
    "filler": "filler",
    "bias_filler": "bias_filler",
}  # -> those of Scale
_STATISTICS = 3  # parameters of BatchNorm


def separated(layer: Message, taken: Iterable[str]) -> list[Message]:
    """The layer, or in its place a BatchNorm and a Scale, whose name is not one of ``taken``."""
    block = next((item for item in layer.fields if item.name == "batch_norm_param"), None)
    if layer.text("type") != "BatchNorm" or block is None or not isinstance(block.value, Message):
        return [layer]
    options = block.value.named(*OPTIONS)
    if not any(_asks_for_scale(item) for item in options):
        return [layer]
    norm = layer.without("param", block.name)
    norm.fields.append(Field(block.name, block.value.without(*OPTIONS), block.position))
    return [norm, _scale(layer, options, layer.named("param"), set(taken))]


def _asks_for_scale(item: Field) -> bool:
    return isinstance(item.value, Message) or (
        isinstance(item.value, Scalar) and item.value.truth() is True
    )


def _scale(layer: Message, options: list[Field], rates: list[Field], taken: set[str]) -> Message:
    """The Scale, in place on the top of the BatchNorm.

    rates  the ``param`` of the layer: of mean, variance, factor, scale and bias, or in older
           versions of scale and bias first
    """
    place = layer.position
    name = f"{layer.text('name')}_scale"
    while name in taken:
        name += "_"
    fillers = [
        Field(_FILLERS[item.name], item.value, place) for item in options if item.name in _FILLERS
    ]
    own = rates[_STATISTICS:] if len(rates) in (_STATISTICS, _STATISTICS + 2) else rates[:2]
    top = layer.text("top")
    words = {"name": name, "type": "Scale", "bottom": top, "top": top}
    fields = [Field(key, Scalar("string", word, place), place) for key, word in words.items()]
    fields += own
    fields += layer.named("include", "exclude", "phase")
    bias = prototxt.parse("bias_term: true").fields
    fields.append(Field("scale_param", Message([*bias, *fillers], place), place))
    return Message(fields, place)
