"""Arrays that exceed the memory raise an error before allocation, with the layer and the size."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.system import memory
from netlib.system.memory import OutOfMemoryError, format_bytes
from tests.netlib.conftest import MakeNet
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines


INPUT = inputs(x=(10, 100))
INNER = """layer { name: "FC1" type: "InnerProduct" bottom: "x" top: "y"
  inner_product_param { num_output: 2000 } }
"""


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """``machine(1e6)`` sets the memory of the machine in bytes."""

    def make(size: float) -> None:
        monkeypatch.setattr(memory, "physical", lambda: size)

    return make


def test_a_size_in_words() -> None:
    sizes = [0, 999, 1000, 9_949, 9_960, 20e9, 8.64e12, 999.6e6, 5e30]
    assert [format_bytes(int(size)) for size in sizes] == [
        "0 bytes",
        "999 bytes",
        "1.0 kB",
        "9.9 kB",
        "10 kB",
        "20 GB",
        "8.6 TB",
        "1.0 GB",
        "5000000000000 EB",
    ]


def test_parameters(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """The error is raised before allocation and is also a MemoryError; shared
    parameters count once.
    """
    machine(2_000_000)
    layers = [INNER.replace("FC1", f"FC{i}").replace('"y"', f'"y{i}"') for i in range(4)]
    text = INPUT + "".join(layers)
    with pytest.raises(OutOfMemoryError) as raised:
        net_of(text)
    assert isinstance(raised.value, netlib.LayerError)
    assert isinstance(raised.value, MemoryError)
    assert str(raised.value) == (
        "net.prototxt:5:7: error: layer 'FC2': setup: 2.4 MB of parameters; this machine has "
        "2.0 MB; use a smaller batch or layer"
    )
    net_of(
        text.replace(
            "inner_product_param", 'param { name: "w" } param { name: "b" } inner_product_param'
        )
    )


def test_the_memory_limit_is_exact_to_the_byte(
    net_of: MakeNet, machine: Callable[[float], None]
) -> None:
    """It counts weights, biases and the blobs of a pass."""
    everything = 4 * (2000 * 100 + 2000) + 4 * (10 * 100 + 10 * 2000)
    machine(everything)
    net_of(INPUT + INNER).forward()
    machine(everything - 1)
    with pytest.raises(
        OutOfMemoryError,
        match=r"layer 'FC1': forward: 892 kB for all blobs of the net; this machine",
    ):
        net_of(INPUT + INNER).forward()


def test_a_smaller_batch_can_be_set_before_a_pass(
    net_of: MakeNet, machine: Callable[[float], None]
) -> None:
    machine(1000)
    net = net_of(INPUT + 'layer { name: "r" type: "ReLU" bottom: "x" top: "y" }')
    with pytest.raises(
        OutOfMemoryError, match=r"layer 'x': forward: 8\.0 kB for all blobs of the net"
    ):
        net.forward()
    net.blobs["x"].reshape(1, 100)
    net.reshape()
    assert net.forward()["y"].shape == (1, 100)


def test_a_gradient(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    net = net_of("force_backward: true " + INPUT + INNER)
    net.forward()
    machine(79_000)
    with pytest.raises(OutOfMemoryError, match=r"layer 'FC1': .*80 kB for an array \(10, 2000\)"):
        net.backward()


@pytest.mark.parametrize(
    ("error", "line"),
    [
        (
            MemoryError("Unable to allocate 7 GiB"),
            "needs more memory than there is: Unable to allocate 7 GiB;",
        ),
        (MemoryError(), "needs more memory than there is;"),
        (
            ValueError("array is too big; `arr.size`"),
            "needs more memory than there is: array is too big; ",
        ),
    ],
)
def test_a_layers_own_arrays(
    net_of: MakeNet, monkeypatch: pytest.MonkeyPatch, error: Exception, line: str
) -> None:
    net = net_of(INPUT + INNER)

    def forward(*blobs: object) -> None:
        raise error

    monkeypatch.setattr(net.layers[1], "forward", forward)
    with pytest.raises(OutOfMemoryError) as raised:
        net.forward()
    assert f"net.prototxt:1:93: error: layer 'FC1': forward: {line}" in str(raised.value)


def test_a_blob_without_a_net(machine: Callable[[float], None]) -> None:
    machine(1000)
    with pytest.raises(
        OutOfMemoryError, match=r"^4\.0 kB for an array \(1000,\); this machine has 1\.0 kB$"
    ):
        netlib.Blob((1000,)).data  # noqa: B018


def test_a_solver(tmp_path: Path, machine: Callable[[float], None]) -> None:
    """Parameters, gradients and histories count, two histories for Adam; frozen
    parameters have none.
    """
    (tmp_path / "net.prototxt").write_text(INPUT + INNER)
    solver = tmp_path / "solver.prototxt"
    solver.write_text('net: "net.prototxt" type: "Adam" base_lr: 0.1 lr_policy: "fixed"')
    machine(4 * 808_000)
    netlib.get_solver(solver)
    machine(4 * 808_000 - 1)
    with pytest.raises(
        OutOfMemoryError,
        match=r"3\.2 MB for parameters, their gradients and the history of solver "
        "type Adam; this machine has",
    ):
        netlib.get_solver(solver)
    frozen = INNER.replace(
        "inner_product_param", "param { lr_mult: 0 } param { lr_mult: 0 } inner_product_param"
    )
    (tmp_path / "net.prototxt").write_text(INPUT + frozen)
    netlib.get_solver(solver)


def test_the_memory_of_this_machine() -> None:
    assert 2**28 < memory.physical() < 2**50


def test_random_numbers_are_those_of_one_draw() -> None:
    from netlib import fillers

    whole = np.random.default_rng(0).normal(0, 1, (3, fillers.BLOCK))
    array = np.zeros((3, fillers.BLOCK), np.float64)
    fillers.fill(array, fillers.Filler(type="gaussian"), np.random.default_rng(0))
    assert np.array_equal(array, whole)
