"""Arrays that exceed the memory raise an error before allocation, with the layer, the size and the option to lower."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import netlib
from netlib.system import memory
from netlib.system.memory import OutOfMemoryError, format_bytes
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

MakeNet = Callable[..., netlib.Net]
MakeList = Callable[..., Path]

INPUT = inputs(x=(10, 100))
INNER = """layer { name: "FC1" type: "InnerProduct" bottom: "x" top: "y"
  inner_product_param { num_output: 2000 } }
"""


@pytest.fixture
def machine(monkeypatch: pytest.MonkeyPatch) -> Callable[[float], None]:
    """``machine(1e6)`` sets the available memory in bytes."""

    def make(size: float) -> None:
        monkeypatch.setattr(memory, "available", lambda: (size, "this machine has"))

    return make


def test_a_size_in_words() -> None:
    """Sizes are printed with two digits."""
    sizes = [0, 999, 1000, 9_949, 9_960, 20e9, 8.64e12, 999.6e6, 5e30]
    assert [format_bytes(int(size)) for size in sizes] == [
        "0 bytes", "999 bytes", "1.0 kB", "9.9 kB", "10 kB", "20 GB", "8.6 TB", "1.0 GB", "5000000000000 EB"
    ]


# ---------------------------------------------------------------------------------------------- nets


def test_parameters_of_one_layer(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """The error occurs before allocation and is also a MemoryError."""
    machine(500_000)
    with pytest.raises(OutOfMemoryError) as raised:
        net_of(INPUT + INNER)
    assert isinstance(raised.value, netlib.LayerError)
    assert isinstance(raised.value, MemoryError)
    assert str(raised.value) == (
        "net.prototxt:2:25: error: layer 'FC1': 800 kB of parameters; this machine has 500 kB: lower num_output"
    )


def test_what_fits_is_not_refused(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """The limit is exact to the byte: it counts weights, biases and the blobs of a pass."""
    everything = 4 * (2000 * 100 + 2000) + 4 * (10 * 100 + 10 * 2000)
    machine(everything)
    net_of(INPUT + INNER).forward()
    machine(everything - 1)
    with pytest.raises(OutOfMemoryError):
        net_of(INPUT + INNER).forward()


def test_parameters_of_all_layers(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """The error names the first layer at which the sum of all parameters is too large."""
    machine(2_000_000)
    text = INPUT + "".join(INNER.replace("FC1", f"FC{i}").replace('"y"', f'"y{i}"') for i in range(4))
    with pytest.raises(OutOfMemoryError, match=r"layer 'FC2': 2\.4 MB of parameters in total, 800 kB of them here; "
                                               "this machine has 2.0 MB: lower num_output"):
        net_of(text)


def test_parameters_of_one_name_count_once(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """Shared parameters are counted once."""
    machine(1_700_000)
    shared = INNER.replace("inner_product_param", 'param { name: "w" } param { name: "b" } inner_product_param')
    text = INPUT + "".join(shared.replace("FC1", f"FC{i}").replace('"y"', f'"y{i}"') for i in range(4))
    assert len(net_of(text).learnable) == 2


def test_blobs_of_a_pass(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """The size of the blobs is checked when the net runs, so a smaller batch can be set first."""
    machine(1000)
    net = net_of(INPUT + 'layer { name: "r" type: "ReLU" bottom: "x" top: "y" }')
    with pytest.raises(OutOfMemoryError, match=r"layer 'x': blob 'x': 4\.0 kB, of 8\.0 kB for parameters and blobs of "
                                               r"the net in total; this machine has 1\.0 kB: lower the b"):
        net.forward()
    net.blobs["x"].reshape(1, 100)
    net.reshape()
    assert net.forward()["y"].shape == (1, 100)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ('type: "DummyData" top: "d" dummy_data_param { shape { dim: 20000 } }',
         "1:62: error: layer 'd': blob 'd': 80 kB for an array (20000,); this machine has 10 kB: lower dim"),
        ('type: "Parameter" top: "d" parameter_param { shape { dim: 20000 } }',
         "1:61: error: layer 'd': 80 kB of parameters; this machine has 10 kB: lower dim"),
        ('type: "DummyData" top: "d" dummy_data_param { shape { dim: 4611686018427387904 dim: 7 } }',
         "1:62: error: layer 'd': blob 'd': a blob cannot have the shape (4611686018427387904, 7): "
         "no computer has so much memory: lower dim"),
    ],
)
def test_layers_without_bottoms(net_of: MakeNet, machine: Callable[[float], None], text: str, message: str) -> None:
    """Layers without bottoms raise the error when they are built."""
    machine(10_000)
    with pytest.raises(OutOfMemoryError) as raised:
        net_of(f'layer {{ name: "d" {text} }}')
    assert message.split("error: ")[1] in str(raised.value)


def test_a_huge_batch(net_of: MakeNet, machine: Callable[[float], None], write_rows: MakeList) -> None:
    """A data layer's batch that is too large is reported with batch_size."""
    path = write_rows("list.txt", [4], d=(3,))
    text = f'hdf5_data_param {{ source: "{path}" batch_size: 5000 }}'
    net = net_of(f'layer {{ name: "data" type: "HDF5Data" top: "d" {text} }}')
    machine(10_000)
    with pytest.raises(OutOfMemoryError, match=r"layer 'data': blob 'd': 60 kB, .*: lower batch_size"):
        net.forward()


def test_a_gradient(net_of: MakeNet, machine: Callable[[float], None]) -> None:
    """Arrays that only backward needs are checked in backward."""
    net = net_of("force_backward: true " + INPUT + INNER)
    net.forward()
    machine(79_000)
    with pytest.raises(OutOfMemoryError, match=r"80 kB for an array \(10, 2000\)"):
        net.backward()


def test_a_layers_own_arrays(net_of: MakeNet, monkeypatch: pytest.MonkeyPatch) -> None:
    """A MemoryError, or NumPy's error for an array that is too big, is reported with the layer."""
    net = net_of(INPUT + INNER)
    for error, line in (
        (MemoryError("Unable to allocate 7 GiB"), "forward needs more memory than there is: Unable to allocate 7 GiB"),
        (MemoryError(), "forward needs more memory than there is"),
        (ValueError("array is too big; `arr.size`"), "forward needs more memory than there is: array is too big; "),
    ):

        def forward(*blobs: object, error: Exception = error) -> None:
            raise error

        monkeypatch.setattr(net.layers[1], "forward", forward)
        with pytest.raises(OutOfMemoryError) as raised:
            net.forward()
        assert f"net.prototxt:2:25: error: layer 'FC1': {line}" in str(raised.value)
        assert str(raised.value).endswith(": lower num_output")


def test_a_blob_of_ones_own(machine: Callable[[float], None]) -> None:
    """A blob without a layer raises the error without a layer name."""
    machine(1000)
    with pytest.raises(OutOfMemoryError, match=r"^4\.0 kB for an array \(1000,\); this machine has 1\.0 kB$"):
        netlib.Blob((1000,)).data  # noqa: B018


def test_a_solver(tmp_path: Path, machine: Callable[[float], None]) -> None:
    """Parameters, gradients and histories count, two histories for Adam; frozen parameters have none."""
    (tmp_path / "net.prototxt").write_text(INPUT + INNER)
    solver = tmp_path / "solver.prototxt"
    solver.write_text('net: "net.prototxt" type: "Adam" base_lr: 0.1 lr_policy: "fixed"')
    machine(4 * 808_000)
    netlib.get_solver(solver)
    machine(4 * 808_000 - 1)
    with pytest.raises(OutOfMemoryError, match=r"3\.2 MB for parameters, their gradients and the history of solver "
                                               "type Adam; this machine has"):
        netlib.get_solver(solver)
    frozen = INNER.replace("inner_product_param", "param { lr_mult: 0 } param { lr_mult: 0 } inner_product_param")
    (tmp_path / "net.prototxt").write_text(INPUT + frozen)
    netlib.get_solver(solver)


# ---------------------------------------------------------------------------------------------- available memory


@pytest.fixture
def system(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., tuple[float, str]]:
    """``system({"proc/meminfo": "MemTotal: 5 kB"})`` returns the available memory of a system with these files."""
    monkeypatch.setattr(memory, "PROC", tmp_path / "proc")
    monkeypatch.setattr(memory, "CGROUPS", tmp_path / "cgroup")
    monkeypatch.setattr(memory, "_address_space", lambda: iter(()))

    def look(files: dict[str, str]) -> tuple[float, str]:
        for name, text in files.items():
            path = tmp_path / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(text)
        return memory.available.__wrapped__()

    return look


MEMINFO = "MemTotal:       1000 kB\nMemFree:  7 kB\nSwapTotal:   24 kB\n"


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, (math.inf, "")),
        ({"proc/meminfo": MEMINFO}, (1024 * 1024, "this machine has")),
        ({"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/a/b\n", "cgroup/a/b/memory.max": "max\n",
          "cgroup/a/memory.max": "5000\n", "cgroup/a/memory.swap.max": "0\n"}, (5000, "this process may use")),
        ({"proc/meminfo": MEMINFO, "proc/self/cgroup": "0::/\n", "cgroup/memory.max": "5000\n"},
         (5000 + 24 * 1024, "this process may use")),
        ({"proc/meminfo": MEMINFO, "proc/self/cgroup": "5:cpu:/\n4:memory:/c\n",
          "cgroup/memory/memory.limit_in_bytes": "9223372036854771712\n",
          "cgroup/memory/c/memory.limit_in_bytes": "6000\n"}, (6000 + 24 * 1024, "this process may use")),
        ({"proc/meminfo": "nothing known", "proc/self/cgroup": "odd"}, (math.inf, "")),
    ],
    ids=["unknown", "machine", "a group above", "a container", "version 1", "odd files"],
)
def test_what_is_available(system: Callable[..., tuple[float, str]], files: dict[str, str],
                           expected: tuple[float, str]) -> None:
    """The memory is the minimum of the machine's memory and the limits of all control groups, with swap space."""
    assert system(files) == expected


def test_the_limit_of_the_address_space(monkeypatch: pytest.MonkeyPatch) -> None:
    """The limit set by ``ulimit -v`` counts, if there is one."""
    resource = pytest.importorskip("resource")
    for limit, found in ((12345, [12345]), (resource.RLIM_INFINITY, [])):
        monkeypatch.setattr(resource, "getrlimit", lambda kind, limit=limit: (limit, limit))
        assert list(memory._address_space()) == found


def test_random_numbers_are_those_of_one_draw() -> None:
    """Numbers drawn block by block equal those of a single draw."""
    from netlib import fillers

    whole = np.random.default_rng(0).normal(0, 1, (3, fillers.BLOCK))
    array = np.zeros((3, fillers.BLOCK), np.float64)
    fillers.fill(array, fillers.Filler(type="gaussian"), np.random.default_rng(0))
    assert np.array_equal(array, whole)
