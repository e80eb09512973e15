"""The parts of a training net: what reads the data, what computes predictions, and what compares
these with labels.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from netlib.errors import NetlibError
from netlib.proto.messages import LayerParameter, NetParameter, NetState
from netlib.proto.net_parameter import select_layers
from netlib.proto.options import layer_types

STAGE = "deploy"  # of the layers that DIGITS puts into deploy nets only
# Types with parameters; what they compute may be a prediction. Types that are unknown here may
# have some, too.
LEARNED = {
    "BatchNorm", "Bias", "BN", "Convolution", "ConvolutionDepthwise", "Deconvolution", "DepthwiseConvolution", "Embed",
    "InnerProduct", "LSTM", "Normalize", "PReLU", "Parameter", "Python", "RNN", "Scale",
}  # fmt: skip


def reads_data(spec: LayerParameter) -> bool:
    """Whether a layer reads data or makes some, as a layer of type Python may."""
    return (
        not spec.bottom
        and spec.type != "Input"
        and (spec.type.endswith("Data") or spec.type == "Python")
    )


def is_loss(spec: LayerParameter) -> bool:
    """Whether a layer is a loss, by its type or its weight."""
    return "Loss" in spec.type or any(spec.loss_weight)


def _is_score(spec: LayerParameter) -> bool:
    return spec.type.endswith(("Accuracy", "Evaluate", "Evaluation", "HDF5Output"))


@dataclass(frozen=True)
class Parts:
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


def parts_of(param: NetParameter, model: str) -> Parts:
    """Divide a net into its parts. Raises NetlibError if it is not a training net."""
    chosen = _chosen(param)
    losses = [spec for spec in param.layer if is_loss(spec)]
    scores = [spec for spec in param.layer if _is_score(spec)]
    readers = _distinct_readers(param, chosen)
    if not losses and not scores and not any(map(reads_data, readers)):
        raise NetlibError(
            f"{model}: this is a deploy net already: it has no layer for data, losses or scores"
        )
    if not readers:
        raise NetlibError(
            f"{model}: no layer reads data; expected a training net, with a data layer"
        )
    inner = [spec for spec in chosen if not (_is_source(spec) or is_loss(spec) or _is_score(spec))]
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
    return Parts(readers, body, ends, heads, labels)


def _is_source(spec: LayerParameter) -> bool:
    return reads_data(spec) or spec.type == "Input"


def _distinct_readers(
    param: NetParameter, chosen: Sequence[LayerParameter]
) -> list[LayerParameter]:
    """The readers of phase TEST, or if there is none those of any phase; of several stages'
    readers of the same blobs the first.
    """
    in_test = [spec for spec in chosen if _is_source(spec)]
    readers: dict[tuple[str, ...], LayerParameter] = {}
    for reader in in_test or [spec for spec in param.layer if reads_data(spec)]:
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
    learned = learned_blobs(inner)
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


def learned_blobs(body: Sequence[LayerParameter]) -> set[str]:
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
