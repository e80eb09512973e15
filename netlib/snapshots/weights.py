"""Copying and sharing weights between nets and files, by layer name."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from netlib.blob import Array, Blob, Blobs
from netlib.errors import LayerError, WeightsError, some_of
from netlib.files import Content
from netlib.files.paths import find
from netlib.graph import Graph
from netlib.layer import TRAIN, Layer
from netlib.proto import schema
from netlib.proto.messages import LayerParameter
from netlib.proto.schema import Phase
from netlib.snapshots import binary_format, hdf5_format, snapshot
from netlib.snapshots.solver_state import Weights

log = logging.getLogger("netlib")
Found = Mapping[str, Mapping[int, Array]]  # layer name -> parameter index -> array
Writes = list[tuple[Array, Array]]  # pairs of an array of the net and its new values


def owned(net: Graph) -> Weights:
    """Weights of all layers: name -> parameter index -> array.

    A shared parameter is listed only with its owner.
    """
    own = {(p.layer, p.index) for p in net.learnable}
    return {
        name: {i: blob.data for i, blob in enumerate(layer.blobs) if (name, i) in own}
        for name, layer in net.layer_dict.items()
    }


def image(net: Graph, path: str | Path, diffs: bool = False) -> bytes:
    """Content of a weights file: HDF5 if ``path`` ends in ``.h5``, else Caffe's binary format.

    The binary format also holds the layers themselves, each shared parameter in all its layers,
    and, with ``diffs``, the gradients. Raises WeightsError if the format cannot store them.
    """
    if snapshot.is_hdf5(path):
        return hdf5_format.weights_image(net.name, owned(net))
    layers = [
        (_complete_spec(layer), [(b.data, b.diff if diffs else None) for b in layer.blobs])
        for layer in net.layer_dict.values()
    ]
    return binary_format.weights_image(net.name, layers)


def _complete_spec(layer: Layer) -> LayerParameter:
    """The layer's options with the phase and the default loss weight filled in, as Caffe does."""
    phase: Phase = "TRAIN" if layer.phase == TRAIN else "TEST"
    default = layer.default_loss_weight
    weight = layer.spec.loss_weight or ((default,) if default else ())
    return schema.changed(layer.spec, phase=phase, loss_weight=weight)


def copy(
    net: Graph, source: str | Path | Content | Graph, strict: bool = False
) -> tuple[list[str], list[str]]:
    """Copy weights by layer name from a snapshot or another net: ``Net.copy_from``."""
    writes, ignored, missing = fitting(net, source, strict)
    write(writes)
    return ignored, missing


def write(writes: Writes) -> None:
    """Perform the copies; they cannot fail."""
    for target, array in writes:
        target[...] = array


def fitting(
    net: Graph, source: str | Path | Content | Graph, strict: bool
) -> tuple[Writes, list[str], list[str]]:
    """Plan a copy: the writes, and what ``copy`` returns.

    A net is never partially copied. Raises WeightsError.
    """
    what, found = _weights_of(source)
    found = _without_scales(net, found, what)
    ignored = [name for name, arrays in found.items() if name not in net.layer_dict and arrays]
    shared = {name: arrays for name, arrays in found.items() if name in net.layer_dict and arrays}
    known = some_of([name for name, arrays in found.items() if arrays]) or "no layers"
    if not shared and net.params:
        raise WeightsError(
            f"{what}: it has no layer of net {net.name!r}; it has {known}, "
            f"the net has {some_of(net.params)}"
        )
    own: dict[str, list[int]] = {}
    for param in net.learnable:
        own.setdefault(param.layer, []).append(param.index)
    missing_layers = [name for name in own if name not in shared]
    if strict and missing_layers:
        raise WeightsError(
            f"{what}: no weights for layer {missing_layers[0]!r} of net {net.name!r}; it has {known}"
        )
    writes: Writes = []
    for name, arrays in shared.items():
        writes += _writes(name, net.layer_dict[name].blobs, own.get(name, []), arrays, what)
    return writes, ignored, missing_layers


def _weights_of(source: str | Path | Content | Graph) -> tuple[str, Found]:
    """A description of the source, and its arrays: layer name -> parameter index -> array."""
    if isinstance(source, (str, Path)):
        source = find(str(source), None)
    if isinstance(source, (Path, Content)):
        return str(source), snapshot.read_weights(source)
    return f"net {source.name!r}", {
        n: {i: b.data for i, b in enumerate(p)} for n, p in source.params.items()
    }


def _without_scales(net: Graph, found: Found, what: str) -> Found:
    """The arrays with the five of a BatchNorm of NVIDIA's or Intel's Caffe given to a BatchNorm and
    the Scale after it.

    Raises WeightsError if the net has no such Scale.
    """
    result = dict(found)
    for name, arrays in found.items():
        norm = net.layer_dict.get(name)
        if norm is None or norm.type != "BatchNorm":
            continue
        if set(arrays) == set(range(5)):
            result |= _separated(net, norm, [arrays[i].reshape(-1) for i in range(5)], found, what)
        elif set(arrays) == set(range(3)) and not arrays[2].any() and arrays[1].any():
            log.warning(
                "%s: layer %r: the factor is 0, so as in Caffe mean and variance count as 0; NVIDIA's Caffe uses them "
                "as they are: set parameter 2 to 1 for that", what, name,
            )  # fmt: skip
    return result


def _separated(net: Graph, norm: Layer, five: Sequence[Array], found: Found, what: str) -> Found:
    """The parameters of a BatchNorm and the Scale after it.

    five  mean, variance, factor, scale and bias, or in older files scale, bias, mean, variance and
          factor. NVIDIA's mean and variance are no sums, and its factor is 1 or 0
    """
    scale = _scale_after(net, norm)
    if scale is None:
        raise WeightsError(
            f"{what}: layer {norm.name!r} has 5 parameters, as a BatchNorm of NVIDIA's or Intel's Caffe with a scale "
            "and a bias of its own; the net expects 3: give the layer batch_norm_param { scale_bias: true }, or add a "
            "layer Scale with bias_term: true after it"
        )
    if five[4].size == 1 < five[0].size:  # older
        five = [*five[2:], *five[:2]]
    mean, variance, factor, gain, bias = five
    if outer := list(found.get(scale.name, {}).values()):  # Intel's nets have both
        gain, bias = outer[0] * gain, outer[0] * bias + outer[-1]
    return {
        norm.name: {0: mean, 1: variance, 2: np.where(factor == 0, 1, factor).astype(factor.dtype)},
        scale.name: {0: gain, 1: bias},
    }


def _scale_after(net: Graph, norm: Layer) -> Layer | None:
    """The Scale with a gain and a bias for each channel that alone reads the top of a BatchNorm;
    None if none does.
    """
    layers = list(net.layer_dict.values())
    for layer in layers[layers.index(norm) + 1 :]:
        if norm.spec.top[0] in layer.spec.bottom:
            shapes = [blob.shape for blob in layer.blobs]
            fits = layer.type == "Scale" and shapes == [norm.blobs[0].shape] * 2
            return layer if fits else None
    return None


def _writes(
    name: str, target: Blobs, own: list[int], found: Mapping[int, Array], what: str
) -> Writes:
    """Plan the writes of one layer. Raises WeightsError if a shape or number differs.

    own  the parameters that the layer does not share with an earlier one
    """
    missing = [i for i in own if i not in found]
    if missing:
        raise WeightsError(
            f"{what}: layer {name!r} lacks parameter {missing[0]}, the net has {len(own)}"
        )
    writes = []
    for i, array in found.items():
        if i >= len(target):
            raise WeightsError(
                f"{what}: layer {name!r} has {len(found)} parameters, the net expects {len(target)}"
            )
        shaped = legacy_shape(array, target[i].shape)
        if shaped.shape != target[i].shape:
            raise WeightsError(
                f"{what}: layer {name!r} parameter {i} has shape {array.shape}, "
                f"the net expects {target[i].shape}; a layer that is to be trained anew needs another name"
            )
        writes.append((target[i].data, shaped))
    return writes


def legacy_shape(array: Array, shape: tuple[int, ...]) -> Array:
    """Reshape weights and histories with leading ones: Caffe wrote four axes before N-d blobs,
    other programs two.
    """
    if array.shape == (1,) * (array.ndim - len(shape)) + shape:
        return array.reshape(shape)
    return array


def share(net: Graph, other: Graph) -> None:
    """Share the other net's parameters, by layer name, all or none: ``Net.share_params``."""
    pairs: list[tuple[Blob, Blob]] = []
    for name in (name for name in other.params if name in net.params):
        mine, theirs = net.params[name], other.params[name]
        shapes, others = ([blob.shape for blob in blobs] for blobs in (mine, theirs))
        if shapes != others:
            raise LayerError(
                f"layer {name!r} has parameters {shapes} in net {net.source}, {others} in "
                f"{other.source}"
            )
        if mine.dtype != theirs.dtype:
            raise LayerError(
                f"layer {name!r} is in {mine.dtype} in net {net.source}, in {theirs.dtype} in "
                f"{other.source}; expected the same dtype"
            )
        pairs += zip(mine, theirs)
    for blob, owner in pairs:
        blob.share_data(owner)
