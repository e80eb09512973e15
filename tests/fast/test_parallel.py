"""Threads: every job runs once, errors are raised, jobs can run jobs, and each thread has
its own buffers.
"""

from __future__ import annotations

import threading

import numpy as np
import pytest

import netlib
from fast import parallel
from fast.fast_layer import FastLayer
from netlib import gradcheck
from netlib.engine import available_cpus

pytestmark = pytest.mark.usefixtures("keep_threads")


@pytest.mark.parametrize("threads", [1, 2, 5])
@pytest.mark.parametrize("count", [0, 1, 2, 40])
def test_every_job_is_done_once(threads: int, count: int) -> None:
    netlib.set_threads(threads)
    done: list[int] = []
    parallel.run([lambda i=i: done.append(i) for i in range(count)])
    assert sorted(done) == list(range(count))


def test_two_threads_work_at_the_same_time() -> None:
    netlib.set_threads(2)
    both = threading.Barrier(2, timeout=60)
    parallel.run([both.wait, both.wait])


@pytest.mark.parametrize("threads", [1, 3])
def test_the_first_error_is_raised(threads: int) -> None:
    netlib.set_threads(threads)

    def fail() -> None:
        raise ValueError("from a job")

    with pytest.raises(ValueError, match="from a job"):
        parallel.run([fail] * 5)
    done: list[int] = []
    parallel.run([lambda: done.append(1)] * 4)
    assert len(done) == 4


def test_a_job_may_run_jobs() -> None:
    netlib.set_threads(2)
    done: list[int] = []
    parallel.run([lambda: parallel.run([lambda: done.append(1)] * 3)] * 4)
    assert len(done) == 12


def test_the_number_of_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """The number of threads is the one set, else NETLIB_NUM_THREADS, else one per processor."""
    netlib.set_threads(3)
    assert netlib.threads() == 3
    with pytest.raises(ValueError, match="at least 1, not 0"):
        netlib.set_threads(0)
    for text, expected in (("4", 4), ("", available_cpus()), ("many", available_cpus())):
        monkeypatch.setenv("NETLIB_NUM_THREADS", text)
        monkeypatch.setattr(parallel, "_threads", None)
        assert netlib.threads() == expected


def test_a_buffer_keeps_its_memory_for_each_thread() -> None:
    """A buffer has zeros at first and in a new shape, and each thread has its own."""
    layer = gradcheck.make_layer('type: "ReLU"', [np.zeros(3)])
    assert isinstance(layer, FastLayer)
    buffer = layer.buffer("b", (2, 3))
    assert not buffer.any()
    assert layer.buffer("b", (2, 3)) is buffer
    assert layer.buffer("b", (4,)).shape == (4,)
    found = []
    thread = threading.Thread(target=lambda: found.append(layer.buffer("b", (4,))))
    thread.start()
    thread.join()
    assert found[0] is not layer.buffer("b", (4,))
