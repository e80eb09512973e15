"""tools/export_onnx.py: nets as ONNX, which onnxruntime runs with the same results."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

onnx = pytest.importorskip("onnx")
onnxruntime = pytest.importorskip("onnxruntime")

import netlib  # noqa: E402
from layers.hand.kinematics import Kinematics  # noqa: E402
from layers.hand.skeleton import Skeleton, load  # noqa: E402
from layers.hand.skeleton_file import SkeletonParameter  # noqa: E402
from netlib import prototxt, schema  # noqa: E402
from netlib.create import layer_types  # noqa: E402
from netlib.errors import NetlibError  # noqa: E402
from tests.tools.conftest import ROOT  # noqa: E402
from tools import export_onnx, onnx_net  # noqa: E402
from tools.onnx_hand import steps_of  # noqa: E402
from tools.onnx_layers import LAYERS  # noqa: E402

NYU = ROOT / "prototxt" / "nyu_deploy.prototxt"
SYNTHETIC = ROOT / "models" / "synthetic_hand"
IMAGE = [(1, 3, 7, 6)]  # the shape of an input x that is an image
GROUP = "num_output: 4 group: 2"

# Layer type -> (the shapes of the inputs, the layer's options, number of tops) of some examples.
CASES: dict[str, list[tuple[list[tuple[int, ...]], str, int]]] = {
    "AbsVal": [(IMAGE, "", 1)],
    "ArgMax": [
        (IMAGE, "", 1),
        (IMAGE, "argmax_param { top_k: 5 out_max_val: true }", 1),
        (IMAGE, "argmax_param { axis: -2 top_k: 2 }", 1),
        (IMAGE, "argmax_param { axis: 1 top_k: 2 out_max_val: true }", 1),
    ],
    "Axpy": [([(1, 3), *IMAGE, *IMAGE], "", 1), ([(1, 3, 1, 1), *IMAGE, *IMAGE], "", 1)],
    "BNLL": [(IMAGE, "", 1)],
    "BatchNorm": [(IMAGE, "", 1), ([(1, 5)], "batch_norm_param { eps: 0.1 }", 1)],
    "BatchReindex": [([*IMAGE, (1,)], "", 1)],
    "Bias": [
        (IMAGE, "", 1),
        (IMAGE, "bias_param { axis: 2 num_axes: -1 }", 1),
        ([*IMAGE, (1, 3)], "bias_param { axis: 0 }", 1),
    ],
    "Clip": [(IMAGE, "clip_param { min: -0.5 max: 0.25 }", 1), (IMAGE, "clip_param { min: 0.25 max: -0.5 }", 1)],
    "Concat": [([*IMAGE, (1, 2, 7, 6)], "", 1), ([*IMAGE, *IMAGE], "concat_param { axis: 0 }", 1)],
    "Convolution": [
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 }", 1),
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 bias_term: false stride: 2 pad: 1 dilation: 2 }", 1),
        (IMAGE, "convolution_param { num_output: 4 kernel_h: 2 kernel_w: 3 stride_h: 2 stride_w: 1 pad_h: 0 pad_w: 2 }",
         1),
        ([(1, 6, 5, 5)], f"convolution_param {{ {GROUP} kernel_size: 3 }}", 1),
        ([*IMAGE, (1, 3, 4, 4)], "convolution_param { num_output: 2 kernel_size: 3 }", 2),
        ([(1, 2, 3, 5, 4)], "convolution_param { num_output: 2 kernel_size: 2 axis: 2 }", 1),
        ([(1, 3, 9)], "convolution_param { num_output: 2 kernel_size: 4 stride: 2 }", 1),
        ([(1, 2, 4, 5, 6)], "convolution_param { num_output: 3 kernel_size: [2, 3, 4] pad: 1 }", 1),
        ([(1, 3)], "convolution_param { num_output: 2 }", 1),
    ],
    "Crop": [
        ([*IMAGE, (1, 3, 4, 5)], "crop_param { offset: 2 offset: 1 }", 1),
        ([*IMAGE, (1, 2, 7, 5)], "crop_param { axis: 1 offset: 1 offset: 0 offset: 1 }", 1),
        ([*IMAGE, (1, 8, 7, 6)], "", 1),
    ],
    "Deconvolution": [
        (IMAGE, "convolution_param { num_output: 4 kernel_size: 3 stride: 2 pad: 1 dilation: 2 }", 1),
        ([(1, 6, 5, 4)], f"convolution_param {{ {GROUP} kernel_h: 3 kernel_w: 2 stride: 2 bias_term: false }}", 1),
        ([(1, 3, 5)], "convolution_param { num_output: 2 kernel_size: 4 stride: 3 }", 1),
    ],
    "DeepHandModel": [([(1, 47)], "", 1)],
    "Dropout": [(IMAGE, "", 1), (IMAGE, "dropout_param { dropout_ratio: 0.3 scale_train: false }", 1)],
    "ELU": [(IMAGE, "elu_param { alpha: 0.7 }", 1)],
    "Eltwise": [
        ([*IMAGE] * 3, "", 1),
        ([*IMAGE] * 2, "eltwise_param { coeff: 1 coeff: -0.5 }", 1),
        ([*IMAGE] * 3, "eltwise_param { operation: PROD }", 1),
        ([*IMAGE] * 3, "eltwise_param { operation: MAX }", 1),
    ],
    "Embed": [
        ([(1, 4)], "embed_param { num_output: 3 input_dim: 5 }", 1),
        ([(1,)], "embed_param { num_output: 3 input_dim: 5 bias_term: false }", 1),
    ],
    "Exp": [(IMAGE, "", 1), (IMAGE, "exp_param { base: 2 scale: 3 shift: 1 }", 1)],
    "Flatten": [(IMAGE, "", 1), (IMAGE, "flatten_param { axis: 2 }", 1), (IMAGE, "flatten_param { axis: 0 }", 1)],
    "HandModel": [
        ([(1, 47)], "", 1),
        ([(1, 47, 1, 1)], "", 1),
        ([(1, 47), (1, 1)], "", 1),  # a factor
        ([(1, 47), (1, 31, 1)], "", 1),  # bone lengths
    ],
    "InnerProduct": [
        (IMAGE, "inner_product_param { num_output: 4 }", 1),
        ([(1, 5)], "inner_product_param { num_output: 4 bias_term: false transpose: true }", 1),
        (IMAGE, "inner_product_param { num_output: 4 axis: -2 }", 1),
    ],
    "LRN": [
        ([(1, 7, 3, 2)], "lrn_param { local_size: 3 alpha: 2 beta: 0.6 k: 1.5 }", 1),
        (IMAGE, "lrn_param { norm_region: WITHIN_CHANNEL local_size: 3 alpha: 2 }", 1),
    ],
    "Log": [(IMAGE, "log_param { base: 2 scale: 3 shift: 4 }", 1), (IMAGE, "", 1)],
    "MVN": [
        (IMAGE, "", 1),
        (IMAGE, "mvn_param { across_channels: true eps: 0.1 }", 1),
        ([(1, 3, 5)], "mvn_param { normalize_variance: false across_channels: true }", 1),
    ],
    "PReLU": [(IMAGE, "", 1), ([(1, 5)], "", 1), (IMAGE, "prelu_param { channel_shared: true }", 1)],
    "Parameter": [(IMAGE, "parameter_param { shape { dim: 2 dim: 3 } }", 1)],
    "Pooling": [
        *((IMAGE, f"pooling_param {{ pool: {pool} {options} }}", 1) for pool in ("MAX", "AVE") for options in (
            "kernel_size: 2 stride: 2",  # hangs over the lower edge
            "kernel_size: 3 stride: 2 pad: 1",
            "kernel_size: 2 stride: 2 pad: 1",  # a last window would start beyond the edge
            "kernel_size: 4 stride: 3 pad: 2",
            "kernel_h: 3 kernel_w: 2 stride_h: 1 stride_w: 3 pad_h: 2 pad_w: 0",
            "kernel_size: 3 stride: 2 pad: 1 round_mode: FLOOR",
            "kernel_size: 1 stride: 4",  # windows without a value: -FLT_MAX and NaN
            "global_pooling: true",
        )),
        (IMAGE, "pooling_param { kernel_size: 3 stride: 2 pad: 1 }", 2),
        (IMAGE, "pooling_param { global_pooling: true }", 2),
        (IMAGE, "pooling_param { kernel_size: 1 stride: 4 }", 2),
        (IMAGE, "pooling_param { pool: AVE kernel_size: 9 stride: 4 }", 1),  # a single window, which hangs over
    ],
    "Power": [
        (IMAGE, "", 1),
        (IMAGE, "power_param { scale: 2 shift: -1 }", 1),
        (IMAGE, "power_param { power: 3 shift: 1 }", 1),
        (IMAGE, "power_param { power: 0.5 scale: 0.5 shift: 2 }", 1),
    ],
    "ReLU": [(IMAGE, "", 1), (IMAGE, "relu_param { negative_slope: 0.1 }", 1)],
    "Reduction": [
        (IMAGE, f"reduction_param {{ operation: {operation} axis: {axis} coeff: 0.5 }}", 1)
        for operation in ("SUM", "ASUM", "SUMSQ", "MEAN") for axis in (0, 1, -1)
    ],
    "Reshape": [
        (IMAGE, "reshape_param { shape { dim: 0 dim: -1 dim: 2 } }", 1),
        (IMAGE, "reshape_param { shape { dim: -1 dim: 6 } }", 1),
        (IMAGE, "reshape_param { axis: 2 shape { dim: 6 dim: 7 } }", 1),
    ],
    "SPP": [
        (IMAGE, "spp_param { pyramid_height: 2 }", 1),
        (IMAGE, "spp_param { pyramid_height: 3 pool: AVE }", 1),
        (IMAGE, "spp_param { pyramid_height: 1 }", 1),
    ],
    "Scale": [
        (IMAGE, "", 1),
        (IMAGE, "scale_param { axis: 2 num_axes: 2 bias_term: true }", 1),
        (IMAGE, "scale_param { num_axes: 0 bias_term: true }", 1),
        ([*IMAGE, (1, 3)], "scale_param { axis: 0 }", 1),
    ],
    "Sigmoid": [(IMAGE, "", 1)],
    "Slice": [
        ([(1, 6, 2, 2)], "", 3),
        ([(1, 6, 5)], "slice_param { axis: -1 slice_point: 1 slice_point: 3 }", 3),
        (IMAGE, "", 1),
    ],
    "Softmax": [(IMAGE, "", 1), (IMAGE, "softmax_param { axis: -1 }", 1)],
    "Split": [(IMAGE, "", 2)],
    "Swish": [(IMAGE, "swish_param { beta: 1.7 }", 1)],
    "TanH": [(IMAGE, "", 1)],
    "Threshold": [(IMAGE, "threshold_param { threshold: 0.3 }", 1)],
    "Tile": [(IMAGE, "tile_param { tiles: 3 }", 1), (IMAGE, "tile_param { axis: -1 tiles: 2 }", 1)],
}  # fmt: skip
WITHOUT_EXAMPLE = {"Input", "Silence"}  # in most nets here, and in a test of its own
EXAMPLES = [pytest.param(name, *case, id=f"{name}{i}") for name, cases in CASES.items() for i, case in enumerate(cases)]


def net_text(layers: str, *shapes: tuple[int, ...]) -> str:
    """A net with inputs x0, x1 ... of these shapes before its layers."""
    dims = [" ".join(f"dim: {n}" for n in shape) for shape in shapes]
    inputs = [f'layer {{ name: "in{i}" type: "Input" top: "x{i}" input_param {{ shape {{ {dim} }} }} }}\n'
              for i, dim in enumerate(dims)]  # fmt: skip
    return f'name: "small"\n{"".join(inputs)}{layers}\n'


@pytest.fixture
def files(tmp_path, monkeypatch):
    """``files(layers, shapes ...)``: net.prototxt and net.caffemodel.h5 with random parameters, in an own folder."""
    monkeypatch.chdir(tmp_path)

    def make(layers: str, *shapes: tuple[int, ...]) -> tuple[str, str]:
        Path("net.prototxt").write_text(net_text(layers, *shapes))
        net, rng = netlib.Net("net.prototxt", netlib.TEST, seed=1), np.random.default_rng(1)
        for blobs in net.params.values():
            for blob in blobs:
                blob.data[...] = rng.uniform(0.2, 1, blob.shape) * rng.choice([-1, 1], blob.shape)
        for layer in net.layers:
            if layer.type == "BatchNorm":
                layer.blobs[1].data[...] = abs(layer.blobs[1].data)
                layer.blobs[2].data[...] = 3
        net.save("net.caffemodel.h5")
        return "net.prototxt", "net.caffemodel.h5"

    return make


def run_onnx(image: bytes, **inputs: np.ndarray) -> dict[str, np.ndarray]:
    """All outputs."""
    session = onnxruntime.InferenceSession(image, providers=["CPUExecutionProvider"])
    names = [output.name for output in session.get_outputs()]
    return dict(zip(names, session.run(names, inputs)))


# ---------------------------------------------------------------------------------------------- layers


@pytest.mark.parametrize(("name", "shapes", "options", "tops"), EXAMPLES)
def test_layer(name, shapes, options, tops, files):
    """One layer, batches of 1 and 3: what netlib computes, to 1e-5 of the largest value."""
    bottoms = " ".join(f'bottom: "x{i}"' for i in range(len(shapes) if name != "Parameter" else 0))
    names = " ".join(f'top: "y{i}"' for i in range(tops))
    also = 'layer { name: "read" type: "Sigmoid" bottom: "x0" top: "z" }' if name == "Parameter" else ""
    net = onnx_net.load(*files(f'layer {{ name: "it" type: "{name}" {bottoms} {names} {options} }} {also}', *shapes))
    found = onnx_net.differences(onnx_net.onnx_image(net), net, (1, 3))
    assert set(found) >= {f"y{i}" for i in range(tops)}
    assert max(found.values()) <= 1e-5, found


def test_every_layer_type_has_a_form_or_is_refused():
    """And every form an example."""
    random_or_from_outside = {"DummyData", "HDF5Data", "HandAugment", "Data", "ImageData", "MemoryData", "WindowData",
                              "HDF5Output"}  # fmt: skip
    of_training = {"Accuracy", "DeepHandModelDofConstraintLoss", "PhysLimit"}
    without_form = {"Filter", "Im2col", "LSTM", "LSTMUnit", "RNN", "ROIPooling"}
    refused = {name for name in layer_types() if name not in LAYERS and not name.endswith("Loss")}
    assert refused - {"DeepHandModelDofConstraintLoss"} <= random_or_from_outside | of_training | without_form
    assert set(LAYERS) == set(CASES) | WITHOUT_EXAMPLE


def test_the_document_names_every_layer_type():
    """Those with a form, and those without that one may look for."""
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    for name in [*LAYERS, "Filter", "Im2col", "LSTM", "LSTMUnit", "RNN", "ROIPooling"]:
        assert re.search(rf"\b{name}\b", text), name


def test_equal_maxima(files):
    """ArgMax takes the last of equal values first; the mask of MAX the first."""
    net = onnx_net.load(*files(
        'layer { name: "a" type: "ArgMax" bottom: "x0" top: "a" argmax_param { top_k: 3 } }'
        'layer { name: "p" type: "Pooling" bottom: "x0" top: "y" top: "mask" pooling_param { kernel_size: 2 } }',
        (1, 2, 3, 2),
    ))  # fmt: skip
    x = np.zeros((2, 2, 3, 2), np.float32)
    x[:, 1, 1] = 1
    found = run_onnx(onnx_net.onnx_image(net), x0=x)
    assert found["a"].tolist() == [[[[9], [8], [11]]]] * 2
    assert found["mask"].tolist() == [[[[0], [2]], [[2], [2]]]] * 2
    assert {name: y.tolist() for name, y in net.forward(x0=x).items()} == {n: y.tolist() for n, y in found.items()}


def test_layers_in_place(files):
    """A blob that several layers write has the last value under its name, and one that nobody changes two names."""
    net = onnx_net.load(*files(
        'layer { name: "ip" type: "InnerProduct" bottom: "x0" top: "y" inner_product_param { num_output: 3 } }'
        'layer { name: "relu" type: "ReLU" bottom: "y" top: "y" }'
        'layer { name: "drop" type: "Dropout" bottom: "y" top: "y" }'
        'layer { name: "power" type: "Power" bottom: "y" top: "y" power_param { shift: 1 } }'
        'layer { name: "same" type: "Dropout" bottom: "y" top: "z" }'
        'layer { name: "exp" type: "Exp" bottom: "y" top: "e" }',
        (1, 4),
    ))  # fmt: skip
    image = onnx_net.onnx_image(net, ["y"])
    assert max(onnx_net.differences(image, net, (1, 3), ["y"]).values()) <= 1e-5
    graph = onnx.load_from_string(image).graph
    assert [(node.op_type, *node.output) for node in graph.node] == [
        ("Gemm", "ip/Gemm"), ("Relu", "relu/Relu"), ("Add", "z"), ("Exp", "e"), ("Identity", "y"),
    ]  # fmt: skip


def test_silence_and_splits_are_no_operators(files):
    """Nor is a blob with two readers copied."""
    net = onnx_net.load(*files(
        'layer { name: "a" type: "TanH" bottom: "x0" top: "a" } layer { name: "b" type: "AbsVal" bottom: "a" top: "b" }'
        'layer { name: "c" type: "BNLL" bottom: "a" top: "c" } layer { name: "s" type: "Silence" bottom: "c" }',
        (1, 4),
    ))  # fmt: skip
    graph = onnx.load_from_string(onnx_net.onnx_image(net)).graph
    assert [(node.op_type, *node.input) for node in graph.node] == [
        ("Tanh", "x0"), ("Abs", "a"), ("Softplus", "a"),
    ]  # fmt: skip
    assert [output.name for output in graph.output] == ["b"]


# ---------------------------------------------------------------------------------------------- the hand


def test_the_papers_network(tmp_path, monkeypatch, capsys):
    """With random weights: the joints of netlib; the tool says so."""
    monkeypatch.chdir(tmp_path)
    netlib.Net(NYU, netlib.TEST, seed=3).save("net.caffemodel")
    assert export_onnx.main([str(NYU), "net.caffemodel", "hand.onnx", "--check"]) == 0
    out = capsys.readouterr().out
    assert re.fullmatch(r"wrote hand\.onnx: 9\.\d\d MB\npred: largest difference \d\.\de-0[678] of its largest value, "
                        r"batches of 1 and 3\n", out)  # fmt: skip


@pytest.fixture(scope="module")
def packaged(tmp_path_factory):
    """The packaged network as a file, with the pose as a second output."""
    out = tmp_path_factory.mktemp("onnx") / "hand.onnx"
    weights = SYNTHETIC / "synthetic_hand.caffemodel.h5"
    assert export_onnx.main([str(SYNTHETIC / "deploy.prototxt"), str(weights), str(out), "--blob", "DoF"]) == 0
    return out


def test_the_packaged_network(packaged, rng):
    """Joints and pose to 1e-5, for one crop and for three."""
    net = netlib.Net(SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5", netlib.TEST)
    for batch in (1, 3):
        depth = rng.uniform(-1, 1, (batch, 1, 128, 128)).astype(np.float32)
        found, expected = run_onnx(packaged.read_bytes(), depth=depth), net.forward(depth=depth, blobs=["DoF"])
        assert found["pred"].shape == (batch, 93) and found["DoF"].shape == (batch, 47)
        np.testing.assert_allclose(found["pred"], expected["pred"], rtol=0, atol=1e-5)
        np.testing.assert_allclose(found["DoF"], expected["DoF"], rtol=0, atol=1e-5)


def test_metadata(packaged):
    """Who wrote it, and what its numbers mean."""
    model = onnx.load(packaged)
    about = {entry.key: entry.value for entry in model.metadata_props}
    assert json.loads(about.pop("joint_names")) == load().joint_names
    assert json.loads(about.pop("dof_names")) == load().dof_names
    assert about == {
        "producer": "deepmodel-numpy", "net": "SyntheticHand", "unit": "half-cubes", "cube_mm": "300",
        "axes": "x right, y up, z away", "input_range": "[-1, 1]",
    }  # fmt: skip
    assert (model.producer_name, model.graph.name, model.ir_version) == ("deepmodel-numpy", "SyntheticHand", 8)
    assert [(opset.domain, opset.version) for opset in model.opset_import] == [("", 17)]


def test_the_file_is_plain_onnx(packaged):
    """The checker infers every shape, all operators are ONNX's own, the batch is N, and the hand is a small graph."""
    model = onnx.load(packaged)
    onnx.checker.check_model(model, full_check=True)
    assert {node.domain for node in model.graph.node} == {""}
    shapes = [[d.dim_param or d.dim_value for d in value.type.tensor_type.shape.dim]
              for value in [*model.graph.input, *model.graph.output]]  # fmt: skip
    assert shapes == [["N", 1, 128, 128], ["N", 93], ["N", 47]]
    assert len([node for node in model.graph.node if node.name.startswith("HandModel/")]) == 30


def test_without_the_pose_there_are_no_dof_names(files):
    """And --cube is in the metadata."""
    net, weights = files('layer { name: "hand" type: "HandModel" bottom: "x0" top: "pred" }', (1, 47))
    assert export_onnx.main([net, weights, "hand.onnx", "--cube", "261"]) == 0
    about = {entry.key: entry.value for entry in onnx.load("hand.onnx").metadata_props}
    assert about["cube_mm"] == "261" and "dof_names" not in about


def test_steps_of_the_hand():
    """26 free motions behind one that stands still: six of the palm, then four of each finger, abreast."""
    steps, last, _ = steps_of(load(), load().bones)
    assert [sum(step.depth == d for step in steps) for d in range(11)] == [1] * 7 + [5] * 4
    assert last[load().joint_names.index("palm")] == 6
    assert max(last) == 26


def test_another_body(files, rng):
    """Two roots, an order of the file in which children come first, a turn about -z, a joint that nothing moves."""
    body = """
        name: "two" dof { name: "a" initial: 0.3 } dof { name: "b" fixed: true initial: 0.5 } dof { name: "c" }
        joint { name: "tip" parent: "arm" rotate { axis: NEG_Z dof: "c" } bone { axis: NEG_X length: 0.5 } }
        joint { name: "arm" translate { axis: NEG_Y dof: "a" } rotate { axis: X dof: "b" } bone { axis: Z length: 2 } }
        joint { name: "post" rotate { axis: Y dof: "b" } bone { axis: X length: 1 } }
        joint { name: "ring" parent: "tip" rotate { axis: Y dof: "a" } }
    """
    layer = 'layer {{ name: "h" type: "HandModel" bottom: "x0" top: "y" hand_model_param {{ skeleton: "{}" }} }}'
    Path("body.prototxt").write_text(body)
    net = onnx_net.load(*files(layer.format("body.prototxt"), (1, 3)))
    x = rng.normal(size=(4, 3)).astype(np.float32)
    skeleton = Skeleton(schema.read(prototxt.parse(body, "body"), SkeletonParameter, "skeleton"))
    found = run_onnx(onnx_net.onnx_image(net), x0=x)["y"].reshape(4, 4, 3)
    np.testing.assert_allclose(found, Kinematics(skeleton).joints(x), atol=1e-6)


@pytest.mark.parametrize("sizes", [1, 4])
def test_another_body_of_each_item(files, rng, sizes):
    """Its size is an input: bones behind turns that are fixed, a fixed slide, a DoF that slides and turns."""
    Path("body.prototxt").write_text("""
        dof { name: "a" initial: 0.3 } dof { name: "b" fixed: true initial: 0.5 }
        dof { name: "c" fixed: true initial: -0.7 } dof { name: "d" }
        joint { name: "tip" parent: "arm" translate { axis: X dof: "c" } rotate { axis: NEG_Z dof: "d" }
                bone { axis: NEG_X length: 0.5 } }
        joint { name: "arm" translate { axis: NEG_Y dof: "a" } rotate { axis: X dof: "b" }
                bone { axis: Z length: 2 } }
        joint { name: "post" rotate { axis: Y dof: "b" } bone { axis: X length: 1 } }
        joint { name: "ring" parent: "tip" translate { axis: Z dof: "d" } rotate { axis: Y dof: "a" } }
    """)
    layer = 'layer { name: "h" type: "HandModel" bottom: "x0" bottom: "x1" top: "y" %s }'
    net = onnx_net.load(*files(layer % 'hand_model_param { skeleton: "body.prototxt" }', (1, 4), (1, sizes)))
    x = {"x0": rng.normal(size=(3, 4)).astype(np.float32), "x1": rng.normal(size=(3, sizes)).astype(np.float32)}
    found = run_onnx(onnx_net.onnx_image(net), **x)["y"]
    np.testing.assert_allclose(found, net.forward(**x)["y"], atol=2e-6)


def test_another_runtime(packaged, rng):
    """OpenCV comes to the same joints."""
    depth = rng.uniform(-1, 1, (2, 1, 128, 128)).astype(np.float32)
    other = cv2.dnn.readNetFromONNX(str(packaged))
    other.setInput(depth, "depth")
    found, expected = other.forward(["pred", "DoF"]), run_onnx(packaged.read_bytes(), depth=depth)
    np.testing.assert_allclose(found[0], expected["pred"], rtol=0, atol=1e-5)
    np.testing.assert_allclose(found[1], expected["DoF"], rtol=0, atol=1e-5)


OTHER_PROCESS = """
import sys
for ours in ("netlib", "layers", "fast", "handpose", "tools"):
    sys.modules[ours] = None  # importing it is an error
{}
print(len(joints), *sorted(joints)[:2], *joints["palm"].round(1))
"""


def test_the_document_in_a_process_of_its_own(packaged, tmp_path, rng):
    """The lines of docs/onnx.md find a hand without a line of this project."""
    crop = rng.integers(0, 256, (128, 128), dtype=np.uint8)
    cv2.imwrite(str(tmp_path / "crop.png"), crop)
    (tmp_path / "hand.onnx").write_bytes(packaged.read_bytes())
    text = (ROOT / "docs" / "onnx.md").read_text(encoding="utf-8")
    (lines,) = re.findall(r"```python\n(.*?)```", text, re.DOTALL)
    done = subprocess.run([sys.executable, "-c", OTHER_PROCESS.format(lines)], cwd=tmp_path, capture_output=True,
                          text=True, check=True)  # fmt: skip
    depth = (crop / 127.5 - 1).astype(np.float32)[None, None]
    net = netlib.Net(SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5", netlib.TEST)
    palm = net.forward(depth=depth)["pred"].reshape(31, 3)[load().joint_names.index("palm")] * 150
    count, first, second, *xyz = done.stdout.split()
    assert (count, first, second) == ("31", "index_base", "index_dip")
    np.testing.assert_allclose([float(number) for number in xyz], palm, atol=0.06)


# ---------------------------------------------------------------------------------------------- mistakes


def refusal(net: str, weights: str, capsys: pytest.CaptureFixture[str], *more: str) -> str:
    """The one line that the tool says, before anything is written."""
    assert export_onnx.main([net, weights, "out.onnx", *more]) == 1
    assert not Path("out.onnx").exists()
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1
    return err


@pytest.mark.parametrize("kind", ["EuclideanLoss", "HDF5Data", "Python"])
def test_a_type_without_a_form(kind, files, capsys):
    """Its layer, its type and its place; before the net is built, so that its data need not be there."""
    _, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    Path("loss.prototxt").write_text(net_text(f'layer {{ name: "bad" type: "{kind}" top: "y" }}', (1, 3)))
    assert refusal("loss.prototxt", weights, capsys) == (
        f"loss.prototxt:3:21: error: layer 'bad': type '{kind}' has no form in ONNX (docs/onnx.md); "
        "a deploy net has no layers for data, labels and losses\n"
    )


@pytest.mark.parametrize(
    ("layers", "shapes", "message"),
    [
        ('layer { name: "r" type: "Reshape" bottom: "x0" top: "y" reshape_param { shape { dim: 1 dim: 4 } } }',
         [(1, 4)], "net.prototxt:3:73: error: layer 'r': cannot give 8 values (2, 4) the shape (1, 4); the net must "
         "take any number of items, here it had 2"),
        ('layer { name: "s" type: "Slice" bottom: "x0" top: "y" top: "z" slice_param { axis: 0 slice_point: 1 } }',
         [(2, 4)], "net.prototxt:3:7: error: layer 's': a shape [(1, 4), (1, 4)] for 2 items, [(1, 4), (2, 4)] for 3 "
         "has no form in ONNX: expected one axis that counts items"),
        ('layer { name: "m" type: "ArgMax" bottom: "x0" top: "y" argmax_param { axis: 0 } }', [(1, 4)],
         "net.prototxt:3:7: error: layer 'm': ArgMax along the batch has no form in ONNX; shape (N)"),
        ('layer { name: "b" type: "BatchNorm" bottom: "x0" top: "y" batch_norm_param { use_global_stats: false } }',
         [(1, 4)], "net.prototxt:3:78: error: layer 'b': with use_global_stats: false, each item depends on its batch; "
         "expected true, or none"),
        ('layer { name: "a" type: "ReLU" bottom: "x0" top: "x0" }', [(1, 4)],
         "net.prototxt: blob 'x0' is both input and output, which ONNX does not know; let a layer read it, and give "
         "its top another name"),
        ('layer { name: "a" type: "Concat" bottom: "x0" bottom: "x1" top: "y" concat_param { axis: 0 } }',
         [(1, 4), (2, 4)], "net.prototxt: inputs of different batches, x0 (1, 4), x1 (2, 4); expected first axes of "
         "the same size"),
    ],
)  # fmt: skip
def test_a_net_without_a_batch(layers, shapes, message, files, capsys):
    """Every blob has N items at most once, and it is not both input and output."""
    assert refusal(*files(layers, *shapes), capsys) == f"{message}\n"


def test_a_net_from_python(files):
    """It may be in use: its shapes are as before, and types without a form are refused, too."""
    net, _ = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (5, 3))
    used = netlib.Net(net, netlib.TEST)
    onnx_net.onnx_image(used)
    assert used.blobs["y"].shape == (5, 3)
    Path("loss.prototxt").write_text(net_text('layer { name: "bad" type: "PhysLimit" bottom: "x0" top: "y" }', (1, 47)))
    with pytest.raises(NetlibError, match="layer 'bad': type 'PhysLimit' has no form in ONNX"):
        onnx_net.onnx_image(netlib.Net("loss.prototxt", netlib.TEST))


def test_files_that_are_not_there(files, capsys):
    """The net, the weights, weights of another net, a blob, the folder."""
    net, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    assert refusal("no.prototxt", weights, capsys) == (
        "no.prototxt: cannot read the prototxt: No such file or directory\n"
    )
    assert "no.caffemodel.h5" in refusal(net, "no.caffemodel.h5", capsys)
    assert refusal(str(NYU), weights, capsys).startswith("net.caffemodel.h5: no layer of net 'DeepModel' is in it")
    assert refusal(net, weights, capsys, "--blob", "yy") == "net 'small' has no blob 'yy' (did you mean 'y'?)\n"
    assert export_onnx.main([net, weights, "no/out.onnx"]) == 1
    assert capsys.readouterr().err == "no/out.onnx: cannot write the file: No such file or directory\n"


def test_no_input(files, capsys):
    """A net that reads nothing."""
    Path("net.prototxt").write_text('layer { name: "a" type: "Input" top: "y" }')
    _, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    Path("net.prototxt").write_text('layer { name: "a" type: "Input" top: "x" }'
                                    'layer { name: "b" type: "AbsVal" bottom: "x" top: "y" }')  # fmt: skip
    assert refusal("net.prototxt", weights, capsys) == (
        "net.prototxt: input 'x' has no shape; expected input_param { shape { ... } }\n"
    )


@pytest.mark.parametrize(("missing", "more"), [("onnx", []), ("onnxruntime", ["--check"])])
def test_a_missing_package(missing, more, files, capsys, monkeypatch):
    """One line with the command that installs it."""
    net, weights = files('layer { name: "a" type: "AbsVal" bottom: "x0" top: "y" }', (1, 3))
    monkeypatch.setitem(sys.modules, missing, None)
    assert export_onnx.main([net, weights, "out.onnx", *more]) == 1
    assert capsys.readouterr().err == f"{missing} is missing: pip install onnx onnxruntime\n"


def test_a_difference_fails(files, capsys, monkeypatch):
    """--check says by how much, and the exit status is 1."""
    net, weights = files('layer { name: "a" type: "Power" bottom: "x0" top: "y" power_param { scale: 2 } }', (1, 3))
    monkeypatch.setitem(LAYERS, "Power", LAYERS["AbsVal"])
    assert export_onnx.main([net, weights, "out.onnx", "--check"]) == 1
    out, err = capsys.readouterr()
    assert re.search(r"^y: largest difference 1\.5e\+00 of its largest value, batches of 1 and 3$", out, re.MULTILINE)
    assert err == "out.onnx: onnxruntime computes something else, by more than 1e-05\n"


def test_difference():
    """A part of the largest finite value expected; NaN and infinity are equal to themselves only."""
    nan, inf = np.nan, np.inf
    assert onnx_net.difference(np.array([1.0, 2.5]), np.array([1.0, 2.0])) == 0.25
    assert onnx_net.difference(np.array([nan, inf, 1.0]), np.array([nan, inf, 1.0])) == 0
    assert onnx_net.difference(np.array([nan, 1.0]), np.array([1.0, 1.0])) == inf
    assert onnx_net.difference(np.array([inf]), np.array([nan])) == inf
    assert onnx_net.difference(np.zeros((2, 1)), np.zeros(2)) == inf


def test_usage(capsys):
    """A cube has a size."""
    with pytest.raises(SystemExit) as stopped:
        export_onnx.main(["net", "weights", "out", "--cube", "0"])
    assert stopped.value.code == 2
    assert capsys.readouterr().err.endswith("argument --cube: expected 50 to 10000 mm, found '0'\n")


def test_weights_over_two_gigabytes(monkeypatch):
    """A protocol buffer holds no more."""
    monkeypatch.setattr("tools.onnx_graph.MOST_BYTES", 1000)
    net = onnx_net.load(SYNTHETIC / "deploy.prototxt", SYNTHETIC / "synthetic_hand.caffemodel.h5")
    with pytest.raises(NetlibError, match=r"^net 'SyntheticHand' has 0\.0 GB of weights; an ONNX file holds at most"):
        onnx_net.onnx_image(net)
