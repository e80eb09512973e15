"""Net and the solvers with pycaffe's interface."""

from __future__ import annotations

import logging
import re
from collections import OrderedDict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import netlib
from netlib import caffe
from netlib.caffe import _caffe, pycaffe
from netlib.distributed import ranks
from netlib.distributed.ranks import Ranks
from netlib.errors import NetlibError, PrototxtError, warn_once
from tests.netlib.conftest import MakeModule
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

NET = """
    name: "n" force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } }
    layer { name: "a" type: "InnerProduct" bottom: "x" top: "a_top"
            inner_product_param { num_output: 3 weight_filler { type: "xavier" } } }
    layer { name: "loss" type: "EuclideanLoss" bottom: "a_top" bottom: "x" top: "l" loss_weight: 2 }
    layer { name: "y" type: "Power" bottom: "a_top" top: "y" power_param { scale: 10 } }
"""
SOLVER = 'net: "net.prototxt" base_lr: 0.5 lr_policy: "step" stepsize: 2 gamma: 0.1 max_iter: 4 snapshot_prefix: "s"'


@pytest.fixture(autouse=True)
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Write a net and its solver to a temporary folder and make it the working directory."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "net.prototxt").write_text(NET)
    (tmp_path / "solver.prototxt").write_text(SOLVER)
    return tmp_path


@pytest.fixture
def net() -> pycaffe.Net:
    return pycaffe.Net("net.prototxt", netlib.TRAIN)


X = np.arange(6, dtype=np.float32).reshape(2, 3) / 3


def test_a_net_has_pycaffes_attributes(net: pycaffe.Net) -> None:
    split = "a_top_a_0_split"
    assert net._layer_names == ["x", "x_x_0_split", "a", split, "loss", "y"]
    assert net.top_names["a"] == ["a_top"]
    assert net.bottom_names["loss"] == [f"{split}_0", "x_x_0_split_1"]
    assert net.bottom_names["x"] == []
    assert (net.inputs, net.outputs) == (["x"], ["l", "y"])
    assert net.blob_loss_weights["l"] == 2
    assert net.blob_loss_weights["y"] == 0
    assert isinstance(net.top_names, OrderedDict)
    assert list(zip(net._blob_names, net._blobs)) == list(net.blobs.items())
    assert [layer.type for layer in net.layers] == [
        "Input",
        "Split",
        "InnerProduct",
        "Split",
        "EuclideanLoss",
        "Power",
    ]


def test_numbers_of_blobs(net: pycaffe.Net) -> None:
    names = list(net.blobs)
    for i, name in enumerate(net._layer_names):
        assert [names[n] for n in net._bottom_ids(i)] == net.bottom_names[name]
        assert [names[n] for n in net._top_ids(i)] == net.top_names[name]
    assert [names[n] for n in net._inputs] == net.inputs
    assert [names[n] for n in net._outputs] == net.outputs
    assert dict(zip(names, net._blob_loss_weights)) == dict(net.blob_loss_weights)
    for number in (-1, 6):
        with pytest.raises(netlib.LayerError, match=f"net 'n' has 6 layers, found number {number}"):
            net._top_ids(number)


def test_the_unnamed_top_of_a_loss_has_a_number(work: Path) -> None:
    """The automatic top of a loss layer counts as a blob, in its place, but is no output."""
    (work / "net.prototxt").write_text(NET.replace('top: "l" ', ""))
    net = pycaffe.Net("net.prototxt", netlib.TRAIN)
    [number] = net._top_ids(4)
    assert (net._blob_names[number], net._blob_loss_weights[number]) == ("(automatic)", 2)
    assert list(net.blobs)[number] == "(automatic)"
    assert net.outputs == ["y"]
    assert net._layer_names[5] == "y"
    assert net._top_ids(5) == [number + 1]


def test_a_layer_in_place_writes_the_blob_that_it_reads(work: Path) -> None:
    (work / "net.prototxt").write_text(
        NET.split('    layer { name: "loss"')[0]
        + ('layer { name: "r" type: "ReLU" bottom: "a_top" top: "a_top" }')
    )
    net = pycaffe.Net("net.prototxt", netlib.TEST)
    assert net._bottom_ids(2) == net._top_ids(2) == net._top_ids(1) == net._outputs == [1]


def test_the_compiled_module() -> None:
    """caffe._caffe has the names of pycaffe's compiled module, and caffe those of them that
    pycaffe imports.
    """
    assert all(
        getattr(caffe, name) is getattr(_caffe, name)
        for name in set(_caffe.__all__) & set(caffe.__all__)
    )
    assert caffe.Net is pycaffe.Net
    assert caffe.Layer is netlib.Layer
    assert _caffe.__version__ == caffe.__version__


LAYER = """
import caffe
from caffe import _caffe

class Twice(caffe.Layer):
    def __init__(self, param):
        super().__init__(param)
        assert type(param) is _caffe.LayerParameter
    def setup(self, bottom, top):
        self.blobs.add_blob(1)
        assert type(self.blobs) is _caffe.BlobVec and type(self.blobs[0]) is _caffe.Blob
        self.seen = {"setup"}
        top[0].reshape(*bottom[0].shape)  # here alone, as published layers do
    def look(self, method, *vectors):
        self.seen.add(method)
        for vector in vectors:
            assert type(vector) is _caffe.RawBlobVec and all(type(blob) is _caffe.Blob for blob in vector), vector
    def reshape(self, bottom, top):
        self.look("reshape", bottom, top)
    def forward(self, bottom, top):
        self.look("forward", bottom, top)
        top[0].data[...] = 2 * bottom[0].data
    def backward(self, top, propagate_down, bottom):
        self.look("backward", bottom, top)
        assert type(propagate_down) is _caffe.BoolVec
        bottom[0].diff[...] = 2 * top[0].diff
"""
CONVOLUTIONS = """
    name: "n" force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 4 dim: 2 dim: 8 dim: 8 } } }
    layer { name: "conv" type: "Convolution" bottom: "x" top: "conv"
            convolution_param { num_output: 3 kernel_size: 3 weight_filler { type: "xavier" } } }
    layer { name: "twice" type: "Python" bottom: "conv" top: "twice"
            python_param { module: "twice" layer: "Twice" } }
    layer { name: "loss" type: "Reduction" bottom: "twice" top: "loss" loss_weight: 1 }
"""


def assert_classes_of(net: pycaffe.Net, cls: type = caffe.Net) -> None:
    """The classes of everything in a net are those of pycaffe (python/caffe/_caffe.cpp and
    pycaffe.py), by identity.
    """
    vectors: dict[str, tuple[Any, Any]] = {
        "layers": (net.layers, _caffe.LayerVec),
        "_blobs": (net._blobs, _caffe.BlobVec),
        "_blob_names": (net._blob_names, _caffe.StringVec),
        "_layer_names": (net._layer_names, _caffe.StringVec),
        "_inputs": (net._inputs, _caffe.IntVec),
        "_outputs": (net._outputs, _caffe.IntVec),
        "_bottom_ids": (net._bottom_ids(1), _caffe.IntVec),
        "_top_ids": (net._top_ids(1), _caffe.IntVec),
        "_blob_loss_weights": (net._blob_loss_weights, _caffe.DtypeVec),
        "inputs": (net.inputs, list),
        "outputs": (net.outputs, list),
        "net": (net, cls),
        "forward": (net.forward(), dict),
        "backward": (net.backward(), dict),
        **{
            name: (getattr(net, name), OrderedDict)
            for name in (
                "blobs",
                "params",
                "layer_dict",
                "top_names",
                "bottom_names",
                "blob_loss_weights",
            )
        },
        **{f"blobs of {layer.type}": (layer.blobs, _caffe.BlobVec) for layer in net.layers},
        **{f"params[{name!r}]": (blobs, _caffe.BlobVec) for name, blobs in net.params.items()},
    }
    assert {name: type(value) for name, (value, _) in vectors.items()} == {
        name: wanted for name, (_, wanted) in vectors.items()
    }
    blobs = [
        *net.blobs.values(),
        *net._blobs,
        *(blob for layer in net.layers for blob in layer.blobs),
    ]
    assert {type(blob) for blob in blobs} == {_caffe.Blob}
    assert {type(array) for blob in blobs for array in (blob.data, blob.diff)} == {np.ndarray}
    assert {
        type(names) for found in (net.top_names, net.bottom_names) for names in found.values()
    } == {list}
    assert all(isinstance(layer, caffe.Layer) for layer in [*net.layers, *net.layer_dict.values()])


def test_classes_are_pycaffes_by_identity(work: Path, module: MakeModule) -> None:
    """Scripts compare them by ``type(x) is caffe._caffe.BlobVec``: in a net, a solver's nets and
    a Python layer.

    get_solver uses the file's type; a solver class uses its own update rule regardless of it.
    """
    module("twice", LAYER)
    (work / "net.prototxt").write_text(CONVOLUTIONS)
    assert_classes_of(caffe.Net("net.prototxt", caffe.TEST))
    assert_classes_of(caffe.Classifier("net.prototxt", None), caffe.Classifier)
    assert type(caffe.Classifier("net.prototxt", None).transformer) is caffe.io.Transformer
    for name in ("SGD", "Nesterov", "AdaGrad", "RMSProp", "AdaDelta", "Adam"):
        (work / "solver.prototxt").write_text(
            f'{SOLVER} type: "{name}" test_net: "net.prototxt" test_iter: 1 test_interval: 1'
        )
        solver = caffe.get_solver("solver.prototxt")
        cls = getattr(_caffe, f"{name}Solver")
        assert (
            type(solver) is type(cls("solver.prototxt")) is cls is getattr(caffe, f"{name}Solver")
        )
        assert cls.__name__ == f"{name}Solver"
        assert issubclass(cls, caffe.SGDSolver)
        assert issubclass(cls, _caffe.Solver)
        assert type(solver.param) is _caffe.SolverParameter
        assert type(solver.test_nets) is _caffe.NetVec
    assert [
        len(cls("solver.prototxt").history[0]) for cls in (caffe.AdamSolver, caffe.SGDSolver)
    ] == [2, 1]
    solver.step(1)
    for net in (solver.net, *solver.test_nets):
        assert_classes_of(net)
        assert net.layer_dict["twice"].seen == {"setup", "reshape", "forward", "backward"}


@pytest.mark.parametrize(
    "args", [((), {"phase": 1, "weights": "w"}), ((1, 0, None, "w"), {}), (("w", 1), {})]
)
def test_constructors(net: pycaffe.Net, args: tuple[tuple[object, ...], dict[str, object]]) -> None:
    """Phase, level, stages and weights are accepted by position or name, and in
    pycaffe's older order.
    """
    net.save("w")
    positional, named = args
    made = pycaffe.Net("net.prototxt", *positional, **named)
    assert made.phase == netlib.TEST
    assert np.array_equal(made.params["a"][0].data, net.params["a"][0].data)


def test_forward_and_backward_return_what_pycaffes_do(net: pycaffe.Net) -> None:
    """forward returns the outputs or the tops of ``end``; backward the diffs of inputs or of the
    bottoms of ``end``.
    """
    assert set(net.forward(x=X)) == {"l", "y"}
    assert set(net.forward(["x"], end="a")) == {"a_top", "x"}
    assert set(net.backward()) == {"x"}
    assert set(net.backward(["a_top"], start="loss", end="a")) == {"x_x_0_split_0", "a_top"}


def test_parts_by_number(net: pycaffe.Net) -> None:
    """``_forward`` returns the loss of the layers that it runs."""
    net.blobs["x"].data[...] = X
    assert net._forward(0, 5) == pytest.approx(2 * float(net.blobs["l"].data))
    assert net._forward(5, 5) == 0
    net._backward(5, 0)
    assert net.params["a"][0].diff.any()


def test_parameters_of_another_net(net: pycaffe.Net) -> None:
    """An assigned parameter, also by ``layers``, is the one that forward uses and that
    files contain.
    """
    other = pycaffe.Net("net.prototxt", netlib.TRAIN)
    other.params["a"][0] = net.params["a"][0]
    other.layers[list(other._layer_names).index("a")].blobs[1] = net.params["a"][1]
    assert net.params["a"][0].data.any()
    assert_array_equal(other.forward(x=X)["y"], net.forward(x=X)["y"])
    net.params["a"][0].data[...] *= 2
    assert_array_equal(other.forward(x=X)["y"], net.forward(x=X)["y"])
    other.save("a.caffemodel")
    again = pycaffe.Net("net.prototxt", netlib.TEST, weights="a.caffemodel")
    assert_array_equal(again.forward(x=X)["y"], net.forward(x=X)["y"])


@pytest.mark.parametrize("count", [2, 5, 6])
def test_any_number_of_items(net: pycaffe.Net, count: int, rng: np.random.Generator) -> None:
    x = rng.normal(size=(count, 3)).astype(np.float32)
    w, b = (blob.data for blob in net.params["a"])
    deploy = pycaffe.Net("net.prototxt", netlib.TEST)
    deploy.share_with(net)
    for found in (net.forward_all(["a_top"], x=x), deploy.forward_all(["a_top"], x=x)):
        assert found["y"].shape == (count, 3)
        assert np.allclose(found["a_top"], x @ w.T + b, atol=1e-5)
    data, diffs = net.forward_backward_all(
        ["a_top"], ["a_top"], x=x, y=np.ones((count, 3), np.float32)
    )
    assert data["y"].shape == diffs["x"].shape == (count, 3)


def test_one_value_for_each_channel_fills_the_input() -> None:
    """As pycaffe's assignment to the blob; any other size reshapes the net."""
    Path("wide.prototxt").write_text(
        inputs(x=(1, 2, 3, 4)) + 'layer { name: "p" type: "Power" bottom: "x" top: "y" }'
    )
    net = pycaffe.Net("wide.prototxt", netlib.TEST)
    given = np.float32([[[[1]], [[2]]]])
    assert np.array_equal(net.forward_all(x=given)["y"], given + np.zeros((1, 2, 3, 4)))
    assert net.forward(x=np.zeros((5, 2, 6, 1)))["y"].shape == (5, 2, 6, 1)


@pytest.mark.parametrize(
    ("shape", "given"), [((1, 1), (1,)), ((2, 3), (2, 1)), ((1, 3, 2, 2), (4, 1, 2, 2))]
)
def test_an_array_fills_the_axes_after_the_first(
    shape: tuple[int, ...], given: tuple[int, ...]
) -> None:
    """LRCN's captioner gives an input of shape (1, 1) a word of shape (1,)."""
    Path("wide.prototxt").write_text(
        inputs(x=shape) + 'layer { name: "p" type: "Power" bottom: "x" top: "y" }'
    )
    net = pycaffe.Net("wide.prototxt", netlib.TEST)
    x = np.arange(np.prod(given), dtype=np.float32).reshape(given)
    assert_array_equal(net.forward(x=x)["y"], np.broadcast_to(x, (given[0], *shape[1:])))


def test_a_row_is_no_batch() -> None:
    """NumPy would repeat it; in pycaffe, the input is not batch sized."""
    Path("rows.prototxt").write_text(
        inputs(x=(2, 3)) + 'layer { name: "p" type: "Power" bottom: "x" top: "y" }'
    )
    net = pycaffe.Net("rows.prototxt", netlib.TEST)
    with pytest.raises(NetlibError, match=r"shape \(2, 3\), got an array of shape \(3,\)"):
        net.forward(x=np.zeros(3))


def test_hooks_are_called_around_every_layer(net: pycaffe.Net) -> None:
    """Hooks receive the number of the layer, in reverse order for backward, and do not
    change the results.
    """
    plain = net.forward(x=X)["y"].copy()
    calls: list[tuple[str, int]] = []

    def record(what: str) -> Callable[[int], None]:
        return lambda number: calls.append((what, number))

    net.before_forward(record("before"))
    net.after_forward(record("after"))
    assert np.array_equal(net.forward(x=X)["y"], plain)
    assert calls == [(what, number) for number in range(6) for what in ("before", "after")]
    calls.clear()
    net.before_backward(record("before"))
    net.after_backward(record("after"))
    net.backward()
    assert calls == [
        (what, number) for number in reversed(range(6)) for what in ("before", "after")
    ]


def test_weights_in_both_formats(net: pycaffe.Net) -> None:
    """``save_hdf5`` writes HDF5 regardless of the file name; ``load_hdf5`` reads it."""
    net.save_hdf5("weights")
    assert Path("weights").read_bytes().startswith(b"\x89HDF")
    other = pycaffe.Net("net.prototxt", netlib.TRAIN)
    other.load_hdf5("weights")
    assert np.array_equal(other.params["a"][0].data, net.params["a"][0].data)


def test_images_in_memory() -> None:
    """set_input_arrays passes images to a MemoryData layer, which must be the first layer."""
    memory = "memory_data_param { batch_size: 2 channels: 1 height: 1 width: 3 }"
    Path("m.prototxt").write_text(
        f'layer {{ name: "m" type: "MemoryData" top: "d" top: "t" {memory} }}'
    )
    net = pycaffe.Net("m.prototxt", netlib.TEST)
    net.set_input_arrays(
        np.arange(12, dtype=np.float32).reshape(4, 1, 1, 3), np.arange(4, dtype=np.float32)
    )
    net.forward()
    assert net.forward()["t"].ravel().tolist() == [2, 3]
    with pytest.raises(NetlibError, match=r"set_input_arrays .* MemoryData layer"):
        pycaffe.Net("net.prototxt", netlib.TEST).set_input_arrays(X, X)


def test_solver_mode_gpu_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    """The file is read twice."""
    caplog.set_level(logging.INFO, "netlib")
    Path("gpu.prototxt").write_text(SOLVER + " solver_mode: GPU")
    pycaffe.get_solver("gpu.prototxt")
    assert caplog.messages.count("solver_mode: GPU is accepted, but this runs on the CPU") == 1


@pytest.mark.parametrize("kind", ["SGD", "Nesterov", "AdaGrad", "RMSProp", "AdaDelta", "Adam"])
def test_a_loop_by_hand_is_the_solvers_loop(kind: str) -> None:
    """forward, backward and apply_update give the bits of step."""
    momentum = "momentum: 0.9" if kind in ("SGD", "Nesterov", "Adam") else ""
    Path("kind.prototxt").write_text(f'{SOLVER} type: "{kind}" {momentum} random_seed: 3')
    solvers = [pycaffe.get_solver("kind.prototxt") for _ in range(2)]
    solvers[0].step(5)
    for _ in range(5):
        solvers[1].net.clear_param_diffs()
        solvers[1].net.forward()
        solvers[1].net.backward()
        solvers[1].apply_update()
    stepped, by_hand = ([param.blob.data for param in solver.net.learnable] for solver in solvers)
    assert [solver.iter for solver in solvers] == [5, 5]
    assert all(map(np.array_equal, stepped, by_hand))


def test_options_may_change_while_it_trains() -> None:
    solver = pycaffe.SGDSolver("solver.prototxt")
    assert (solver.lr, solver.param.max_iter) == (0.5, 4)
    solver.param.base_lr = 0.25
    assert solver.lr == 0.25
    solver.step(2)
    assert solver.lr == pytest.approx(0.025)
    solver.param.average_loss = 3
    solver.step(4)
    assert len(solver.smoothed) == 3


FIXED = "is read once, when the solver is made; change it in the file"


@bad_inputs(
    PrototxtError,
    {
        "type": (("type", "Adam"), AttributeError, f"type {FIXED}"),
        "random_seed": (("random_seed", 3), AttributeError, f"random_seed {FIXED}"),
        "base_rate": (("base_rate", 1), AttributeError, "a solver has no option 'base_rate'"),
        "momentum": (
            ("momentum", 2.0),
            "solver.prototxt:1:1: error: momentum 2 must be at least 0 and less than 1",
        ),
        "base_lr": (
            ("base_lr", "x"),
            "solver.prototxt:1:21: error: 'base_lr' expects a number, found 'x'",
        ),
        "max_iter": (
            ("max_iter", 2.5),
            "solver.prototxt:1:75: error: 'max_iter' expects an integer ..., found 2.5",
        ),
        "more than 64 bits": (
            ("max_iter", 1 << 64),
            "solver.prototxt:1:75: error: 'max_iter' expects an integer ..., found 18446744073709551616",
        ),
        "stepvalue": (
            ("stepvalue", 3),
            "solver.prototxt:1:1: error: 'stepvalue' expects a list, each ..., found 3",
        ),
        "debug_info": (
            ("debug_info", 1),
            "solver.prototxt:1:1: error: 'debug_info' expects true or false, found 1",
        ),
        "snapshot_format": (
            ("snapshot_format", "h5"),
            "solver.prototxt:1:1: error: 'snapshot_format' expects HDF5 or BINARYPROTO, found 'h5'",
        ),
    },
)
def test_invalid_changes_of_options_are_rejected(given: tuple[str, object], rejected) -> None:
    solver = pycaffe.SGDSolver("solver.prototxt")
    before = repr(solver.param)
    with rejected:
        setattr(solver.param, *given)
    assert repr(solver.param) == before


@pytest.mark.parametrize("name", ["net", "test_nets"])
def test_the_nets_of_a_solver_cannot_be_replaced(name: str) -> None:
    solver = pycaffe.SGDSolver("solver.prototxt")
    nets = getattr(solver, name)
    with pytest.raises(AttributeError, match=rf"solver\.{name} cannot be replaced, as in pycaffe"):
        setattr(solver, name, nets)
    solver.notes = "a script's own"
    assert getattr(solver, name) is nets


def test_an_input_may_be_written_before_its_batch_is_made_smaller(net: pycaffe.Net) -> None:
    whole = net.forward(x=X)["y"].copy()
    net.blobs["x"].data[...] = X
    net.blobs["x"].reshape(1, 3)
    assert np.allclose(net.forward()["y"], whole[:1])


def test_a_solver_lends_its_weights() -> None:
    solver = pycaffe.SGDSolver("solver.prototxt")
    net = pycaffe.Net("net.prototxt", netlib.TEST)
    solver.share_weights(net)
    solver.net.params["a"][0].data[...] = 7
    assert (net.params["a"][0].data == 7).all()


def test_each_gpu_function_is_reported_once(caplog: pytest.LogCaptureFixture) -> None:
    warn_once.cache_clear()
    for _ in range(2):
        netlib.set_mode_gpu()
        _caffe.set_device(0)
        netlib.set_mode_cpu()
    assert caplog.messages == [
        "set_mode_gpu: accepted, but this runs on the CPU",
        "set_device(0): accepted, but this runs on the CPU",
    ]


def test_one_solver_in_one_process() -> None:
    _caffe.set_solver_count(1)
    _caffe.set_solver_rank(0)
    _caffe.set_multiprocess(True)
    assert (_caffe.solver_count(), _caffe.solver_rank(), _caffe.has_nccl()) == (1, 0, False)
    for call in (
        lambda: _caffe.set_solver_count(2),
        lambda: _caffe.set_solver_rank(1),
        _caffe.NCCL.new_uid,
    ):
        with pytest.raises(NotImplementedError):
            call()


def test_one_solver_of_several_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    """The count and rank are those of the ranks that train together; setting other values
    raises an error.
    """

    class OneOfThree(Ranks):
        rank, count = 1, 3

    monkeypatch.setattr(ranks, "latest", OneOfThree())
    assert (_caffe.solver_count(), _caffe.solver_rank()) == (3, 1)
    _caffe.set_solver_count(3)
    with pytest.raises(NotImplementedError, match=r"docs/distributed\.md"):
        _caffe.set_solver_rank(0)


def test_the_log(
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    logger = logging.getLogger("netlib")
    monkeypatch.setattr(logger, "handlers", [])
    level = logger.level
    _caffe.init_log(0)
    _caffe.log("100% mine")
    _caffe.init_log(1)
    _caffe.log("not heard")
    logger.setLevel(level)
    assert caplog.messages == ["100% mine"]
    assert re.fullmatch(
        r"I\d{4} \d\d:\d\d:\d\d\.\d{6} \d+ _caffe\.py:\d+\] 100% mine\n", capsys.readouterr().err
    )


def test_a_timer() -> None:
    timer = _caffe.Timer()
    assert timer.ms == 0
    timer.start()
    timer.stop()
    assert timer.ms > 0
