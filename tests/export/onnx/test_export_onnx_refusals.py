"""Every mistake in a call of tools/export_onnx.py gives one line."""

import re
import sys
from pathlib import Path

import pytest

from export.onnx.net import LAYERS
from tests.support.onnx_nets import NYU, net_text
from tests.support.running import refusal, run_tool


def refused(net: object, weights: str, *more: str, out: str = "out.onnx") -> str:
    """Return the single line that the tool prints before it writes anything."""
    return refusal("export_onnx", net, weights, out, *more)


@pytest.mark.parametrize("kind", ["EuclideanLoss", "Filter", "LSTM"])
def test_a_type_without_a_form(kind, files):
    """A layer type without an ONNX form is reported with its layer and line, before any
    data is opened.
    """
    _, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    Path("loss.prototxt").write_text(
        net_text(f'layer {{ name: "bad" type: "{kind}" top: "y" }}', (1, 3))
    )
    assert refused("loss.prototxt", weights) == (
        f"loss.prototxt:3:21: error: layer 'bad': type '{kind}' cannot be exported to ONNX (docs/onnx.md); "
        "expected a deploy net, without layers for data, labels and losses"
    )


@pytest.mark.parametrize(
    ("layers", "shapes", "message"),
    [
        (
            'layer { name: "r" type: "Reshape" bottom: "x0" top: "y" reshape_param { shape { dim: 1 dim: 4 } } }',
            [(1, 4)],
            "net.prototxt:3:73: error: layer 'r': cannot give 8 values (2, 4) the shape (1, 4) (with 2 "
            "items); expected a net that accepts any number",
        ),
        (
            'layer { name: "s" type: "Slice" bottom: "x0" top: "y" top: "z" slice_param { axis: 0 slice_point: 1 } }',
            [(2, 4)],
            "net.prototxt:3:7: error: layer 's': shape [(1, 4), (1, 4)] for 2 items, [(1, 4), (2, 4)] for 3 "
            "cannot be exported to ONNX; expected one axis that depends on the number of items",
        ),
        (
            'layer { name: "m" type: "ArgMax" bottom: "x0" top: "y" argmax_param { axis: 0 } }',
            [(1, 4)],
            "net.prototxt:3:7: error: layer 'm': ArgMax along the batch axis cannot be exported to ONNX; shape (N)",
        ),
        (
            'layer { name: "b" type: "BatchNorm" bottom: "x0" top: "y" batch_norm_param { use_global_stats: false } }',
            [(1, 4)],
            "net.prototxt:3:78: error: layer 'b': use_global_stats: false makes items depend on their batch; "
            "expected true or no value",
        ),
        (
            'layer { name: "a" type: "ReLU" bottom: "x0" top: "x0" }',
            [(1, 4)],
            "net.prototxt: blob 'x0' is both input and output, which ONNX does not support; expected a layer "
            "that reads it, with another top, or no such input",
        ),
        (
            'layer { name: "a" type: "Silence" bottom: "x0" }',
            [(1, 4)],
            "net.prototxt: no layer leaves a blob unread, so the net has no output; name one (--blob)",
        ),
        (
            'layer { name: "a" type: "Concat" bottom: "x0" bottom: "x1" top: "y" concat_param { axis: 0 } }',
            [(1, 4), (2, 4)],
            "net.prototxt: inputs with different batch sizes, x0 (1, 4), x1 (2, 4); expected first axes "
            "of the same size",
        ),
    ],
)
def test_a_net_without_a_batch(layers, shapes, message, files):
    """Every blob must have N items at most once, and cannot be both input and output."""
    assert refused(*files(layers, *shapes)) == message


def test_an_opset_that_is_too_old_for_an_operator(files):
    """The error names the layer, its operator and the opset that it needs; a net without such
    operators is written.
    """
    net, weights = files('layer { name: "s" type: "Upsample" bottom: "x0" top: "y" }', (1, 1, 2, 3))
    assert refused(net, weights, "--opset", "11") == (
        "layer 's' needs the operator Resize of opset 13, found opset 11; expected --opset 13 or more"
    )
    assert (
        "expected an integer of at most 17"
        in run_tool("export_onnx", net, weights, "out.onnx", "--opset", "18", status=2).err
    )
    net, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    run_tool("export_onnx", net, weights, "out.onnx", "--opset", "11", "--check")


def test_invalid_files_and_blobs_are_refused(files):
    net, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    assert (
        refused("no.prototxt", weights)
        == "no.prototxt: cannot read the prototxt: No such file or directory"
    )
    assert "no.caffemodel.h5" in refused(net, "no.caffemodel.h5")
    assert refused(NYU, weights).startswith("net.caffemodel.h5: it has no layer of net 'DeepModel'")
    assert (
        refused(net, weights, "--blob", "yy") == "net 'small' has no blob 'yy' (did you mean 'y'?)"
    )
    no_folder = refused(net, weights, out="no/out.onnx")
    assert no_folder == "no/out.onnx: cannot write the file: No such file or directory"
    for out in (net, weights):
        assert (
            refused(net, weights, out=out) == f"{out}: is read in this run; expected another output"
        )


def test_no_input(files):
    _, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    Path("net.prototxt").write_text(
        'layer { name: "a" type: "Input" top: "x" }'
        'layer { name: "b" type: "AbsVal" bottom: "x" top: "y" }'
    )
    assert refused("net.prototxt", weights) == (
        "net.prototxt: input 'x' has no shape; expected input_param { shape { ... } }"
    )


@pytest.mark.parametrize(("missing", "more"), [("onnx", []), ("onnxruntime", ["--check"])])
def test_a_missing_package(missing, more, files, monkeypatch):
    net, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    monkeypatch.setitem(sys.modules, missing, None)
    done = run_tool("export_onnx", net, weights, "out.onnx", *more, status=1)
    assert done.err == f"{missing} is missing: pip install onnx onnxruntime\n"


def test_a_difference_fails(files, monkeypatch):
    net, weights = files(
        'layer { name: "a" type: "Power" bottom: "x0" top: "y" power_param { scale: 2 } }', (1, 3)
    )
    monkeypatch.setitem(LAYERS, "Power", LAYERS["AbsVal"])
    _, out, err = run_tool("export_onnx", net, weights, "out.onnx", "--check", status=1)
    assert re.search(
        r"^y: largest difference 1\.5e\+00 of its largest value \(float32 rounding: \d\.\de.\d\d\), "
        r"batch sizes 1 and 3$",
        out,
        re.MULTILINE,
    )
    assert err.startswith(
        "out.onnx: blob 'y': onnxruntime's values differ by 1.5e+00 of the largest value; expected "
    )
