"""tools/caffe.py: Caffe's command line, and Caffe's log line for line."""

from __future__ import annotations

import re
import signal
from pathlib import Path

import pytest

from netlib.snapshots import binary_format, snapshot
from tests.caffe.recorded import COMPARED, check_same_log, log_lines, said, solver_text, texts
from tests.support.running import run_tool
from tests.tools.conftest import ROOT

SOLVERS = ROOT / "tests" / "caffe" / "solvers"
FRAME = re.compile(
    r"Use CPU|Creating t|Solver scaffolding|SGDSolver|Starting|Running|Batch|Loss:|\w+ = "
)


@pytest.fixture(autouse=True)
def solvers(monkeypatch):
    """Change to the folder of the recorded training runs, whose files name each other
    relative to it.
    """
    monkeypatch.chdir(SOLVERS)


def written(folder: Path, log: str, **changes: str) -> str:
    """Write the solver of a recorded log, with snapshots in the same folder; return its name."""
    path = folder / "solver.prototxt"
    path.write_text(solver_text(log, snapshot_prefix=f'"{folder}/a"', **changes))
    return str(path)


def log_of(command: str, status: int = 0) -> list[str]:
    """The lines that the command logs, with their stamps."""
    _, out, err = run_tool(f"caffe {command}", status=status)
    assert out == ""
    return err.splitlines()


@pytest.fixture(scope="module")
def trained(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """The folder and the log of the training of a_avgloss.log."""
    folder = tmp_path_factory.mktemp("trained")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(SOLVERS)
        solver = written(folder, "a_avgloss.log")
        return folder, log_of(f"train -solver {solver} --weights=init.caffemodel")


def spoken(lines: list[str]) -> list[str]:
    """Return the lines of a log that both programs write, including the first and the last."""
    both = [line for line in lines if COMPARED.match(line) or FRAME.match(line)]
    return [said([line])[0] if COMPARED.match(line) else line for line in both]


# -------------------------------------------------------------------------------------------- train


def test_train_writes_the_recorded_log(trained):
    """The log equals the recorded a_avgloss.log; Caffe loads the weights into both nets."""
    mine, theirs = texts(trained[1]), log_lines("a_avgloss.log")
    assert len(spoken(theirs)) == 46
    check_same_log(spoken(mine), spoken(theirs))
    assert "Finetuning from init.caffemodel" in mine
    assert "Finetuning from init.caffemodel" in theirs


def test_train_goes_on_from_a_snapshot(trained, tmp_path):
    """The log equals the recorded a_resume_from8.log, and the solver's ``weights`` are not read."""
    state_path = trained[0] / "a_iter_8.solverstate"
    state = snapshot.read_state(state_path)
    state.extra = {}  # fields that Caffe does not write
    state_path.write_bytes(binary_format.state_image(state))
    solver = written(tmp_path, "a_resume_from8.log", weights='"nothing.caffemodel"')
    mine = texts(log_of(f"train -solver={solver} -snapshot={state_path}"))
    check_same_log(spoken(mine), spoken(log_lines("a_resume_from8.log")))
    assert mine.index(f"Resuming from {state_path}") < mine.index("SGDSolver: restoring history")


@pytest.mark.parametrize(
    ("number", "flags", "last"),
    [
        (signal.SIGINT, "", 1),
        (signal.SIGHUP, "", 3),
        (signal.SIGINT, "-sigint_effect=snapshot", 3),
        (signal.SIGINT, "-sigint_effect=none", 3),
        (signal.SIGHUP, "-sighup_effect stop", 1),
        (signal.SIGTERM, "", 1),
    ],
    ids=["SIGINT", "SIGHUP", "SIGINT snapshot", "SIGINT none", "SIGHUP stop", "SIGTERM"],
)
def test_signals(tmp_path, signal_at_start, number, flags, last):
    """After a signal in the first iteration the exit status is 0 and the last lines are those
    of Caffe's log.

    SIGTERM ends Caffe at once; here a snapshot is written first, and the exit status is that
    of the signal.
    """
    short = written(
        tmp_path, "sigint.log", max_iter="3", test_interval="9", test_initialization="false"
    )
    signal_at_start(number)
    is_term = number == signal.SIGTERM
    lines = texts(log_of(f"train -solver {short} {flags}", status=143 if is_term else 0))
    assert ("Optimization stopped early." in lines[-2:]) == (last == 1)
    assert (lines[-1] == "Optimization Done.") == (not is_term)
    made = {path.name for path in tmp_path.glob("*.solverstate")}
    assert made == {f"a_iter_{last}.solverstate"} | (
        {"a_iter_1.solverstate"} if "none" not in flags else set()
    )
    # Caffe's
    assert log_lines("sigint.log")[-2:] == ["Optimization stopped early.", "Optimization Done."]


def test_level_and_stage_choose_layers(tmp_path):
    """-level and -stage select the training net's layers, in addition to the stages
    of train_state.
    """
    net = Path("net.prototxt").read_text()
    for name, rule in (
        ("a", 'stage: "a" stage: "own"'),
        ("b", "min_level: 2"),
        ("c", "min_level: 1"),
    ):
        net += f'layer {{ name: "{name}" type: "Silence" bottom: "ip1" include {{ phase: TRAIN {rule} }} }}\n'
    (tmp_path / "net.prototxt").write_text(net)
    solver = Path(
        written(
            tmp_path, "sigint.log", net=f'"{tmp_path}/net.prototxt"', max_iter="1", test_iter="1"
        )
    )
    solver.write_text(
        solver.read_text().replace("level: 0", "level: 7").replace('stage: ""', 'stage: "own"')
    )
    mine = texts(log_of(f"train -solver {solver} -stage a,x -level 1"))
    made = {
        line.removeprefix("Creating Layer ") for line in mine if line.startswith("Creating Layer ")
    }
    assert made & {"a", "b", "c"} == {"a", "c"}  # -level replaces the solver's level, as in Caffe


# --------------------------------------------------------------------------------------- the others


def test_test_writes_the_recorded_log():
    """The log has every batch, the mean loss, and every output with its loss
    weight, as recorded.
    """
    mine = texts(log_of("test -model net.prototxt -weights init.caffemodel -iterations 3"))
    theirs = log_lines("test.log")
    assert spoken(theirs)[-6:-2] == [
        "Running for 3 iterations.",
        "Batch 0, loss = 2.54403",
        "Batch 1, loss = 3.22669",
        "Batch 2, loss = 2.28123",
    ]
    check_same_log(spoken(mine), spoken(theirs))


def test_test_reports_unmatched_layers(tmp_path):
    """Weights of unknown layers are ignored with Caffe's message; layers without weights are
    also reported.
    """
    (tmp_path / "net.prototxt").write_text(
        Path("net.prototxt").read_text().replace('"ip1"', '"other"')
    )
    net = tmp_path / "net.prototxt"
    mine = texts(log_of(f"test -model {net} -weights init.caffemodel -iterations 1"))
    assert "Ignoring source layer ip1" in mine
    assert "Not in init.caffemodel, keeps its initial values: layer other" in mine


def test_time_writes_the_recorded_log():
    """The lines equal those of time.log from the first pass on, except for the times."""
    mine, theirs = (texts(log_of("time -model net.prototxt -iterations 3")), log_lines("time.log"))
    cut = [lines[lines.index("Performing Forward") :] for lines in (mine, theirs)]
    numberless = [
        [re.sub(r": [\d.e+-]+( ms\.)?", r": #\1", line) for line in lines] for lines in cut
    ]
    assert numberless[0] == numberless[1]
    assert len(cut[0]) == 30


@pytest.mark.parametrize(
    ("flags", "loss"), [("", "3"), ("-phase=TRAIN", "3"), ("-phase TEST", "5")]
)
def test_time_of_a_phase(tmp_path, flags, loss):
    """The phase is TRAIN by default."""
    layers = [
        f"""layer {{ name: "x" type: "DummyData" top: "x" include {{ phase: {phase} }} loss_weight: 1
        dummy_data_param {{ shape {{ dim: 1 }} data_filler {{ value: {value} }} }} }}"""
        for phase, value in (("TRAIN", 3), ("TEST", 5))
    ]
    (tmp_path / "net.prototxt").write_text("\n".join(layers))
    assert f"Initial loss: {loss}" in texts(log_of(f"time -model {tmp_path}/net.prototxt {flags}"))


def test_device_query_and_gpu():
    assert texts(log_of("device_query -gpu all")) == [
        "This runs on the CPU; there is no GPU to query"
    ]
    mine = texts(log_of("time -model net.prototxt -gpu 0,1 -iterations 1"))
    assert mine[:2] == ["Use CPU.", "-gpu 0,1 is accepted, but this runs on the CPU"]


@pytest.mark.parametrize("flags", ["-logtostderr device_query", "device_query -log_dir=log -v 1"])
def test_flags_of_glog_are_ignored_with_a_note(flags):
    note, _ = texts(log_of(flags))
    assert note == "glog's flags are ignored; the log goes to standard error: 2> FILE keeps it"


def test_without_a_command():
    out = run_tool("caffe").out
    assert "{train,test,time,device_query}" in out
    assert "--sighup_effect {stop,snapshot,none}" in out
