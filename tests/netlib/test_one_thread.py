"""One net used by two threads, two nets in two threads, and a forked process."""

from __future__ import annotations

import multiprocessing
import os
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_array_equal

import netlib
from netlib.pass_state import OneThread
from tests.netlib.conftest import MakeNet, furnish
from tests.support.running import run_python

pytestmark = pytest.mark.both_engines


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
    with ThreadPoolExecutor(1) as pool:
        return pool.submit(work).exception()


@pytest.mark.parametrize("use", ["forward", "backward", "reshape", "run_forward", "run_backward"])
def test_a_second_thread_gets_an_error(net_of: MakeNet, use: str) -> None:
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
    assert str(error).startswith(
        "net 'hand' is in use by another thread; use a separate net in each thread"
    )
    del net.layers[0].forward
    assert in_a_thread(getattr(net, use)) is None


@pytest.mark.parametrize(
    "use",
    [
        lambda net: net.forward(x=np.ones((40, 1, 30, 30))),
        lambda net: net.backward(f=np.ones((40, 7))),
        lambda net: net.run_forward(0, 2),
        lambda net: net.run_backward(0, 2),
    ],
    ids=["inputs", "slopes", "a part forwards", "a part backwards"],
)
def test_a_rejected_thread_changes_nothing(
    net_of: MakeNet, use: Callable[[netlib.Net], object]
) -> None:
    """Neither inputs nor diffs change, nor the steps of the net, which the first thread
    may be running.
    """
    net = net_of(NET)
    net.forward()
    steps = net.steps
    with net.one_thread:
        assert "in use by another thread" in str(in_a_thread(lambda: use(net)))
    assert not net.blobs["x"].data.any()
    assert not net.blobs["f"].diff.any()
    assert net.steps is steps


def test_reading_an_unstored_blob_counts_as_use(net_of: MakeNet) -> None:
    """The first access computes it."""
    net = net_of(NET)
    net.forward()
    unstored = [blob for step in net.steps for blob in step.unstored]
    with net.one_thread:
        for blob in unstored:
            assert "in use by another thread" in str(in_a_thread(lambda blob=blob: blob.data))
    for blob in unstored:
        assert in_a_thread(lambda blob=blob: blob.data) is None


def test_a_blob_that_another_thread_reads_during_a_reshape() -> None:
    """The memory that the reader asks for is that of the shape before, or the one that
    the net writes.
    """
    shapes: list[tuple[int, ...]] = []

    def zeros(shape: tuple[int, ...], dtype: object) -> np.ndarray:
        shapes.append(shape)
        if len(shapes) == 1:  # the net goes on while the reader allocates
            blob.reshape(2, 3)
            blob.data[...] = 7
        return np.zeros(shape, np.float32)

    blob = netlib.Blob((8, 3), zeros=zeros)
    assert blob.data.shape == (8, 3)
    assert shapes == [(8, 3), (2, 3)]
    assert_array_equal(blob.data, np.full((2, 3), 7))


def test_a_blob_that_another_thread_reads_first() -> None:
    """Both get the same memory."""

    def zeros(shape: tuple[int, ...], dtype: object) -> np.ndarray:
        if not written:
            written.append(True)
            blob.data[...] = 7
        return np.zeros(shape, np.float32)

    written: list[bool] = []
    blob = netlib.Blob((2, 3), zeros=zeros)
    assert_array_equal(blob.data, np.full((2, 3), 7))


def test_the_same_thread_may_enter_again() -> None:
    """The lock is released after as many exits as entries."""
    one = OneThread("a")
    with one:
        with one:
            pass
        assert in_a_thread(one.__enter__) is not None
    assert in_a_thread(one.__enter__) is None


@pytest.mark.parametrize("shared", [False, True], ids=["own weights", "shared weights"])
def test_two_threads_with_a_net_each(
    net_of: MakeNet, rng: np.random.Generator, shared: bool, keep_threads: None
) -> None:
    """Each thread gets the same results as alone, bit for bit; with shared weights only
    forward is compared.
    """
    if netlib.threads() > 1:
        netlib.set_threads(3)
    nets = [net_of(NET, seed=seed) for seed in (1, 2)]
    images = rng.normal(size=(2, 5, 40, 1, 30, 30))
    slopes = rng.normal(size=(40, 7))
    if shared:
        nets[1].share_params(nets[0])

    def work(i: int) -> list[np.ndarray]:
        found = []
        for x in images[i]:
            nets[i].clear_param_diffs()
            found.append(nets[i].forward(x=x)["f"].copy())
            # gradients of shared weights are summed: that is for one thread at a time
            if not shared:
                nets[i].backward(f=slopes)
                found += [
                    nets[i].blobs["x"].diff.copy(),
                    *(p.blob.diff.copy() for p in nets[i].learnable),
                ]
        return found

    wanted, both = [work(0), work(1)], threading.Barrier(2, timeout=60)
    with ThreadPoolExecutor(2, initializer=both.wait) as pool:
        for got, want in zip(pool.map(work, (0, 1)), wanted):
            assert all(map(np.array_equal, got, want))


def test_two_threads_make_the_first_nets() -> None:
    """Two threads may build the first nets of a process at the same time, although this imports
    layers and engines.
    """
    program = """
import threading
from concurrent.futures import ThreadPoolExecutor
import netlib
with ThreadPoolExecutor(2, initializer=threading.Barrier(2).wait) as pool:
    print(len(list(pool.map(netlib.Net, ["prototxt/nyu_deploy.prototxt"] * 2, [netlib.TEST] * 2))))
"""
    assert run_python("-c", program) == (0, "2\n", "")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_forked_process_starts_threads_of_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, keep_threads: None
) -> None:
    """A child trains on as its parent does, with threads."""
    if netlib.threads() > 1:
        netlib.set_threads(2)
    furnish(tmp_path)
    monkeypatch.chdir(tmp_path)
    solver = netlib.get_solver("solver.prototxt", snapshot=0)
    solver.step(1)

    def weights() -> bytes:
        solver.step(3)
        return b"".join(p.blob.data.tobytes() for p in solver.net.learnable)

    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe()
    process = context.Process(target=lambda: theirs.send(weights()))
    with warnings.catch_warnings():
        # Python 3.12 warns of a fork with threads
        warnings.simplefilter("ignore", DeprecationWarning)
        process.start()
    answered = ours.poll(60)
    process.kill()
    process.join()
    assert answered
    assert ours.recv() == weights()
