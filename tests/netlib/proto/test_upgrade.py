"""Nets in Caffe's older formats equal the same net in today's format, from text and from bytes."""

from __future__ import annotations

import logging
from typing import Any

import numpy as np
import pytest

from netlib.errors import PrototxtError
from netlib.proto import binaryproto, prototxt, schema, wire
from netlib.proto.messages import NetParameter
from netlib.proto.upgrade import AnyNetParameter, upgraded
from netlib.snapshots import binary_format
from tests.support.bad_input import bad_inputs

TODAY = """
    name: "n" input: "x" input_shape { dim: 1 dim: 2 }
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            param { name: "w" share_mode: PERMISSIVE lr_mult: 1 decay_mult: 1 } param { lr_mult: 2 decay_mult: 0 }
            convolution_param { num_output: 4 bias_term: false pad: 2 kernel_size: 5 group: 2 stride: 1 } }
    layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { pool: AVE kernel_size: 3 stride: 2 } }
    layer { name: "l" type: "SoftmaxWithLoss" bottom: "p" bottom: "y" top: "l" include { phase: TRAIN } loss_weight: 2 }
"""
V1 = """
    name: "n" input: "x" input_shape { dim: 1 dim: 2 }
    layers { name: "c" type: CONVOLUTION bottom: "x" top: "c"
             param: "w" blob_share_mode: PERMISSIVE blobs_lr: 1 blobs_lr: 2 weight_decay: 1 weight_decay: 0
             convolution_param { num_output: 4 bias_term: false pad: 2 kernel_size: 5 group: 2 stride: 1 } }
    layers { name: "p" type: POOLING bottom: "c" top: "p" pooling_param { pool: AVE kernel_size: 3 stride: 2 } }
    layers { name: "l" type: SOFTMAX_LOSS bottom: "p" bottom: "y" top: "l" include { phase: TRAIN } loss_weight: 2 }
"""
V0 = """
    name: "n" input: "x" input_dim: 1 input_dim: 2 input_dim: 5 input_dim: 5
    layers { layer { name: "pad" type: "padding" pad: 2 } bottom: "x" top: "padded" }
    layers { layer { name: "c" type: "conv" num_output: 4 biasterm: false kernelsize: 5 group: 2 stride: 1
                     blobs_lr: 1 blobs_lr: 2 weight_decay: 1 weight_decay: 0 } bottom: "padded" top: "c" }
    layers { layer { name: "p" type: "pool" pool: AVE kernelsize: 3 stride: 2 } bottom: "c" top: "p" }
    layers { layer { name: "r" type: "relu" } bottom: "p" top: "p" }
    layers { layer { name: "d" type: "data" source: "db" batchsize: 4 scale: 0.5 meanfile: "m" cropsize: 3
                     mirror: true rand_skip: 2 } top: "d" }
    layers { layer { name: "i" type: "images" source: "s" batchsize: 4 shuffle_images: true new_height: 3 } top: "i" }
"""
V0_TODAY = """
    name: "n" input: "x" input_dim: 1 input_dim: 2 input_dim: 5 input_dim: 5
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            param { lr_mult: 1 decay_mult: 1 } param { lr_mult: 2 decay_mult: 0 }
            convolution_param { num_output: 4 bias_term: false kernel_size: 5 group: 2 stride: 1 pad: 2 } }
    layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { pool: AVE kernel_size: 3 stride: 2 } }
    layer { name: "r" type: "ReLU" bottom: "p" top: "p" }
    layer { name: "d" type: "Data" top: "d" data_param { source: "db" batch_size: 4 rand_skip: 2 }
            transform_param { scale: 0.5 mean_file: "m" crop_size: 3 mirror: true } }
    layer { name: "i" type: "ImageData" top: "i"
            image_data_param { source: "s" batch_size: 4 shuffle: true new_height: 3 } }
"""


def net(text: str) -> NetParameter:
    return schema.read(upgraded(prototxt.parse(text)), NetParameter)


def plain(text: str) -> NetParameter:
    return schema.read(prototxt.parse(text), NetParameter)


def by_bytes(text: str) -> prototxt.Message:
    """Return the net after a round trip through the binary format."""
    data = wire.encode(prototxt.parse(text), AnyNetParameter)
    return upgraded(wire.decode(data, AnyNetParameter))


@pytest.mark.parametrize(("old", "today"), [(V1, TODAY), (V0, V0_TODAY), (TODAY, TODAY)], ids=["V1", "V0", "today"])
def test_an_old_net_is_the_net_of_today(old: str, today: str) -> None:
    """Types, rates, decays, sharing, rules, options, padding layers and data transformations are upgraded."""
    assert net(old) == plain(today)
    assert wire.encode(by_bytes(old), NetParameter) == wire.encode(prototxt.parse(today), NetParameter)


def test_data_options_of_2014_go_to_transform_param() -> None:
    """Transformation options of the old Data layer move to transform_param."""
    old = 'layers { type: DATA top: "d" data_param { source: "s" batch_size: 1 scale: 2 mirror: true crop_size: 5 } }'
    today = """layer { type: "Data" top: "d" data_param { source: "s" batch_size: 1 }
               transform_param { scale: 2 mirror: true crop_size: 5 } }"""
    assert net(old) == plain(today)


def test_batch_norm_with_three_parameters() -> None:
    """Older nets declare BatchNorm's three statistics as parameters; their multipliers become 0."""
    old = 'layer { type: "BatchNorm" param { lr_mult: 1 name: "m" } param { } param { decay_mult: 3 } }'
    still = "lr_mult: 0 decay_mult: 0"
    fixed = f'layer {{ type: "BatchNorm" param {{ name: "m" {still} }} param {{ {still} }} param {{ {still} }} }}'
    assert net(old) == plain(fixed)
    two = 'layer { type: "BatchNorm" param { lr_mult: 1 } param { } }'
    assert net(two) == plain(two)


def test_what_a_type_does_not_have_is_dropped_with_a_note(caplog: pytest.LogCaptureFixture) -> None:
    """An option that its layer type lacks is dropped with a note, as in Caffe."""
    caplog.set_level(logging.WARNING, "netlib")
    assert net('layers { layer { name: "r" type: "relu" kernelsize: 3 } top: "r" }').layer[0].blocks == {}
    assert caplog.messages == ["<text>:1:41: 'kernelsize' does not apply to a layer of type 'relu'; dropped"]


@pytest.mark.parametrize(("of_padding", "of_layer", "pad"), [("pad: 2", "pad: 0", (2,)), ("", "pad: 2", ())])
@pytest.mark.parametrize("kind", ["conv", "pool"])
def test_padding_layers_take_the_place_of_a_pad(
    kind: str, of_padding: str, of_layer: str, pad: tuple[int, ...]
) -> None:
    """The pad of a padding layer replaces the layer's own pad, as in Caffe."""
    found = net(
        f'layers {{ layer {{ name: "pad" type: "padding" {of_padding} }} bottom: "x" top: "p" }}'
        f'layers {{ layer {{ name: "c" type: "{kind}" kernelsize: 3 {of_layer} }} bottom: "p" top: "c" }}'
    )
    [layer] = found.layer
    [block] = layer.blocks.values()
    assert tuple(int(value.text) for value in block.values("pad")) == pad  # type: ignore[union-attr]


@bad_inputs(PrototxtError, {
    'layers { type: RELU } layer { type: "ReLU" }':
        "<text>:1:1: error: this net has both 'layer' and 'layers' (Caffe's V1 format); expected one of them",
    "layers { type: POOLIN }": "<text>:1:16: error: unknown value POOLIN of 'type' (did you mean 'POOLING'?)",
    'layers { type: "InnerProduct" }':
        "<text>:1:16: error: 'type' expects a name without quotes, found ... (did you mean 'INNER_PRODUCT'?)",
    "layers { type: PRELU }": "<text>:1:16: error: unknown value PRELU of 'type'; known values: NONE, ACCURACY, ...",
    "layers { blob_lr: 1 }": "<text>:1:10: error: unknown field 'blob_lr' (did you mean 'blobs_lr'?)",
    "layers: 1": "<text>:1:1: error: 'layers' is a message: expected layers { ... }, found 1",
    'layers { layer { type: "conf" } }': "<text>:1:16: error: unknown V0 layer type 'conf' (did you mean 'conv'?)",
    'layers { layer { type: "padding" } }': "<text>:1:8: error: a padding layer has one bottom and one top",
    'layers { layer { type: "padding" } bottom: "x" top: "p" } layers { layer { type: "relu" } bottom: "p" }':
        "<text>:1:66: error: a layer of type 'relu' reads 'p' of a padding layer; expected a conv or pool layer ...",
})
def test_mistakes_point_at_the_old_text(given: str, rejected: Any) -> None:
    """Errors have the line and column of the original text."""
    with rejected:
        net(given)


@pytest.mark.parametrize(
    "text", ['layer { name: "a" %s }', 'layers { name: "a" %s }', 'layers { layer { name: "a" type: "relu" %s } }']
)
def test_weights_of_every_format(text: str) -> None:
    """Weights of V0, V1 and today's .caffemodel files are read."""
    blob = str(binaryproto.tree_of(np.float32([[1, 2, 3]])))
    data = wire.encode(prototxt.parse(text % f"blobs {{ {blob} }}"), AnyNetParameter)
    assert binary_format.read_weights(data, "x")["a"][0].tolist() == [[1, 2, 3]]
