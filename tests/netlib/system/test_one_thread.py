"""One net used by two threads, two nets in two threads, and forked processes."""

from __future__ import annotations

import copy
import multiprocessing
import os
import select
import shutil
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from netlib.system.one_thread import OneThread
from tests.support.running import run_python

pytestmark = pytest.mark.both_engines

OLDER = Path(__file__).parents[1] / "older"
RECORDINGS = Path(__file__).resolve().parents[2] / "caffe" / "solvers"
MakeNet = Callable[..., netlib.Net]

NET = """
    name: "hand"
    force_backward: true
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 40 dim: 1 dim: 30 dim: 30 } } }
    layer { name: "c" type: "Convolution" bottom: "x" top: "c"
            convolution_param { num_output: 4 kernel_size: 5 weight_filler { type: "xavier" } } }
    layer { name: "r" type: "ReLU" bottom: "c" top: "c" }
    layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
    layer { name: "f" type: "InnerProduct" bottom: "p" top: "f"
            inner_product_param { num_output: 7 weight_filler { type: "xavier" } } }
"""


def in_a_thread(work: Callable[[], object]) -> BaseException | None:
    """Run ``work`` in another thread and return the exception that it raised."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return raised[0] if raised else None


# ---------------------------------------------------------------------------------------------- one net


@pytest.mark.parametrize("use", ["forward", "backward", "reshape", "run_forward", "run_backward"])
def test_a_second_thread_is_told(net_of: MakeNet, use: str) -> None:
    """A second thread gets an error while the first is inside a layer, but not afterwards."""
    net = net_of(NET)
    said: list[BaseException | None] = []
    compute = net.layers[0].forward

    def forward(bottom: netlib.Blobs, top: netlib.Blobs) -> None:
        said.append(in_a_thread(getattr(net, use)))
        compute(bottom, top)

    net.layers[0].forward = forward  # type: ignore[method-assign]
    net.forward()
    [error] = said
    assert isinstance(error, netlib.NetlibError)
    assert str(error).startswith("net 'hand' is in use by another thread; use a separate net in each thread")
    del net.layers[0].forward
    assert in_a_thread(getattr(net, use)) is None


def test_inputs_of_a_thread_that_is_told_change_nothing(net_of: MakeNet, rng: np.random.Generator) -> None:
    """The rejected call of another thread does not change the inputs."""
    net, (mine, other) = net_of(NET), rng.normal(size=(2, 40, 1, 30, 30))
    want = net.forward(x=mine)["f"].copy()
    compute = net.layers[0].forward

    def forward(bottom: netlib.Blobs, top: netlib.Blobs) -> None:
        assert isinstance(in_a_thread(lambda: net.forward(x=other)), netlib.NetlibError)
        compute(bottom, top)

    net.layers[0].forward = forward  # type: ignore[method-assign]
    assert np.array_equal(net.forward(x=mine)["f"], want)


def test_slopes_of_a_thread_that_is_told_change_nothing(net_of: MakeNet) -> None:
    """A refused backward pass does not write the given slopes into the diffs of the outputs."""
    net = net_of(NET)
    slopes = np.ones_like(net.forward()["f"])
    with net.executor.one_thread:
        assert isinstance(in_a_thread(lambda: net.backward(f=slopes)), netlib.NetlibError)
    assert not net.blobs["f"].diff.any()


def test_looking_at_a_hidden_blob_is_use(net_of: MakeNet) -> None:
    """Reading a hidden blob computes it again, so it counts as use of the net."""
    net = net_of(NET)
    net.forward()
    hidden = net.executor.hidden()
    with net.executor.one_thread:
        for blob in hidden:
            assert "in use by another thread" in str(in_a_thread(lambda blob=blob: blob.data))
    for blob in hidden:
        assert in_a_thread(lambda blob=blob: blob.data) is None


@pytest.mark.parametrize("use", ["forward", "backward"])
def test_a_part_of_a_second_thread_changes_nothing(net_of: MakeNet, use: str) -> None:
    """A refused partial pass does not replace the steps of the net, which the first thread may be running."""
    net = net_of(NET)
    net.forward()
    steps = net.executor.steps
    with net.executor.one_thread:
        assert "in use by another thread" in str(in_a_thread(lambda: getattr(net.executor, use)(0, 2)))
    assert net.executor.steps is steps


def test_the_same_thread_may_enter_again() -> None:
    """The lock is released after as many exits as entries."""
    one = OneThread("a")
    with one:
        with one:
            pass
        assert in_a_thread(one.__enter__) is not None
    assert in_a_thread(one.__enter__) is None


def test_a_copy_of_a_net_is_free() -> None:
    """The copy of a lock that is held is free."""
    one = OneThread("a")
    with one:
        made = copy.deepcopy(one)
        assert in_a_thread(made.__enter__) is None


# ---------------------------------------------------------------------------------------------- two nets


@pytest.mark.parametrize("shared", [False, True], ids=["own weights", "shared weights"])
def test_two_threads_with_a_net_each(
    net_of: MakeNet, rng: np.random.Generator, shared: bool, keep_threads: None
) -> None:
    """Each thread gets the same results as alone, bit for bit; with shared weights only forward is compared."""
    if netlib.threads() > 1:
        netlib.set_threads(3)
    nets, images = [net_of(NET, seed=seed) for seed in (1, 2)], rng.normal(size=(2, 5, 40, 1, 30, 30))
    slopes = rng.normal(size=(40, 7))
    if shared:
        nets[1].share_params(nets[0])

    def work(i: int) -> list[np.ndarray]:
        found = []
        for x in images[i]:
            nets[i].clear_param_diffs()
            found.append(nets[i].forward(x=x)["f"].copy())
            if not shared:  # gradients of shared weights are summed: that is for one thread at a time
                nets[i].backward(f=slopes)
                found += [nets[i].blobs["x"].diff.copy(), *(p.blob.diff.copy() for p in nets[i].learnable)]
        return found

    want, got = [work(0), work(1)], dict[int, list[np.ndarray]]()
    both = threading.Barrier(2, timeout=60)

    def run(i: int) -> None:
        both.wait()
        got[i] = work(i)

    threads = [threading.Thread(target=run, args=(i,)) for i in (0, 1)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for i in (0, 1):
        assert all(map(np.array_equal, got[i], want[i]))


def test_two_threads_make_the_first_nets() -> None:
    """Two threads may build the first nets of a process at the same time, although this imports layers and engines."""
    program = """
import threading
import netlib
made = []
both = threading.Barrier(2)
def make():
    both.wait()
    made.append(netlib.Net("prototxt/nyu_deploy.prototxt", netlib.TEST))
threads = [threading.Thread(target=make) for _ in range(2)]
for thread in threads: thread.start()
for thread in threads: thread.join()
print(len(made))
"""
    assert run_python("-c", program) == (0, "2\n", "")


# ---------------------------------------------------------------------------------------------- forks

needs_fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")


@contextmanager
def fork_is_meant() -> Iterator[None]:
    """Suppress the warning of Python 3.12 and later for a fork of a process with threads."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        yield


def in_a_child(work: Callable[[], bytes], seconds: float = 60) -> bytes:
    """Return the result of ``work`` in a forked process, or nothing if the process hangs and is killed."""
    read, write = os.pipe()
    with fork_is_meant():
        child = os.fork()
    if not child:
        try:
            with open(write, "wb") as stream:
                stream.write(work())
        finally:
            os._exit(0)
    os.close(write)
    with open(read, "rb") as stream:
        answered = select.select([stream], [], [], seconds)[0]
        if not answered:
            os.kill(child, signal.SIGKILL)
        found = stream.read() if answered else b""
    os.waitpid(child, 0)
    return found


@pytest.fixture
def solver(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> netlib.Solver:
    """A solver of a small net with shuffled HDF5Data and dropout, after one step."""
    shutil.copytree(OLDER, tmp_path, dirs_exist_ok=True)
    (tmp_path / "list.txt").write_text(f"{RECORDINGS}/train0.h5\n{RECORDINGS}/train1.h5\n")
    monkeypatch.chdir(tmp_path)
    made = netlib.get_solver("solver.prototxt", snapshot=0)
    made.step(1)
    return made


def after(solver: netlib.Solver, steps: int) -> bytes:
    """Return all weights after this number of further steps."""
    solver.step(steps)
    return b"".join(p.blob.data.tobytes() for p in solver.net.learnable)


@needs_fork
@pytest.mark.parametrize("threads", [1, 2])
def test_a_forked_child_trains_on_as_its_parent_would(solver: netlib.Solver, threads: int, keep_threads: None) -> None:
    """A forked child computes the same weights, also after the parent trained with another number of threads."""
    if netlib.threads() > 1:
        netlib.set_threads(threads)
    solver.step(1)
    found = in_a_child(lambda: after(solver, 3))
    assert found == after(solver, 3)


@needs_fork
def test_a_child_of_a_child_does_so_too(solver: netlib.Solver) -> None:
    """A child of a child trains on identically, whether or not the first child has made a step."""
    found = in_a_child(lambda: in_a_child(lambda: after(solver, 3)))
    later = in_a_child(lambda: after(solver, 1) and in_a_child(lambda: after(solver, 2)))
    assert found == later == after(solver, 3)


@needs_fork
def test_a_batch_that_is_being_read_at_the_fork_is_read_again(solver: netlib.Solver) -> None:
    """A child without the reading thread reads the batch itself."""
    [data] = [layer for layer in solver.net.layers if layer.type == "HDF5Data"]
    read, parent, forked = data.read, os.getpid(), threading.Event()

    def wait_and_read(*args: Any) -> Any:
        if os.getpid() == parent and threading.current_thread() is not threading.main_thread():
            forked.wait(300)
        return read(*args)

    data.read = wait_and_read
    solver.net.forward()
    found = in_a_child(lambda: after(solver, 2))
    forked.set()
    assert found == after(solver, 2)


@needs_fork
def test_the_number_of_threads_may_change_in_a_child(solver: netlib.Solver, keep_threads: None) -> None:
    """set_threads in a child does not wait for the parent's threads."""

    def work() -> bytes:
        netlib.set_threads(2 if os.environ["NETLIB_ENGINE"] == "fast" else 1)
        return after(solver, 2)

    assert in_a_child(work) == after(solver, 2)


@needs_fork
def test_a_process_of_multiprocessing(net_of: MakeNet, rng: np.random.Generator) -> None:
    """A process of multiprocessing with the fork method runs the parent's net."""
    net, x = net_of(NET), rng.normal(size=(40, 1, 30, 30))
    want = net.forward(x=x)["f"].copy()
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()

    def work() -> None:
        theirs.send(net.forward(x=x)["f"])

    process = context.Process(target=work)
    with fork_is_meant():
        process.start()
    answered = ours.poll(60)
    process.kill()
    process.join()
    assert answered
    assert np.array_equal(ours.recv(), want)


@needs_fork
def test_a_net_that_another_thread_used_at_the_fork_is_free_in_the_child(net_of: MakeNet) -> None:
    """A lock held by another thread at the fork is free in the child, where that thread does not exist."""
    net, inside, done = net_of(NET), threading.Event(), threading.Event()

    def hold() -> None:
        with net.executor.one_thread:
            inside.set()
            done.wait(60)

    thread = threading.Thread(target=hold)
    thread.start()
    inside.wait(60)
    found = in_a_child(lambda: net.forward()["f"].tobytes())
    done.set()
    thread.join()
    assert found == net.forward()["f"].tobytes()


@needs_fork
def test_who_forks_within_a_net_still_has_it(net_of: MakeNet) -> None:
    """A thread that forks while it holds the lock, as a Python layer may do, holds it in the child."""
    net = net_of(NET)
    with net.executor.one_thread:
        found = in_a_child(lambda: b"told" if in_a_thread(net.forward) else b"not told")
    assert found == b"told"
