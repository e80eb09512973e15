"""tools/export_onnx.py exports the paper's and the packaged network, and other runtimes compute
the same results.
"""

import json
import re
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

import netlib
from layers.hand.skeleton import load
from netlib.files.paths import ROOT
from tests.support.onnx_nets import NYU, SYNTHETIC, run_onnx
from tests.support.running import run_python, run_tool


def test_the_papers_network(here):
    netlib.Net(NYU, netlib.TEST, seed=3).save("net.caffemodel")
    out = run_tool("export_onnx", NYU, "net.caffemodel", "hand.onnx", "--check").out
    assert re.fullmatch(
        r"wrote hand\.onnx: 9\.\d\d MB\npred: largest difference \d\.\de-0[678] of its largest value "
        r"\(float32 rounding: \d\.\de-0\d\), batch sizes 1 and 3\n",
        out,
    )


@pytest.fixture(scope="module")
def packaged(tmp_path_factory):
    """Export the packaged network with the pose as a second output."""
    out = tmp_path_factory.mktemp("onnx") / "hand.onnx"
    weights = SYNTHETIC / "synthetic_hand.caffemodel.h5"
    run_tool("export_onnx", SYNTHETIC / "deploy.prototxt", weights, out, "--blob", "DoF")
    return out


def test_the_packaged_network(packaged, rng):
    """onnxruntime and OpenCV compute the same as netlib."""
    net = netlib.Net(
        SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5", netlib.TEST
    )
    for batch in (1, 3):
        depth = rng.uniform(-1, 1, (batch, 1, 128, 128)).astype(np.float32)
        found = run_onnx(packaged.read_bytes(), depth=depth)
        expected = net.forward(depth=depth, blobs=["DoF"])
        other = cv2.dnn.readNetFromONNX(str(packaged))
        other.setInput(depth, "depth")
        names = ["joints", "pred", "DoF"]
        for name, values in zip(names, other.forward(names)):
            assert_allclose(values, found[name], rtol=0, atol=1e-5)
            if name in expected:
                assert found[name].shape == expected[name].shape
                assert_allclose(found[name], expected[name], rtol=0, atol=1e-5)


def test_an_older_opset(packaged, here, onnx, rng):
    """The packaged network with opset 13 computes the same numbers, bit for bit."""
    weights = SYNTHETIC / "synthetic_hand.caffemodel.h5"
    run_tool(
        "export_onnx",
        SYNTHETIC / "deploy.prototxt",
        weights,
        "older.onnx",
        "--blob",
        "DoF",
        "--opset",
        "13",
    )
    model = onnx.load("older.onnx")
    assert ([opset.version for opset in model.opset_import], model.ir_version) == ([13], 7)
    depth = rng.uniform(-1, 1, (2, 1, 128, 128)).astype(np.float32)
    older, newer = (
        run_onnx(file.read_bytes(), depth=depth) for file in (Path("older.onnx"), packaged)
    )
    assert all(np.array_equal(older[name], newer[name]) for name in newer)


def test_metadata(packaged, onnx):
    model = onnx.load(packaged)
    about = {entry.key: entry.value for entry in model.metadata_props}
    assert json.loads(about.pop("joint_names")) == load().joint_names
    assert json.loads(about.pop("dof_names")) == load().dof_names
    assert about == {
        "producer": "handpose",
        "net": "SyntheticHand",
        "unit": "half-cubes",
        "cube_mm": "300",
        "axes": "x right, y up, z away",
        "input_range": "[-1, 1]",
    }
    assert (model.producer_name, model.graph.name, model.ir_version) == (
        "handpose",
        "SyntheticHand",
        8,
    )
    assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", 17)]


def test_the_file_is_plain_onnx(packaged, onnx):
    """ONNX's checker accepts all shapes, all operators are standard, the batch is N, and the hand's
    graph is small.
    """
    model = onnx.load(packaged)
    onnx.checker.check_model(model, full_check=True)
    assert {node.domain for node in model.graph.node} == {""}
    shapes = [
        [d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
        for value in [*model.graph.input, *model.graph.output]
    ]
    assert shapes == [["N", 1, 128, 128], ["N", 93], ["N", 93], ["N", 47]]
    assert len([node for node in model.graph.node if node.name.startswith("HandModel/")]) == 40


def test_without_the_pose_there_are_no_dof_names(files, onnx):
    """Without the pose the metadata have no names of DoFs; --cube is written to the metadata."""
    net, weights = files(
        'layer { name: "hand" type: "HandModel" bottom: "x0" top: "pred" }', (1, 47)
    )
    run_tool("export_onnx", net, weights, "hand.onnx", "--cube", "261")
    about = {entry.key: entry.value for entry in onnx.load("hand.onnx").metadata_props}
    assert about["cube_mm"] == "261" and "dof_names" not in about


OTHER_PROCESS = """
import sys
for ours in ("netlib", "layers", "fast", "handpose", "exercises", "experiments", "export", "tools"):
    sys.modules[ours] = None  # importing it is an error
{}
print(len(joints), *sorted(joints)[:2], *joints["palm"].round(1))
"""


def test_the_document_in_a_process_of_its_own(packaged, tmp_path, rng):
    """The code in docs/onnx.md finds a hand without importing anything from this project."""
    crop = rng.integers(0, 256, (128, 128), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "crop.png"), crop)
    (tmp_path / "hand.onnx").write_bytes(packaged.read_bytes())
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    done = run_python("-c", OTHER_PROCESS.format(lines), cwd=tmp_path, PYTHONPATH=None)
    depth = (crop / 127.5 - 1).astype(np.float32)[None, None]
    net = netlib.Net(
        SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5", netlib.TEST
    )
    palm = net.forward(depth=depth)["pred"].reshape(31, 3)[load().joint_names.index("palm")] * 150
    count, first, second, *xyz = done.out.split()
    assert (count, first, second) == ("31", "index_base", "index_dip")
    assert_allclose([float(number) for number in xyz], palm, atol=0.06)


def test_size(files, onnx):
    """--size exports a net without fully connected layers for images of another size than
    the prototxt's.
    """
    net, weights = files(
        'layer { name: "p" type: "Pooling" bottom: "x0" top: "y" pooling_param { kernel_size: 2 '
        "stride: 2 } }",
        (1, 3, 1, 1),
    )
    assert (
        "y: largest difference 0.0e+00"
        in run_tool("export_onnx", net, weights, "a.onnx", "--size", "8x5", "--check").out
    )
    (value,) = onnx.load("a.onnx").graph.input
    assert [dim.dim_value for dim in value.type.tensor_type.shape.dim[1:]] == [3, 5, 8]
    files('layer { name: "p" type: "Power" bottom: "x0" top: "y" }', (1, 3))
    done = run_tool("export_onnx", net, weights, "b.onnx", "--size", "8x5", status=1)
    assert done.err == "net.prototxt: --size needs an input (N, C, H, W)\n"
