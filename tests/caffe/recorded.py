"""Caffe's recordings, as the tests of this folder read them, and comparisons with them."""

from __future__ import annotations

import functools
import json
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

import netlib
from netlib.proto import prototxt
from netlib.snapshots import snapshot

FOLDER = Path(__file__).resolve().parent


def relative(got: Any, want: Any) -> float:
    """max |got - want| / max |want|; infinite if they differ in shape, or in where
    they are finite.
    """
    got, want = np.asarray(got, np.float64), np.asarray(want, np.float64)
    finite = np.isfinite(want)
    if got.shape != want.shape or not np.array_equal(np.isfinite(got), finite):
        return np.inf
    most = np.abs(want)[finite].max(initial=0)
    return float(np.abs(got - want)[finite].max(initial=0) / max(most, 1e-30))


def distance(got: Any, want: Any) -> float:
    """||got - want|| / ||want||; infinite if they differ in shape."""
    if np.shape(got) != np.shape(want):
        return np.inf
    return float(np.linalg.norm(got - want) / max(np.linalg.norm(want), 1e-30))


# ------------------------------------------------------------------------------------------- layers


@dataclass(frozen=True)
class Array:
    """One array of a layer case.

    A few large arrays are only partly kept; the rest of an input is then 0.
    """

    shape: tuple[int, ...]
    kept: Any  # the index of the kept part
    single: np.ndarray  # from Caffe's float32 net
    double: np.ndarray | None  # from its double net

    def put(self, target: np.ndarray) -> None:
        """Fill an input, a parameter or a top diff."""
        assert target.shape == self.shape
        target[...] = 0
        target[self.kept] = self.single

    def differs(self, got: np.ndarray) -> float:
        """Return the difference of a result from Caffe's; 0 if Caffe's net of this type
        was not recorded.
        """
        want = self.single if got.dtype == np.float32 else self.double
        if want is None:
            return 0.0
        return relative(got[self.kept], want) if got.shape == self.shape else np.inf


@dataclass(frozen=True)
class Case:
    """One layer case: a net, its inputs, and Caffe's results."""

    name: str
    phase: int
    backward: bool
    prototxt: str
    arrays: dict[str, Array]

    def of(self, kind: str) -> Iterator[tuple[list[str], Array]]:
        """Yield the arrays ``kind/...``: the rest of their names, and the arrays."""
        for name, array in self.arrays.items():
            first, *rest = name.split("/")
            if first == kind:
                yield rest, array

    def results(self, dtype: Any) -> int:
        """Return the number of arrays of a net of this type that can be compared."""
        kinds = ("top", "indiff", "pdiff", "param_after")
        arrays = [array for kind in kinds for _, array in self.of(kind)]
        return sum(dtype == np.float32 or array.double is not None for array in arrays)


def differences(case: Case, dtype: Any) -> dict[str, float]:
    """Run a case forward and backward in a net of this type; return
    result -> difference from Caffe's.
    """
    net = netlib.Net(prototxt.parse(case.prototxt, case.name), case.phase, dtype=dtype)
    for (layer, index), array in case.of("param"):
        array.put(net.params[layer][int(index)].data)
    for (blob,), array in case.of("in"):
        array.put(net.blobs[blob].data)
    net.forward()
    found = {
        f"top {blob}": array.differs(net.blobs[blob].data) for (blob,), array in case.of("top")
    }
    for (layer, index), array in case.of("param_after"):
        found[f"param {layer} {index}"] = array.differs(net.params[layer][int(index)].data)
    if case.backward:
        for (blob,), array in case.of("topdiff"):
            array.put(net.blobs[blob].diff)
        net.backward()
        for (blob,), array in case.of("indiff"):
            found[f"diff of {blob}"] = array.differs(net.blobs[blob].diff)
        for (layer, index), array in case.of("pdiff"):
            found[f"diff of {layer} {index}"] = array.differs(net.params[layer][int(index)].diff)
    return found


@functools.cache
def layer_cases() -> list[Case]:
    """Return all recorded layer cases."""
    with h5py.File(FOLDER / "layers.h5") as file:
        single, difference = file["float32"][...], file["float64_bits_minus_float32"][...]
    cases = []
    for entry in json.loads((FOLDER / "layers.json").read_text(encoding="utf-8")):
        arrays = {}
        for part, shape in entry["arrays"].items():
            kept = slices(entry["kept"].get(part, "[...]"))
            target = np.empty(shape, np.bool_)[kept].shape
            size = int(np.prod(target))
            mine, single = single[:size].reshape(target), single[size:]
            twin = None
            if part in entry["twins"]:
                bits, difference = difference[:size].reshape(target), difference[size:]
                twin = (mine.astype(np.float64).view(np.int64) + bits).view(np.float64)
            arrays[part] = Array(tuple(shape), kept, mine, twin)
        phase = ("TRAIN", "TEST").index(entry["phase"])
        cases.append(Case(entry["case"], phase, entry["backward"], entry["prototxt"], arrays))
    assert not single.size, "numbers left over: layers.json and layers.h5 do not belong together"
    assert not difference.size
    return cases


def slices(text: str) -> Any:
    """Convert a text such as ``[:, ::2]`` to an index."""
    if text == "[...]":
        return ...
    index = []
    for axis in text.strip("[]").split(","):
        ends = [int(n) if n.strip() else None for n in axis.split(":")]
        index.append(slice(*ends))
    return tuple(index)


# ------------------------------------------------------------------------------------------ solvers


@dataclass(frozen=True)
class Trajectory:
    """A recorded training by Caffe."""

    weights: dict[tuple[str, int], dict[int, np.ndarray]]  # (layer, index) -> updates made -> array
    losses: np.ndarray  # of the last batch of every iteration
    printed_losses: np.ndarray  # as in the log, six digits
    printed_rates: np.ndarray


def solver_cases() -> list[str]:
    """Return the names of the recorded training runs."""
    with h5py.File(FOLDER / "solvers/trajectories.h5") as file:
        return [name.decode() for name in file["cases"]]


def trajectory(case: str) -> Trajectory:
    """Return the weights after the updates of one training, its losses and its learning rates."""
    number = solver_cases().index(case)
    initial = snapshot.read_weights(FOLDER / "solvers/init.caffemodel.h5")
    weights = {}
    with h5py.File(FOLDER / "solvers/trajectories.h5") as file:
        for layer, group in file["w"].items():
            for index, steps in group.items():
                after = dict(zip(steps.attrs["iterations"].tolist(), steps[number]))
                weights[layer, int(index)] = {0: initial[layer][int(index)], **after}
        printed = file["loss_printed"][number], file["lr_printed"][number]
        return Trajectory(weights, file["loss_last_subbatch"][number], *printed)


class Follow:
    """Compare the weights and the loss of a solver with Caffe's after every update."""

    def __init__(self, solver: netlib.Solver, theirs: Trajectory) -> None:
        self.solver, self.theirs = solver, theirs
        self.updates = self.compared = 0
        self.worst = self.worst_loss = 0.0
        solver.on_update.append(self.compare)

    def compare(self) -> None:
        solver = self.solver
        self.updates += 1
        loss = solver.net.loss()  # of the last batch: before the update
        ratio = loss / float(self.theirs.losses[solver.iter - 1])
        self.worst_loss = max(self.worst_loss, abs(ratio - 1))
        for (layer, index), after in self.theirs.weights.items():
            if solver.iter in after:
                far = distance(solver.net.params[layer][index].data, after[solver.iter])
                self.worst, self.compared = max(self.worst, far), self.compared + 1


# --------------------------------------------------------------------------------------------- logs


def log_lines(name: str) -> list[str]:
    """Return the texts of a recorded log."""
    return texts((FOLDER / "logs" / name).read_text(encoding="utf-8").splitlines())


def texts(lines: Iterable[str]) -> list[str]:
    """Return the texts of a log, without prefixes like ``I20261121 01:57:02.956642
    28053 caffe.cpp:197] ``.
    """
    return [re.sub(r"^[IWE]\d+ [\d:.]+ +\d+ [\w.]+:\d+\] ", "", line) for line in lines]


def solver_text(name: str, **changes: str) -> str:
    """Return the solver printed in a recorded log, with some fields changed."""
    lines = log_lines(name)
    begin = lines.index("Initializing solver from parameters: ") + 1
    end = next(i for i, line in enumerate(lines) if line.startswith("Creating training net"))
    kept = [line for line in lines[begin:end] if line.split(":")[0] not in changes]
    return "\n".join([*kept, *(f"{field}: {value}" for field, value in changes.items())]) + "\n"


COMPARED = re.compile(
    r"Iteration \d+|Solving |Learning Rate Policy|\s+(Train|Test) net output|Snapshotting|Optimization"
)
NUMBER = re.compile(r"-?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def said(lines: Iterable[str]) -> list[str]:
    """Return the lines of a log that Caffe prints too, without the speed, the snapshot format
    and the folder.
    """
    found = []
    for line in lines:
        if COMPARED.match(line):
            line = re.sub(
                r"\(\S+ iter/s, \S+s/(\d+) iters\)", r"(SPEED iter/s, SECONDSs/\1 iters)", line
            )
            line = re.sub(
                r"to (?:binary proto|HDF5) file \S*_iter_(\d+\.[a-z]+)(\.h5)?$",
                r"to FORMAT file \1",
                line,
            )
            found.append(line)
    return found


def words(lines: Iterable[str]) -> list[str]:
    """Return the lines with their numbers replaced."""
    return [NUMBER.sub("#", line) for line in lines]


def numbers(lines: Iterable[str]) -> list[str]:
    """Return the numbers in the lines, as printed."""
    return [number for line in lines for number in NUMBER.findall(line)]


def same_print(ours: str | float, theirs: str | float) -> bool:
    """Return whether two numbers agree to six digits.

    The last digit may differ by one: 0.5 rounds either way.
    """
    a, b = float(ours), float(theirs)
    if b == 0:
        return a == 0
    last_digit = 10 ** (np.floor(np.log10(abs(b))) - 5)
    return abs(a - b) <= 1.01 * last_digit


def check_same_log(mine: list[str], theirs: list[str]) -> None:
    """Assert that the logs have the same text and the same numbers, line by line."""
    assert words(mine) == words(theirs)
    wrong = [(a, b) for a, b in zip(numbers(mine), numbers(theirs)) if not same_print(a, b)]
    assert wrong == []
