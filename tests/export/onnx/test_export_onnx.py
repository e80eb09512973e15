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

DEPLOY = SYNTHETIC / "deploy.prototxt"
WEIGHTS = SYNTHETIC / "synthetic_hand.caffemodel.h5"


@pytest.fixture(scope="module")
def packaged(tmp_path_factory):
    """The ONNX file of the packaged network, with the pose as a second output."""
    out = tmp_path_factory.mktemp("onnx") / "hand.onnx"
    run_tool("export_onnx", DEPLOY, WEIGHTS, out, "--blob", "DoF")
    return out


def depth_images(rng, N):
    """Random input of the packaged network, (N, 1, 128, 128)."""
    return rng.uniform(-1, 1, (N, 1, 128, 128)).astype(np.float32)


def test_the_papers_network_is_checked(here):
    netlib.Net(NYU, netlib.TEST, seed=3).save("net.caffemodel")
    out = run_tool("export_onnx", NYU, "net.caffemodel", "hand.onnx", "--check").out
    assert re.fullmatch(
        r"wrote hand\.onnx: 9\.\d\d MB\npred: largest difference \d\.\de-0[678] of its largest value "
        r"\(float32 rounding: \d\.\de-0\d\), batch sizes 1 and 3\n",
        out,
    )


@pytest.mark.parametrize("N", [1, 3])
def test_onnxruntime_computes_the_same_as_netlib(packaged, rng, N):
    depth = depth_images(rng, N)
    found = run_onnx(packaged.read_bytes(), depth=depth)
    net = netlib.Net(DEPLOY, WEIGHTS, netlib.TEST)
    for name, expected in net.forward(depth=depth, blobs=["DoF"]).items():
        assert found[name].shape == expected.shape
        assert_allclose(found[name], expected, rtol=0, atol=1e-5)


@pytest.mark.parametrize("N", [1, 3])
def test_opencv_computes_the_same_as_onnxruntime(packaged, rng, N):
    depth = depth_images(rng, N)
    expected = run_onnx(packaged.read_bytes(), depth=depth)
    net = cv2.dnn.readNetFromONNX(str(packaged))
    net.setInput(depth, "depth")
    names = ["joints", "pred", "DoF"]
    for name, found in zip(names, net.forward(names)):
        assert_allclose(found, expected[name], rtol=0, atol=1e-5)


def test_an_older_opset_computes_the_same_bits(packaged, here, onnx, rng):
    run_tool("export_onnx", DEPLOY, WEIGHTS, "older.onnx", "--blob", "DoF", "--opset", "13")
    model = onnx.load("older.onnx")
    assert [opset.version for opset in model.opset_import] == [13]
    assert model.ir_version == 7
    depth = depth_images(rng, 2)
    older = run_onnx(Path("older.onnx").read_bytes(), depth=depth)
    for name, expected in run_onnx(packaged.read_bytes(), depth=depth).items():
        assert np.array_equal(older[name], expected)


def test_the_metadata_describe_input_and_outputs(packaged, onnx):
    model = onnx.load(packaged)
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    assert json.loads(metadata.pop("joint_names")) == load().joint_names
    assert json.loads(metadata.pop("dof_names")) == load().dof_names
    assert metadata == {
        "producer": "handpose",
        "net": "SyntheticHand",
        "unit": "half-cubes",
        "cube_mm": "300",
        "axes": "x right, y up, z away",
        "input_range": "[-1, 1]",
    }
    assert model.producer_name == "handpose"
    assert model.graph.name == "SyntheticHand"
    assert model.ir_version == 8
    assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", 17)]


def test_the_file_is_plain_onnx(packaged, onnx):
    """ONNX's checker accepts all shapes, all operators are standard, the batch is N, and the hand's
    graph is small.
    """
    model = onnx.load(packaged)
    onnx.checker.check_model(model, full_check=True)
    assert {node.domain for node in model.graph.node} == {""}
    shapes = []
    for value in [*model.graph.input, *model.graph.output]:
        dims = value.type.tensor_type.shape.dim
        shapes.append([dim.dim_param or dim.dim_value for dim in dims])
    assert shapes == [["N", 1, 128, 128], ["N", 93], ["N", 93], ["N", 47]]
    assert sum(node.name.startswith("HandModel/") for node in model.graph.node) == 40


def test_a_net_without_a_pose_has_no_dof_names(files, onnx):
    """--cube is written to the metadata."""
    net, weights = files(
        'layer { name: "hand" type: "HandModel" bottom: "x0" top: "pred" }', (1, 47)
    )
    run_tool("export_onnx", net, weights, "hand.onnx", "--cube", "261")
    metadata = {entry.key: entry.value for entry in onnx.load("hand.onnx").metadata_props}
    assert metadata["cube_mm"] == "261"
    assert "dof_names" not in metadata


WITHOUT_PROJECT = """
import sys
for package in ("netlib", "layers", "fast", "handpose", "exercises", "experiments", "export", "tools"):
    sys.modules[package] = None  # importing it is an error
{}
print(len(joints), *sorted(joints)[:2], *joints["palm"].round(1))
"""


def test_the_code_of_the_document_runs_without_this_project(packaged, tmp_path, rng):
    """The code in docs/onnx.md finds the joints in mm."""
    crop = rng.integers(0, 256, (128, 128), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "crop.png"), crop)
    (tmp_path / "hand.onnx").write_bytes(packaged.read_bytes())
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    done = run_python("-c", WITHOUT_PROJECT.format(code), cwd=tmp_path, PYTHONPATH=None)
    count, first, second, *palm = done.out.split()
    assert (count, first, second) == ("31", "index_base", "index_dip")

    depth = (crop / 127.5 - 1).astype(np.float32)[None, None]
    pred = netlib.Net(DEPLOY, WEIGHTS, netlib.TEST).forward(depth=depth)["pred"]
    half_cube_mm = 150
    expected = pred.reshape(31, 3)[load().joint_names.index("palm")] * half_cube_mm
    assert_allclose(np.array(palm, float), expected, atol=0.06)


def test_another_size_of_images(files, onnx):
    """--size exports a net without fully connected layers for images of another size than
    the prototxt's.
    """
    net, weights = files(
        'layer { name: "p" type: "Pooling" bottom: "x0" top: "y" pooling_param { kernel_size: 2 '
        "stride: 2 } }",
        (1, 3, 1, 1),
    )
    done = run_tool("export_onnx", net, weights, "a.onnx", "--size", "8x5", "--check")
    assert "y: largest difference 0.0e+00" in done.out
    (value,) = onnx.load("a.onnx").graph.input
    _, *dims = value.type.tensor_type.shape.dim
    assert [dim.dim_value for dim in dims] == [3, 5, 8]


def test_a_size_without_images_is_rejected(files):
    net, weights = files('layer { name: "p" type: "Power" bottom: "x0" top: "y" }', (1, 3))
    done = run_tool("export_onnx", net, weights, "b.onnx", "--size", "8x5", status=1)
    assert done.err == "net.prototxt: --size needs an input (N, C, H, W)\n"
