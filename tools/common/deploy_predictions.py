"""The predictions of a training net, and the layers that make probabilities or detections of them
in its deploy net.
"""

from __future__ import annotations

from netlib.errors import NetlibError
from netlib.proto import prototxt, schema
from netlib.proto.messages import LayerParameter, NetParameter
from tools.common.training_parts import Parts, is_loss, learned_blobs

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


def predictions_of(parts: Parts, model: str) -> tuple[list[str], list[LayerParameter]]:
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


def _predicted(parts: Parts) -> dict[str, str]:
    """The blobs that the heads read as predictions, with the type of the layer that makes
    probabilities of each; empty if none does.
    """
    made = {name for spec in parts.body for name in spec.top}
    learned = learned_blobs(parts.body)
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


def _probability_layer(parts: Parts, name: str, kind: str, top: str) -> LayerParameter:
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
    if not is_loss(head):
        return ""
    if head.type == "InfogainLoss" or "Softmax" in head.type:
        return "Softmax"
    return "Sigmoid" if "Sigmoid" in head.type else ""
