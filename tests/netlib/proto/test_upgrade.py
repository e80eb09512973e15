"""Nets in Caffe's older formats equal the same net in today's format, from text and from bytes."""

from __future__ import annotations

from typing import Any

import pytest

from netlib.errors import PrototxtError, WeightsError
from netlib.proto import prototxt, schema, wire
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


def net(text: str) -> NetParameter:
    return schema.read(upgraded(prototxt.parse(text)), NetParameter)


def plain(text: str) -> NetParameter:
    return schema.read(prototxt.parse(text), NetParameter)


def by_bytes(text: str) -> prototxt.Message:
    """Return the net after a round trip through the binary format."""
    data = wire.encode(prototxt.parse(text), AnyNetParameter)
    return upgraded(wire.decode(data, AnyNetParameter))


@pytest.mark.parametrize(("old", "today"), [(V1, TODAY), (TODAY, TODAY)], ids=["V1", "today"])
def test_an_old_net_is_the_net_of_today(old: str, today: str) -> None:
    assert net(old) == plain(today)
    assert wire.encode(by_bytes(old), NetParameter) == wire.encode(
        prototxt.parse(today), NetParameter
    )


def test_data_options_of_2014_go_to_transform_param() -> None:
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


AGE = (
    "this net is in Caffe's format of 2013 (V0); convert it by Caffe 1.0's upgrade_net_proto_text or "
    "upgrade_net_proto_binary"
)


@bad_inputs(
    PrototxtError,
    {
        'layers { type: RELU } layer { type: "ReLU" }': (
            "<text>:1:1: error: this net has both 'layer' and 'layers' (Caffe's V1 format); "
            "expected one of them"
        ),
        "layers { type: POOLIN }": "<text>:1:16: error: unknown value POOLIN of 'type' (did you mean 'POOLING'?)",
        'layers { type: "InnerProduct" }': (
            "<text>:1:16: error: 'type' expects a name without quotes, found ... (did you mean "
            "'INNER_PRODUCT'?)"
        ),
        "layers { type: PRELU }": "<text>:1:16: error: unknown value PRELU of 'type' (the layer PReLU "
        'needs the current format: layer { type: "PReLU" ... })',
        "layers { type: CROP }": "<text>:1:16: error: unknown value CROP of 'type' (the layer Crop needs the current "
        'format: layer { type: "Crop" ... })',
        "layers { blob_lr: 1 }": "<text>:1:10: error: unknown field 'blob_lr' (did you mean 'blobs_lr'?)",
        "layers: 1": "<text>:1:1: error: 'layers' is a message: expected layers { ... }, found 1",
        'layers { layer { name: "a" type: "relu" } bottom: "x" top: "x" }': f"<text>:1:8: error: {AGE}",
    },
)
def test_mistakes_point_at_the_old_text(given: str, rejected: Any) -> None:
    with rejected:
        net(given)


def test_a_binary_file_of_2013_is_refused() -> None:
    data = b"\x12\x07\x0a\x05\x0a\x01a\x12\x00"  # layers { layer { name: "a" type: "" } }
    with pytest.raises(PrototxtError, match=r"format of 2013 \(V0\)"):
        upgraded(wire.decode(data, AnyNetParameter))
    with pytest.raises(WeightsError, match=r"format of 2013 \(V0\)"):
        binary_format.read_weights(data, "x")
