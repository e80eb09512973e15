"""Solver: training, reports, snapshots, and exact resume."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from netlib.proto.messages import NetState
from netlib.snapshots import binary_format, snapshot
from netlib.snapshots.solver_state import SolverState
from tests.netlib.conftest import ONE_WEIGHT, WEIGHT_WITH, MakeSolver, everything
from tests.support.bad_input import bad_inputs, in_table
from tests.support.hdf5_files import write_hdf5
from tests.support.tables import lines_of

Messages = Callable[[str], list[str]]
pytestmark = pytest.mark.both_engines

# Shuffled data, dropout and random noise: all state that an exact resume must restore.
RANDOM = """
    layer { name: "data" type: "HDF5Data" top: "x" top: "t" include { phase: TRAIN }
            hdf5_data_param { source: "train.txt" batch_size: 5 shuffle: true } }
    layer { name: "data" type: "HDF5Data" top: "x" top: "t" include { phase: TEST }
            hdf5_data_param { source: "test.txt" batch_size: 3 } }
    layer { name: "noise" type: "DummyData" top: "noise"
            dummy_data_param { shape { dim: 3 } data_filler { type: "gaussian" std: 0.1 } } }
    layer { name: "quiet" type: "Silence" bottom: "noise" }
    layer { name: "conv" type: "Convolution" bottom: "x" top: "conv"
            convolution_param { num_output: 3 kernel_size: 3 weight_filler { type: "xavier" } } }
    layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
    layer { name: "drop" type: "Dropout" bottom: "conv" top: "conv" }
    layer { name: "ip" type: "InnerProduct" bottom: "conv" top: "y"
            inner_product_param { num_output: 2 weight_filler { type: "xavier" } } }
    layer { name: "loss" type: "EuclideanLoss" bottom: "y" bottom: "t" top: "loss" }
"""
RULES = {
    "SGD": "momentum: 0.9",
    "Nesterov": 'type: "Nesterov" momentum: 0.9',
    "AdaGrad": 'type: "AdaGrad"',
    "RMSProp": 'type: "RMSProp" rms_decay: 0.9',
    "AdaDelta": 'type: "AdaDelta" momentum: 0.9',
    "Adam": 'type: "Adam" momentum: 0.9',
}


@pytest.fixture
def rows(write_rows: Callable[..., Path]) -> None:
    """Write train.txt with 7 + 4 rows and test.txt with 4."""
    write_rows("train.txt", [7, 4], x=(1, 5, 5), t=(2,))
    write_rows("test.txt", [4], seed=1, x=(1, 5, 5), t=(2,))


@pytest.fixture
def messages(caplog: pytest.LogCaptureFixture) -> Messages:
    """``messages("loss")``: the lines of the log that contain this text."""
    caplog.set_level("INFO", "netlib")
    return lambda part: [line.strip() for line in caplog.messages if part in line]


def weight(solver: netlib.Solver) -> float:
    return float(solver.net.params["ip"][0].data.item())


@pytest.mark.parametrize(
    ("param", "options", "expected"), lines_of(Path(__file__).with_name("one_update.txt"))
)
def test_one_update_by_hand(solver_of: MakeSolver, param: str, options: str, expected: str) -> None:
    """The sum is clipped, divided by iter_size, decayed, and passed to the update rule,
    in this order.
    """
    solver = solver_of(WEIGHT_WITH % param, options)
    solver.step(1)
    assert weight(solver) == pytest.approx(float(expected), rel=1e-6)
    assert solver.iter == 1


def test_debug_info_shows_every_blob(solver_of: MakeSolver, messages: Messages) -> None:
    """debug_info logs mean absolute values: x = 2, y = 2 and the gradient 2."""
    solver_of(WEIGHT_WITH % 'param { name: "w" }', "display: 1 debug_info: true").step(1)
    assert "[Forward] Layer ip, top blob y data: 2" in messages("[Forward]")
    assert "[Forward] Layer ip, param blob w data: 1" in messages("[Forward]")
    assert messages("[Backward]") == [
        "[Backward] Layer loss, bottom blob y diff: 1",
        "[Backward] Layer ip, param blob 0 diff: 2",
        "[Backward] All net params (data, diff): L1 norm = (1, 2); L2 norm = (1, 2)",
    ]
    assert "[Update] Layer ip, param 0 data: 1; diff: 2" in messages("[Update]")


def test_debug_info_leaves_out_the_gradients_of_frozen_parameters(
    solver_of: MakeSolver, messages: Messages
) -> None:
    """As in Caffe, which does not compute them. The bias is 0, its gradient 1."""
    net = (WEIGHT_WITH % "param { lr_mult: 0 }").replace("bias_term: false", "")
    solver_of(net, "display: 1 debug_info: true").step(1)
    assert messages("[Backward]")[1:] == [
        "[Backward] Layer ip, param blob 1 diff: 1",
        "[Backward] All net params (data, diff): L1 norm = (1, 1); L2 norm = (1, 1)",
    ]


def test_debug_info_shows_a_blob_before_a_layer_in_place(
    solver_of: MakeSolver, messages: Messages
) -> None:
    """For a blob in place, the values after each layer are logged: y is 2, then 4; its gradient
    is 1, then 0.5.
    """
    ip = ONE_WEIGHT.split('layer { name: "loss"')[0]
    text = """
        layer { name: "half" type: "Power" bottom: "y" top: "y" power_param { scale: 0.5 shift: 3 } }
        layer { name: "sum" type: "Reduction" bottom: "y" top: "sum" loss_weight: 1 }
    """
    solver_of(ip + text, "base_lr: 0 display: 2 debug_info: true").step(2)
    assert [line for line in messages("[Forward]") if "blob y " in line] == [
        "[Forward] Layer ip, top blob y data: 2",
        "[Forward] Layer half, top blob y data: 4",
    ]
    assert [line for line in messages("[Backward]") if "blob y " in line] == [
        "[Backward] Layer sum, bottom blob y diff: 1",
        "[Backward] Layer half, bottom blob y diff: 0.5",
    ]


def test_a_step_of_multistep_is_logged(solver_of: MakeSolver, messages: Messages) -> None:
    solver_of(ONE_WEIGHT, 'lr_policy: "multistep" gamma: 0.1 stepvalue: 1 stepvalue: 3').step(5)
    assert messages("MultiStep") == [
        "MultiStep Status: Iteration 1, step = 1",
        "MultiStep Status: Iteration 3, step = 2",
    ]


@pytest.mark.parametrize(
    "policy", ['"exp" gamma: 1.5', '"step" stepsize: 1 gamma: 10', '"inv" gamma: 1 power: -400']
)
def test_an_overflow_of_the_learning_rate_ends_the_training(
    solver_of: MakeSolver, policy: str
) -> None:
    solver = solver_of(WEIGHT_WITH % "param { lr_mult: 0 }", f"lr_policy: {policy}")
    solver.iter = 10**4
    with pytest.raises(netlib.DivergenceError, match="iteration 10000: learning rate overflow"):
        solver.step(1)


@pytest.mark.parametrize(
    ("of_net", "of_solver", "state"),
    [
        ("", "", NetState("TRAIN", 0)),
        ("", "level: -1", NetState("TRAIN", -1)),
        ("level: 7", "", NetState("TRAIN", 7)),
        ("level: 7", "level: 0", NetState("TRAIN", 0)),
        ("", "phase: TEST", NetState("TEST", 0)),
        ("phase: TEST", "", NetState("TEST", 0)),
        ("phase: TEST", "phase: TRAIN", NetState("TRAIN", 0)),
        ('stage: "a"', 'stage: "b"', NetState("TRAIN", 0, ("a", "b"))),
    ],
)
def test_the_state_of_the_training_net(
    solver_of: MakeSolver, of_net: str, of_solver: str, state: NetState
) -> None:
    """train_state takes precedence over the net's state, then phase TRAIN and level 0;
    stages are added up.
    """
    solver = solver_of(ONE_WEIGHT + f"state {{ {of_net} }}", f"train_state {{ {of_solver} }}")
    assert solver.net.state == state


def test_without_test_iter_nothing_is_tested(solver_of: MakeSolver, messages: Messages) -> None:
    solver = solver_of(ONE_WEIGHT, "test_interval: 1 max_iter: 2")
    assert solver.test_nets == []
    assert solver.solve()
    assert len(messages("test_interval without test_iter")) == 1


def test_a_test_iter_of_0_builds_the_test_net_only(
    solver_of: MakeSolver, messages: Messages
) -> None:
    """Solvers of scripts that test by themselves, such as that of HED, have a test net and a
    test_iter of 0.
    """
    solver = solver_of(ONE_WEIGHT, "test_iter: 0 test_interval: 1 max_iter: 2")
    assert len(solver.test_nets) == 1
    assert solver.solve()
    assert solver.test(0) == {}
    assert messages("Testing net")
    assert not messages("Test net output")


def test_an_output_of_changing_size_has_no_mean(
    solver_of: MakeSolver, monkeypatch: pytest.MonkeyPatch
) -> None:
    solver = solver_of(ONE_WEIGHT, "test_iter: 2 test_interval: 1")
    [net], sizes = solver.test_nets, iter([1, 2])
    monkeypatch.setattr(net, "run_forward", lambda: net.blobs["loss"].reshape(next(sizes)) or 0.0)
    with pytest.raises(netlib.LayerError, match="output 'loss' has 2 values in this batch, had 1"):
        solver.test(0)


def test_a_test_net_with_values_that_are_not_finite_is_reported(
    solver_of: MakeSolver, messages: Messages
) -> None:
    solver = solver_of(ONE_WEIGHT, "test_iter: 1 test_interval: 1")
    for weight, where in ((1, []), (np.nan, ["parameter 0 of layer 'ip'"])):
        solver.net.params["ip"][0].data[...] = weight
        solver.test_all()
        assert messages("not finite") == [
            f"Test net (#0) has a value that is not finite: {s}" for s in where
        ]


def test_test_nets_share_weights_and_are_averaged(solver_of: MakeSolver, rows: None) -> None:
    """Test nets share the weights, and outputs are averaged over the batches, with
    dropout disabled.
    """
    solver = solver_of(
        RANDOM, "test_iter: 2 test_interval: 2 test_initialization: false random_seed: 1"
    )
    solver.step(1)
    [means] = solver.test_all()
    plain = netlib.Net("net.prototxt", netlib.TEST)
    plain.copy_from(solver.net)
    losses = [float(plain.forward()["loss"]) for _ in range(2)]
    assert means["loss"][0] == pytest.approx(np.mean(losses), rel=1e-6)
    assert np.shares_memory(
        solver.test_nets[0].params["ip"][0].data, solver.net.params["ip"][0].data
    )


@pytest.mark.parametrize(
    ("options", "iterations"),
    [
        ("max_iter: 4 test_interval: 2", [0, 2, 4]),
        ("max_iter: 4 test_interval: 2 test_initialization: false", [2, 4]),
        ("max_iter: 5 test_interval: 2", [0, 2, 4]),
        ("max_iter: 4 test_interval: 9", [0]),
    ],
)
def test_when_tests_are_made(
    solver_of: MakeSolver, messages: Messages, options: str, iterations: list[int]
) -> None:
    """Tests run every test_interval iterations before the update, and at 0 unless
    test_initialization is false.
    """
    solver_of(ONE_WEIGHT, options + " test_iter: 1 snapshot_after_train: false").solve()
    assert messages("Testing net") == [f"Iteration {i}, Testing net (#0)" for i in iterations]


def test_several_test_nets(solver_of: MakeSolver, tmp_path: Path, messages: Messages) -> None:
    """``test_net`` files come first, then ``net`` for the remaining values of test_iter, each with
    its test_state.
    """
    extra = 'layer { name: "p" type: "Power" bottom: "x" top: "p" include { stage: "more" } }'
    (tmp_path / "other.prototxt").write_text(ONE_WEIGHT + extra)
    solver = solver_of(
        ONE_WEIGHT + extra,
        'test_net: "other.prototxt" test_iter: 1 test_iter: 2 test_interval: 5 '
        'test_state { } test_state { stage: "more" }',
    )
    assert [net.source for net in solver.test_nets] == ["other.prototxt", "net.prototxt"]
    assert ["p" in net.blobs for net in solver.test_nets] == [False, True]
    solver.step(1)
    assert messages("Testing net") == [f"Iteration 0, Testing net (#{i})" for i in (0, 1)]


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("max_iter: 5 snapshot: 2", [2, 4, 5]),
        ("max_iter: 4 snapshot: 2", [2, 4]),
        ("max_iter: 3", [3]),
        ("max_iter: 5 snapshot: 2 snapshot_after_train: false", [2, 4]),
        ("max_iter: 3 snapshot_after_train: false", []),
    ],
)
def test_when_snapshots_are_written(
    solver_of: MakeSolver, tmp_path: Path, options: str, expected: list[int]
) -> None:
    """Snapshots are written every ``snapshot`` updates and at the end, unless one
    was just written.
    """
    assert solver_of(ONE_WEIGHT, options).solve()
    names = sorted(
        f"snap_iter_{i}.{kind}" for i in expected for kind in ("caffemodel", "solverstate")
    )
    assert sorted(path.name for path in tmp_path.glob("snap*")) == names


@pytest.mark.parametrize(
    ("prefix", "stem"),
    [
        ('snapshot_prefix: "a/b"', "a/b"),
        ('snapshot_prefix: "new/"', "new/solver"),
        ('snapshot_prefix: "there"', "there/solver"),
        ('snapshot_prefix: ""', "solver"),
    ],
)
def test_snapshots_are_named_by_the_prefix_or_the_solver_file(
    solver_of: MakeSolver, tmp_path: Path, prefix: str, stem: str
) -> None:
    """Those in a folder, or without a prefix, are named after the solver file."""
    (tmp_path / "there").mkdir()
    state = solver_of(ONE_WEIGHT, prefix).snapshot()
    assert state == Path(f"{stem}_iter_0.solverstate")
    assert (tmp_path / f"{stem}_iter_0.caffemodel").exists()


def test_a_finished_training_of_another_prefix_is_written_there(
    solver_of: MakeSolver, tmp_path: Path
) -> None:
    first = solver_of(ONE_WEIGHT, "max_iter: 2")
    first.solve()
    state = first.snapshots.paths(2)[1]
    again = solver_of(ONE_WEIGHT, 'max_iter: 2 snapshot_prefix: "other"')
    assert again.solve(resume=state)
    assert Path("other_iter_2.caffemodel").exists()


def test_a_directory_that_cannot_be_written_is_found_before_training(
    solver_of: MakeSolver, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    solver = solver_of(ONE_WEIGHT, 'snapshot_prefix: "file/x" max_iter: 2')
    with pytest.raises(netlib.WeightsError, match=r"^file: cannot write snapshots there: "):
        solver.solve()
    assert solver.iter == 0


@pytest.mark.parametrize("request_", ["stop", "snapshot"])
def test_a_request_is_met_after_the_iteration(
    solver_of: MakeSolver, tmp_path: Path, request_: str
) -> None:
    solver = solver_of(ONE_WEIGHT, "max_iter: 6 snapshot_after_train: false")

    def ask() -> None:
        if solver.iter == 3:
            solver.requested = request_

    solver.on_update.append(ask)
    assert solver.solve() == (request_ == "snapshot")
    assert solver.iter == (3 if request_ == "stop" else 6)
    assert [path.name for path in tmp_path.glob("*.solverstate")] == ["snap_iter_3.solverstate"]
    assert solver.requested is None


@pytest.mark.parametrize("rule", list(RULES))
def test_the_gradients_become_the_update(solver_of: MakeSolver, rows: None, rule: str) -> None:
    """As in Caffe: scripts compare it with the weights, and loops by hand without
    clear_param_diffs add to it.
    """
    solver = solver_of(RANDOM, f"{RULES[rule]} base_lr: 0.01 weight_decay: 0.01 iter_size: 2")
    solver.step(1)
    before = [param.blob.data.copy() for param in solver.net.learnable]
    solver.step(1)
    for param, w in zip(solver.net.learnable, before):
        assert param.blob.diff.any()
        np.testing.assert_allclose(param.blob.diff, w - param.blob.data, rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("rule", list(RULES))
def test_n_updates_resume_n_more_equal_2n(
    solver_of: MakeSolver, rows: None, messages: Messages, rule: str
) -> None:
    """A resume is exact to the bit with dropout, shuffled data, a step policy and an averaged loss,
    without a seed: in a new solver, and in the same one, which goes back.
    """
    options = RULES[rule] + (
        ' base_lr: 0.01 lr_policy: "step" stepsize: 5 gamma: 0.5 weight_decay: 0.01 average_loss: 9 iter_size: 2'
        " test_iter: 1 test_interval: 3"
    )
    whole = solver_of(RANDOM, options)
    whole.step(7)
    state = whole.snapshot()
    whole.step(7)
    wanted = everything(whole), whole.test(0)["loss"][0]
    for resumed in (solver_of(RANDOM, options), whole):
        resumed.restore(state)
        assert resumed.iter == len(resumed.smoothed) == 7
        resumed.step(7)
        assert resumed.iter == 14
        assert (everything(resumed), resumed.test(0)["loss"][0]) == wanted
    assert len(messages("Resuming at iteration 7: weights from snap_iter_7.caffemodel")) == 2
    assert len(messages("the resume is exact")) == 2
    assert not messages("Changed")


@pytest.mark.parametrize(
    ("net", "options", "line"),
    [
        (RANDOM, "base_lr: 0.05", "Changed: base_lr was 0.1, is now 0.05"),
        (
            RANDOM.replace("batch_size: 5", "batch_size: 4"),
            "",
            "Changed: batch size was 5, is now 4",
        ),
        (RANDOM, "weight_decay: 0.1", "Changed: weight_decay was 0, is now 0.1"),
        (RANDOM, 'lr_policy: "exp" gamma: 0.5', "Changed: lr_policy was fixed, is now exp"),
        (RANDOM, "rampup_interval: 8", "Changed: rampup_interval was 0, is now 8"),
        (
            RANDOM.replace("train.txt", "test.txt"),
            "",
            "Changed: the data files; reading starts at the first row",
        ),
    ],
)
def test_resume_says_what_changed(
    solver_of: MakeSolver, rows: None, messages: Messages, net: str, options: str, line: str
) -> None:
    state = solver_of(RANDOM).snapshot()
    solver_of(net, options).restore(state)
    assert line in messages("Changed")
    assert not messages("the resume is exact")


def test_a_state_with_four_dimensional_histories(solver_of: MakeSolver, tmp_path: Path) -> None:
    """Histories with four axes, as older versions of Caffe stored them, are restored."""
    solver = solver_of(ONE_WEIGHT, "momentum: 0.9")
    solver.step(2)
    state = solver.snapshot()
    found = snapshot.read_state(state)
    old = SolverState(
        2, 0, found.learned_net, [array.reshape(1, 1, 1, 1) for array in found.history], {}
    )
    state.write_bytes(binary_format.state_image(old))
    again = solver_of(ONE_WEIGHT, "momentum: 0.9")
    again.restore(state)
    assert again.history[0][0].tolist() == solver.history[0][0].tolist() != [[0]]


def test_resume_of_moved_files(solver_of: MakeSolver, tmp_path: Path) -> None:
    solver = solver_of(ONE_WEIGHT)
    solver.step(2)
    state = solver.snapshot()
    (tmp_path / "moved").mkdir()
    for path in tmp_path.glob("snap*"):
        path.rename(tmp_path / "moved" / path.name)
    again = solver_of(ONE_WEIGHT)
    again.restore(tmp_path / "moved" / state.name)
    assert weight(again) == weight(solver)


OTHER = (
    "this state is of the solver type SGD, whose history has another meaning for {}; "
    'expected type: "SGD", or a new training from the weights (--weights)'
)
BIAS, TWO_INPUTS = ("bias_term: false", ""), ("dim: 1 dim: 1", "dim: 1 dim: 2")


@bad_inputs(
    netlib.WeightsError,
    {
        f"{replaced} {options}": ((replaced, options), f"snap_iter_1.solverstate: {line}")
        for replaced, options, line in (
            (("", ""), 'type: "Adam" momentum: 0.9', OTHER.format("Adam")),
            (("", ""), 'type: "AdaGrad"', OTHER.format("AdaGrad")),
            (
                BIAS,
                "",
                "1 histories, but SGD on this net has 2; it is probably from another solver type or net",
            ),
            (TWO_INPUTS, "", "history 0 has shape (1, 1), layer 'ip' parameter 0 (1, 2)"),
        )
    },
)
def test_a_state_of_another_solver_or_net_changes_nothing(
    solver_of: MakeSolver, given: tuple[tuple[str, str], str], rejected: Any
) -> None:
    solver = solver_of(ONE_WEIGHT)
    solver.step(1)
    state = solver.snapshot()
    other = solver_of(ONE_WEIGHT.replace(*given[0], 1), given[1])
    before = everything(other)
    with rejected:
        other.restore(state)
    assert everything(other) == before


def test_weights_of_another_net_change_nothing(solver_of: MakeSolver, tmp_path: Path) -> None:
    solver = solver_of(ONE_WEIGHT, "momentum: 0.9")
    solver.step(1)
    state = solver.snapshot()
    write_hdf5(tmp_path / "snap_iter_1.caffemodel", **{"data/ip/0": np.zeros((2, 2), np.float32)})
    solver.step(1)
    before = everything(solver)
    with pytest.raises(netlib.WeightsError, match="belong to another snapshot"):
        solver.restore(state)
    assert everything(solver) == before


def test_a_nan_behind_finite_weights_names_the_top(solver_of: MakeSolver) -> None:
    log = 'layer { name: "log" type: "Log" bottom: "y" top: "logy" } layer { name: "loss"'
    text = ONE_WEIGHT.replace('layer { name: "loss"', log).replace(
        'bottom: "y" bottom: "t"', 'bottom: "logy" bottom: "t"'
    )
    solver = solver_of(text.replace("weight_filler { value: 1 }", "weight_filler { value: -1 }"))
    with (
        pytest.raises(
            netlib.DivergenceError, match=r"the loss is nan; .* in top blob 'logy' of layer 'log'"
        ),
        np.errstate(all="ignore"),
    ):
        solver.step(1)


def test_a_diverging_training_leaves_the_last_good_snapshot(
    solver_of: MakeSolver, tmp_path: Path
) -> None:
    solver = solver_of(ONE_WEIGHT, "base_lr: 1e9 snapshot: 1 max_iter: 100")
    with (
        pytest.raises(netlib.DivergenceError, match=r"iteration \d+: the loss is inf.*'(ip|loss)'"),
        np.errstate(all="ignore"),
    ):
        solver.solve()
    for path in tmp_path.glob("*.caffemodel"):
        found = snapshot.read_weights(path)
        assert np.isfinite(found["ip"][0]).all(), path.name
    assert len(list(tmp_path.glob("*.caffemodel"))) == solver.iter


@bad_inputs(
    netlib.PrototxtError,
    in_table(Path(__file__).with_name("solver_mistakes.txt"), "solver.prototxt:1:"),
)
def test_mistakes_in_a_solver_point_at_their_place(
    solver_of: MakeSolver, given: str, rejected: Any
) -> None:
    with rejected:
        solver_of(ONE_WEIGHT, given)


@bad_inputs(
    netlib.PrototxtError,
    {
        **dict.fromkeys(
            (
                'layer { name: "a" type: "ReLU" }',
                'layers { name: "a" type: RELU }',
                'input: "data"',
            ),
            's.prototxt:1:1: error: this is a net; expected a solver, which names it: net: "FILE"',
        ),
        "no net": (
            'net: "gone.prototxt" base_lr: 1 lr_policy: "fixed"',
            netlib.NetlibError,
            "s.prototxt: the net "
            "'gone.prototxt' does not exist in the working directory or next to the solver",
        ),
    },
)
def test_files_without_a_solver_are_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, given: str, rejected: Any
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "s.prototxt").write_text(given)
    with rejected:
        netlib.get_solver("s.prototxt")


def test_the_older_solver_type_field(solver_of: MakeSolver) -> None:
    assert solver_of(ONE_WEIGHT, "solver_type: ADAM").param.type == "Adam"
