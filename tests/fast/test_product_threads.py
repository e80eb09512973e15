"""A large product of one image uses the threads of OpenBLAS; in all other work it has one."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

import netlib
from fast import geometry, parallel, product_threads
from netlib.proto import prototxt
from tests.support.nets import inputs
from tests.support.running import run_python

pytestmark = pytest.mark.usefixtures("keep_threads")


@pytest.fixture
def counts(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[int]]:
    """The numbers of threads that are set, instead of setting them."""
    found: list[int] = []
    monkeypatch.setattr(product_threads, "_setters", lambda: [found.append])
    monkeypatch.setattr(geometry, "MIN_PRODUCT_COST", 1)
    yield found
    assert product_threads._running == 0 and product_threads._now == 1


def make(items: int) -> netlib.Net:
    text = inputs(x=(items, 4, 8, 8)) + (
        'layer { name: "c" type: "Convolution" bottom: "x" top: "c" '
        'convolution_param { num_output: 64 kernel_size: 1 weight_filler { type: "xavier" } } }'
    )
    return netlib.Net(prototxt.parse(text), netlib.TEST, engine="fast", seed=1)


def test_a_product_of_one_image_has_all_threads(counts: list[int]) -> None:
    net = make(1)
    netlib.set_threads(3)
    net.forward(x=np.ones((1, 4, 8, 8)))
    assert counts == [3, 1]


def test_with_one_thread_nothing_is_set(counts: list[int]) -> None:
    net = make(1)
    netlib.set_threads(1)
    net.forward(x=np.ones((1, 4, 8, 8)))
    assert counts == []


def test_a_product_in_a_slice_has_one_thread(counts: list[int]) -> None:
    net = make(64)
    netlib.set_threads(3)
    net.forward(x=np.ones((64, 4, 64, 64)))
    assert counts == []


def test_the_number_is_restored_after_an_error(counts: list[int]) -> None:
    netlib.set_threads(2)

    def fail(channels: slice) -> None:
        raise ValueError("from a product")

    with pytest.raises(ValueError, match="from a product"):
        geometry.run_products(fail, 8, 1, 100)
    assert counts == [2, 1]


def test_of_two_callers_at_once_the_second_has_one_thread(counts: list[int]) -> None:
    assert product_threads.begin(2)
    assert not product_threads.begin(2)
    product_threads.begin_jobs()  # jobs of another net: their products have one thread
    assert counts == [2, 1]
    product_threads.end_jobs()
    product_threads.end()


def test_products_of_jobs_have_one_thread(counts: list[int]) -> None:
    netlib.set_threads(2)
    seen: list[bool] = []
    parallel.run([lambda: seen.append(product_threads.begin(2))] * 4)
    assert seen == [False] * 4 and counts == []


SETS = """
import netlib, numpy
from fast import product_threads
print(product_threads.begin(2))
"""


def test_a_number_that_the_user_has_set_is_kept() -> None:
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    out = run_python("-c", SETS, **(dict.fromkeys(names) | {"OMP_NUM_THREADS": "1"})).out
    assert out.strip() == "False"


def test_the_values_are_those_of_one_thread() -> None:
    rng = np.random.default_rng(2)
    net, x = make(1), rng.normal(size=(1, 4, 200, 300)).astype(np.float32)
    found = []
    for threads in (1, 2):
        netlib.set_threads(threads)
        found.append(net.forward(x=x)["c"].copy())
    np.testing.assert_allclose(found[1], found[0], rtol=1e-5, atol=1e-6)
