"""Random nets, used at random, under the plain engine and the fast one on 1 and on several threads.

A *program* is a net, or a solver with its nets, and a list of operations, run by ``check(123)``.
After each operation the three must agree: on values returned or errors raised, and after every
second one on parameters, gradients, outputs; plain and fast to rounding, fast on 1 and
on several threads bit for bit, unless layers outside of slices are large. Errors of the fast engine
alone are those that docs/caffe.md lists. A program says nothing where noise in the last digits of
its inputs changes its values.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from random import Random
from typing import Any

import numpy as np
import pytest

import netlib
from fast import division
from netlib.proto import prototxt
from netlib.solver import Solver
from netlib.training import solver_parameter
from tests.support.random_nets import alternatives, has_depth, images, is_large, pick, random_net

# of the largest value of an array, or of 1 where all are smaller
TOLERANCE = {np.float64: 1e-9, np.float32: 3e-3}
# of a value; what it changes by more than the tolerance, rounding may change
NOISE = {np.float64: 1e-13, np.float32: 3e-7}
ALLOWED = re.compile(
    "written between forward and backward|is unknown|run forward first|shares the memory of another|is empty; "
)
SOLVER = """type: <"SGD"|"SGD"|"Nesterov"|"Adam" delta: 0.1> base_lr: 0.01 lr_policy: "fixed"
    momentum: <0|0.9> iter_size: <1|1|2>
    clip_gradients: <2|0.5> test_iter: 1 test_interval: <1|2> display: <0|1> debug_info: <true|false>
    snapshot_format: <HDF5|BINARYPROTO> max_iter: 100 random_seed: 1 net_param {"""

Generator = np.random.Generator
Values = dict[str, Any]
Result = Values | netlib.NetlibError


class UsedNet(netlib.Net):
    """A net with what a script has in addition.

    kind    the type of the values
    text    of the net in both phases
    noise   of the values that the script writes
    held    arrays of blobs that it keeps
    solver  None: the script updates the parameters
    """

    kind: type[np.floating[Any]] = np.float64
    text = ""
    noise = 0.0
    solver: Solver | None = None

    def __init__(self, *args: Any, **options: Any) -> None:
        super().__init__(*args, **{"dtype": self.kind} | options)
        self.held: list[np.ndarray] = []

    @functools.cached_property
    def test(self) -> netlib.Net:
        """A test net with the same parameters."""
        if self.solver is not None:
            return self.solver.test_nets[0]
        net = UsedNet(prototxt.parse(self.text), netlib.TEST, engine=self.engine.name, seed=1)
        net.share_params(self)
        return net

    def noisy(self, values: np.ndarray) -> np.ndarray:
        if not self.noise:
            return values
        return values * (1 + self.noise * np.random.default_rng(0).normal(size=values.shape))


class UsedSolver(Solver):
    net_class = UsedNet


@dataclass(frozen=True)
class Program:
    """A net or, if ``solver`` has a text, a solver, and the operations, each with a
    number of threads.
    """

    seed: int
    net: str
    phase: int
    solver: str
    operations: Sequence[str]
    threads: Sequence[int]

    def start(self, engine: str, noise: float, folder: Path) -> UsedNet:
        """The net, with random parameters."""
        if self.solver:
            param = solver_parameter.parameter_of(
                prototxt.parse(self.solver), snapshot_prefix=str(folder / engine)
            )
            solver = UsedSolver(param, engine=engine)
            net = solver.net
            assert isinstance(net, UsedNet)
            net.solver = solver
        else:
            net = UsedNet(prototxt.parse(self.net), self.phase, engine=engine, seed=1)
        net.text, net.noise = self.net, noise
        new_params(net, np.random.default_rng(self.seed))
        return net

    def run(
        self, engine: str, folder: Path, threads: int = 0, noise: float = 0
    ) -> Iterator[Result]:
        """The results of the operations; ``threads`` instead of the numbers of the program."""
        net, has_failed = self.start(engine, noise, folder), False
        shapes = {name: net.blobs[name].shape for name in net.inputs}
        for number, name in enumerate(self.operations):
            netlib.set_threads(threads or self.threads[number])
            rng = np.random.default_rng([self.seed, number])
            looks = rng.random() < 0.5
            try:
                if has_failed:
                    recover(net, rng, shapes)
                has_failed = False
                values = OPERATIONS[name][1](net, rng) or {}
                if looks:
                    values = values | outputs_and_params(net)
                yield {what: np.array(value) for what, value in values.items()}
            except netlib.NetlibError as error:
                has_failed = True
                yield error


def drawn(seed: int) -> Program:
    rng = Random(seed)
    net = random_net(rng)
    phase = rng.choice([netlib.TRAIN, netlib.TRAIN, netlib.TEST])
    has_solver = phase == netlib.TRAIN and "loss_weight" in net and rng.random() < 0.4
    solver = alternatives(rng, SOLVER) + net + "}" if has_solver else ""
    some = pick(rng, {name: weight for name, (weight, _) in OPERATIONS.items()}, rng.randint(3, 12))
    operations = ["forward of new images", *some, "read data", "read diffs"]
    threads = [rng.choice([2, 3, 4]) for _ in operations]
    return Program(seed, net, phase, solver, operations, threads)


# --------------------------------------------------------------------------------------- operations


def new_images(net: UsedNet, rng: Generator, new: float = 0) -> Values:
    batches = images(net, rng, new)
    return {name: net.noisy(x) if name[0] != "t" else x for name, x in batches.items()}


def recover(net: UsedNet, rng: Generator, shapes: Mapping[str, tuple[int, ...]]) -> None:
    """Run a complete pass after one that failed, with the shapes of the prototxt."""
    for name, shape in shapes.items():
        net.blobs[name].reshape(shape)
    net.reshape()
    net.clear_param_diffs()
    net.forward(**new_images(net, rng))
    net.backward()


def new_params(net: UsedNet, rng: Generator) -> None:
    """Write parameters; moving averages remain those of positive variances."""
    for param in net.learnable:
        values = rng.uniform(0.5, 1.5, param.blob.shape)
        if not net.layer_dict[param.layer].moving:
            values *= rng.choice([-1, 0.5, 1], param.blob.shape)
        param.blob.data[...] = net.noisy(values)


def forward(net: UsedNet, rng: Generator) -> Values:
    given = {name: x for name, x in new_images(net, rng, 0.3).items() if rng.random() < 0.8}
    if rng.random() < 0.6:
        return net.forward(**given)
    for name, image in given.items():
        net.blobs[name].reshape(image.shape)
        net.blobs[name].data[...] = image
    # as a solver does
    return net.forward() if rng.random() < 0.7 else {"loss": net.run_forward()}


def backward(net: UsedNet, rng: Generator, fewer: bool = False) -> Values:
    """With ``fewer`` items than before, of new images: between the maxima of constant ones,
    rounding would decide.
    """
    if fewer:
        net.forward(**new_images(net, rng))
        count = int(rng.integers(min(net.blobs[name].shape[0] for name in net.inputs) + 1))
        for name in net.inputs[rng.integers(len(net.inputs)) :]:
            net.blobs[name].reshape(count, *net.blobs[name].shape[1:])
        net.reshape()
        for name, image in new_images(net, rng).items():
            net.blobs[name].data[...] = image
    diffs = {}
    for name in net.outputs:
        if rng.random() < 0.8:
            diffs[name] = net.noisy(rng.normal(size=net.blobs[name].shape))
    return net.backward(**diffs)


def part(net: UsedNet, rng: Generator) -> list[str | None]:
    """Draw the first and the last layer of a part of the net."""
    ends = sorted(rng.choice(len(net.layers), 2))
    return [net.layers[i].name if rng.random() < 0.8 else None for i in ends]


def read(blobs: dict[str, netlib.Blob], *halves: str) -> Values:
    return {
        f"{half} of {name}": getattr(blob, half) for half in halves for name, blob in blobs.items()
    }


def outputs_and_params(net: UsedNet) -> Values:
    outputs = read({name: net.blobs[name] for name in net.outputs}, "data")
    return outputs | read({param.label: param.blob for param in net.learnable}, "data", "diff")


def write(net: UsedNet, rng: Generator, array: np.ndarray, is_label: bool = False) -> None:
    """Change the values of an array, those of labels to other labels."""
    kind = rng.integers(3)
    if rng.random() < 0.03 and not is_label:
        array.flat[:1] = rng.choice([np.nan, np.inf])
    elif kind == 0 and not is_label:
        array[...] = net.noisy(rng.normal(size=array.shape))
    elif kind == 1 and not is_label:
        array *= 0.5
    elif array.ndim:
        array[...] = array[::-1].copy()


def write_all(net: UsedNet, rng: Generator, arrays: Values) -> None:
    for name, array in arrays.items():
        if rng.random() < 0.5:
            write(net, rng, array, name.split(" of ")[-1].startswith("t1"))


def any_blob(net: UsedNet, rng: Generator) -> tuple[str, netlib.Blob]:
    name = list(net.blobs)[rng.integers(len(net.blobs))]
    return name, net.blobs[name]


def write_blob(net: UsedNet, rng: Generator) -> None:
    name, blob = any_blob(net, rng)
    array = blob.data if rng.random() < 0.7 else blob.diff
    write(net, rng, array, name.startswith("t1"))


def read_blob(net: UsedNet, rng: Generator) -> Values:
    name, blob = any_blob(net, rng)
    return read({name: blob}, "data" if rng.random() < 0.5 else "diff")


def hold(net: UsedNet, rng: Generator) -> None:
    """Keep an array of a parameter or an input, which are always stored."""
    blobs = [param.blob for param in net.learnable]
    blobs += [net.blobs[name] for name in net.inputs if name[0] != "t"]
    net.held.append(blobs[rng.integers(len(blobs))].data)


def write_held(net: UsedNet, rng: Generator) -> None:
    for array in net.held:
        array *= 0.5 + rng.random()
    if rng.random() < 0.5:
        net.held.clear()


def other_net(net: UsedNet, rng: Generator) -> UsedNet:
    other = UsedNet(net.param, net.phase, seed=2, engine=net.engine.name)
    other.noise = net.noise
    new_params(other, rng)
    return other


def share(net: UsedNet, rng: Generator) -> None:
    """Share the parameters of a net that is used on."""
    other = other_net(net, rng)
    net.share_params(other)
    net.held += [param.blob.data for param in other.learnable]


def store(net: UsedNet, rng: Generator) -> None:
    """Store all blobs, or only the needed ones, without what was written to diffs of copies."""
    losses = [blob for blob, _, _ in net.losses]
    for name, blob in net.blobs.items():
        if "_split_" in name and blob not in losses:
            blob.diff[...] = 0
    net.store_all(bool(rng.random() < 0.4))


def update(net: UsedNet, rng: Generator) -> Values:
    """An iteration, or two, of a solver."""
    if net.solver is not None:
        net.solver.step(int(rng.integers(1, 3)))
        return {"loss": net.solver.loss}
    net.clear_param_diffs()
    loss = net.run_forward_backward()
    for param in net.learnable:
        change = param.blob.diff / abs(param.blob.diff).max(initial=1)
        param.blob.data[...] -= 0.01 * change
    return {"loss": loss}


def resume(net: UsedNet, rng: Generator) -> Values:
    """Take a snapshot, train on, and return to it."""
    if net.solver is None:
        return {}
    path = net.solver.snapshot()
    update(net, rng)
    net.solver.restore(path)
    return update(net, rng) if rng.random() < 0.5 else {}


def run_the_test_net(net: UsedNet, rng: Generator) -> Values:
    """Run the test net."""
    found = net.test.forward(**images(net.test, rng, 0.2))
    return {f"{name} in the test": y for name, y in found.items()}


Operation = Callable[[UsedNet, Generator], Any]


def read_data(net: UsedNet, rng: Generator) -> Values:
    return read(net.blobs, "data")


def forward_part(net: UsedNet, rng: Generator) -> Values:
    return net.forward(None, *part(net, rng))


def copy_weights(net: UsedNet, rng: Generator) -> None:
    if net.learnable:
        net.copy_from(other_net(net, rng))


def in_turn(first: Operation, then: Operation) -> Operation:
    """Two operations; the values are those of the second."""

    def run(net: UsedNet, rng: Generator) -> Any:
        first(net, rng)
        return then(net, rng)

    return run


# The weight of the choice, and a function of a net and a generator, which has the same seed for
# each net.
OPERATIONS: dict[str, tuple[int, Operation]] = {
    "forward": (14, forward),
    "forward of new images": (3, lambda net, rng: net.forward(**new_images(net, rng))),
    "forward of views": (
        1,
        lambda net, rng: net.forward(**{x: net.blobs[x].data[::-1] for x in net.inputs}),
    ),
    "forward part": (4, forward_part),
    "forward part, write": (
        2,
        lambda net, rng: write_all(
            net, rng, net.forward(list(net.blobs), start=net.layers[-1].name)
        ),
    ),
    "backward": (8, backward),
    "backward of fewer items": (2, lambda net, rng: backward(net, rng, fewer=True)),
    "backward to a layer": (2, lambda net, rng: net.backward(end=part(net, rng)[0])),
    "backward part": (3, lambda net, rng: net.backward(None, *reversed(part(net, rng)))),
    "clear": (2, lambda net, rng: net.clear_param_diffs()),
    "read data": (1, read_data),
    "read diffs": (2, lambda net, rng: read(net.blobs, "diff")),
    "read a blob": (3, read_blob),
    "write diffs": (2, lambda net, rng: write_all(net, rng, read(net.blobs, "diff"))),
    "write params": (2, new_params),
    "write params, read data": (2, in_turn(new_params, read_data)),
    "write a blob": (3, write_blob),
    "write a blob, backward": (4, in_turn(write_blob, backward)),
    "write a blob, forward part": (2, in_turn(write_blob, forward_part)),
    "hold an array": (2, hold),
    "write held arrays": (3, write_held),
    "share": (2, share),
    "copy": (1, copy_weights),
    "store": (2, store),
    "update": (6, update),
    "resume": (1, resume),
    "test": (3, run_the_test_net),
}


# ---------------------------------------------------------------------------------------- agreement


def check(seed: int, folder: Path) -> None:
    """Run the program of a seed, every second one in slices of one or two items, so that there
    are several.
    """
    division.MAX_SLICE, division.LANES = (2, 1, 64, 64)[seed % 4], (2, 16)[seed // 4 % 2]
    program = drawn(seed)
    # in float32 nets with algorithms that depend on the size of a value, and with few thresholds
    is_single = seed % 3 == 0 and (is_large(program.net) or has_depth(program.net))
    UsedNet.kind = np.float32 if is_single else np.float64
    tolerance = TOLERANCE[UsedNet.kind]
    runs = [
        program.run("plain", folder),
        program.run("fast", folder, 1),
        program.run("fast", folder),
    ]
    for number, (plain, fast, threads) in enumerate(zip(*runs)):
        where = f"program {seed}, operation {number} ({program.operations[number]})"
        errors = [one for one in (plain, fast, threads) if isinstance(one, netlib.NetlibError)]
        if any(ALLOWED.search(str(error)) for error in errors) and type(fast) is type(threads):
            return
        assert len(errors) in (0, 3), f"{where}: returned or raised {[plain, fast, threads]}"
        if errors:
            continue
        if not is_large(program.net):
            compare(fast, threads, f"{where}, on 1 and on several threads", 0)
        try:
            compare(plain, fast, where, tolerance)
            compare(plain, threads, f"{where}, on several threads", tolerance)
        except AssertionError:
            if amplifies_noise(program, folder, number):
                return
            raise


def compare(expected: Values, found: Values, where: str, tolerance: float) -> None:
    """Infinite values and NaN agree."""
    for what, values in expected.items():
        size = abs(values[np.isfinite(values)]).max(initial=1)
        one, other = (np.where(np.isfinite(x), x, np.nan) for x in (found[what], values))
        np.testing.assert_allclose(one, other, 0, tolerance * size, err_msg=f"{where}: {what}")


def amplifies_noise(program: Program, folder: Path, last: int) -> bool:
    """Whether noise in the inputs and parameters changes a value until this operation."""
    runs = program.run("plain", folder), program.run("plain", folder, noise=NOISE[UsedNet.kind])
    for number, (values, noisy) in zip(range(last + 1), zip(*runs)):
        if isinstance(values, netlib.NetlibError) or isinstance(noisy, netlib.NetlibError):
            continue
        try:
            compare(values, noisy, f"operation {number}", TOLERANCE[UsedNet.kind] / 10)
        except AssertionError:
            return True
    return False


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("block", range(4))
def test_the_engines_agree(
    block: int, keep_threads: None, monkeypatch: Any, caplog: Any, tmp_path: Path
) -> None:
    caplog.set_level("ERROR", "netlib")
    monkeypatch.setattr(division, "MAX_SLICE", 64)  # restored after the test
    for seed in range(40 * block, 40 * block + 40):
        check(seed, tmp_path)
