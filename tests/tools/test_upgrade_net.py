"""tools/upgrade_net.py: nets of all formats, in text and binary, and solvers."""

from __future__ import annotations

import numpy as np
import pytest

import netlib
from netlib.proto import binaryproto, prototxt, schema, wire
from netlib.proto.messages import NetParameter
from netlib.proto.upgrade import AnyNetParameter
from tests.support.running import refusal, run_tool

V1 = """
    name: "n" input: "x" input_shape { dim: 1 dim: 2 dim: 5 dim: 5 }
    layers { name: "c" type: CONVOLUTION bottom: "x" top: "c" blobs_lr: 1 blobs_lr: 2
             convolution_param { num_output: 4 kernel_size: 5 pad: 2 } }
    layers { name: "r" type: RELU bottom: "c" top: "c" }
"""
TODAY = """
    name: "n"
    layer { name: "input" type: "Input" top: "x" input_param { shape { dim: 1 dim: 2 dim: 5 dim: 5 } } }
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            convolution_param { num_output: 4 kernel_size: 5 pad: 2 } param { lr_mult: 1 } param { lr_mult: 2 } }
    layer { name: "r" type: "ReLU" bottom: "c" top: "c" }
"""


@pytest.mark.parametrize("old", [V1, TODAY], ids=["V1", "today"])
def test_a_text(here, old):
    """An upgraded net is written as a person would write it; one in the current
    format is reported.
    """
    (here / "old").write_text(old)
    _, out, err = run_tool("upgrade_net old new.prototxt")
    new = (here / "new.prototxt").read_text()
    assert sorted(new.splitlines()) == sorted(f"{prototxt.parse(TODAY)}".splitlines())
    assert (out, err) == (
        "wrote new.prototxt\n",
        "old: already in the current format\n" if old is TODAY else "",
    )
    run_tool("upgrade_net new.prototxt again")
    assert (here / "again").read_text() == new


def test_weights(here, rng):
    """A binary file stays binary, and its weights load into a net in the current format."""
    weights = [rng.normal(size=shape).astype(np.float32) for shape in ((4, 2, 5, 5), (4,))]
    blobs = " ".join(f"blobs {{ {binaryproto.tree_of(array)} }}" for array in weights)
    old = prototxt.parse(V1.replace("blobs_lr: 1", f"{blobs} blobs_lr: 1"))
    (here / "old.caffemodel").write_bytes(wire.encode(old, AnyNetParameter))
    run_tool("upgrade_net old.caffemodel new.caffemodel")
    new = schema.read(
        wire.decode((here / "new.caffemodel").read_bytes(), NetParameter), NetParameter
    )
    assert [layer.type for layer in new.layer] == ["Input", "Convolution", "ReLU"]
    net = netlib.Net(prototxt.parse(TODAY), "new.caffemodel", netlib.TEST)
    assert all(np.array_equal(blob.data, array) for blob, array in zip(net.params["c"], weights))


def test_fields_of_forks(here, caplog):
    """Fields that are unknown in Caffe's older formats are dropped with a warning."""
    (here / "old").write_bytes(b"\x12\x0e\x12\x01a\x1a\x01b\x22\x01r\x28\x12\xa0\x06\x07")
    run_tool("upgrade_net old new")
    assert (
        "old: byte 13: a field that is unknown in Caffe's older formats is dropped" in caplog.text
    )
    assert str(wire.decode((here / "new").read_bytes(), NetParameter)) == (
        'layer {\n  name: "r"\n  type: "ReLU"\n  bottom: "a"\n  top: "b"\n}\n'
    )


def test_inputs_without_shapes(here):
    """Inputs without shapes, in old weights, are dropped, as in Caffe."""
    tree = prototxt.parse('input: "x" layers { name: "r" type: RELU bottom: "x" top: "y" }')
    (here / "old").write_bytes(wire.encode(tree, AnyNetParameter))
    run_tool("upgrade_net old new")
    new = schema.read(wire.decode((here / "new").read_bytes(), NetParameter), NetParameter)
    assert (new.input, [layer.name for layer in new.layer]) == ((), ["r"])


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "base_lr: 0.5 solver_type: ADAGRAD max_iter: 9",
            'base_lr: 0.5\ntype: "AdaGrad"\nmax_iter: 9\n',
        ),
        ("solver_type: 1", 'type: "Nesterov"\n'),
        ('type: "Adam" base_lr: 0.5', 'type: "Adam"\nbase_lr: 0.5\n'),
    ],
)
def test_a_solver(here, old, new):
    """The enum solver_type becomes the string type; a solver in the current format is reported."""
    (here / "old").write_text(old)
    done = run_tool("upgrade_net --solver old new")
    assert (here / "new").read_text() == new
    assert done.err == ("old: already in the current format\n" if "solver_type" not in old else "")


@pytest.mark.parametrize(
    ("content", "flags", "message"),
    [
        (b"layers { type: CONVOLUTION\n num: 3 }", "", "old:2:2: error: unknown field 'num'"),
        (b'name: "n"', "", "old:1:1: error: this file has no layers; expected a net"),
        (b"net: 'a' base_lr: 1", "", "old:1:1: error: this is a solver; add --solver"),
        (b"\x12\xff", "", "old: byte 1: truncated"),
        (
            b"solver_type: SGD type: 'SGD'",
            "--solver",
            "old:1:1: error: found both solver_type and type",
        ),
        (b"layer { }", "--solver", "old:1:1: error: unknown field 'layer'"),
        *(
            (
                old.replace("kernel_size", "kernal_size").encode(),
                "",
                f"old:{at}: error: unknown field 'kernal_size' (did",
            )
            for old, at in ((V1, "4:48"), (TODAY, "5:47"))
        ),
    ],
)
def test_mistakes(here, content, flags, message):
    """Errors are one line with status 1, and no file is written; options are checked although no
    layer is built.
    """
    (here / "old").write_bytes(content)
    assert refusal(f"upgrade_net old new {flags}").startswith(message)


def test_unreadable_inputs_and_impossible_outputs_are_rejected(here):
    assert refusal("upgrade_net old new") == "old: cannot read the net: No such file or directory"
    (here / "old").write_text(V1)
    (here / "new").mkdir()
    assert refusal("upgrade_net old new") == "new: Is a directory"


def test_nets_of_forks_keep_their_options(here):
    """A binary net of forks is written back as it is, with the numbers of the fork, and a text
    with its options.
    """
    # interp_param { zoom_factor: 8 } as field 143
    interp = b"\xa2\x06\x10\x0a\x01i\x12\x06Interp\xfa\x08\x02\x18\x08"
    text = b'layer {\n  name: "c"\n  type: "Convolution"\n  convolution_param {\n    conv_algorithm: "auto"\n  }\n}\n'
    for net in (interp, text):
        (here / "old").write_bytes(net)
        run_tool("upgrade_net old new")
        assert (here / "new").read_bytes() == net
