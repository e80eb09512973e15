"""Snapshots: Caffe's layout, written completely or not at all, and one-line errors for
invalid files.
"""

from __future__ import annotations

import errno
import os
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import netlib
from netlib.files import atomic, hdf5
from netlib.snapshots import snapshot
from netlib.snapshots.solver_state import SolverState
from netlib.snapshots.weights import image
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5

pytestmark = pytest.mark.both_engines

NET = """
    layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 } } }
    layer { name: "a" type: "InnerProduct" bottom: "x" top: "a" param { name: "w" }
            inner_product_param { num_output: 3 weight_filler { type: "xavier" } } }
    layer { name: "relu" type: "ReLU" bottom: "a" top: "a" }
    layer { name: "part/b" type: "InnerProduct" bottom: "a" top: "b" param { name: "w" }
            inner_product_param { num_output: 3 bias_term: false } }
"""


@pytest.fixture(params=[".h5", ""], ids=["HDF5", "binary"])
def names(request: pytest.FixtureRequest, here: Path) -> tuple[Path, Path]:
    return Path(f"w.caffemodel{request.param}"), Path(f"s.solverstate{request.param}")


@pytest.fixture
def net(net_of: Callable[..., netlib.Net]) -> netlib.Net:
    """A net with two layers that share a weight, one without parameters, and one with a
    slash in its name.
    """
    return net_of(NET)


def state_of(net: netlib.Net, iteration: int = 5) -> SolverState:
    histories = [np.full(p.blob.shape, iteration, np.float32) for p in net.learnable]
    return SolverState(iteration, 2, "dir/w_iter_5.caffemodel.h5", histories, {"smoothed": [3.0]})


def write_pair(net: netlib.Net, state: SolverState, weights: Path, states: Path) -> None:
    snapshot.write_pair(image(net, weights), state, weights, states)


def everything_in(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_weights_name_their_net(
    net_of: Callable[..., netlib.Net], names: tuple[Path, Path]
) -> None:
    """Both formats store the name of the net; it is empty for a net and for a file without one."""
    for name in ("a net ü", ""):
        text = 'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 1 } } }'
        net_of(f'name: "{name}" {text}').save(names[0])
        assert snapshot.net_name(names[0]) == name


def test_a_snapshot_is_read_whatever_its_name(
    net: netlib.Net, names: tuple[Path, Path], here: Path
) -> None:
    write_pair(net, state_of(net), *names)
    names = names[0].rename("weights"), names[1].rename("state")
    found = snapshot.read_weights(names[0])
    assert np.array_equal(found["a"][0], net.params["a"][0].data)
    assert np.array_equal(found["a"][1], net.params["a"][1].data)
    state = snapshot.read_state(names[1])
    assert (state.iter, state.current_step, state.learned_net) == (
        5,
        2,
        "dir/w_iter_5.caffemodel.h5",
    )
    assert state.extra == {
        "smoothed": [3.0],
        "weights_crc": zlib.crc32(Path(names[0]).read_bytes()),
        "checksum": state.checksum(),
    }
    assert [h.tolist() for h in state.history] == [h.tolist() for h in state_of(net).history]


def test_a_slash_in_a_layer_name(
    net_of: Callable[..., netlib.Net], names: tuple[Path, Path]
) -> None:
    """A slash nests HDF5 groups; the weights still load if ``a`` and ``a/b`` both
    have parameters.
    """
    text = NET.replace('param { name: "w" }', "").replace('"part/b"', '"a/b"')
    one, two = net_of(text), net_of(text, seed=2)
    one.params["a/b"][0].data[...] = 7
    one.save(names[0])
    two.copy_from(names[0])
    for name in ("a", "a/b"):
        assert np.array_equal(two.params[name][0].data, one.params[name][0].data)


def full_disk(*args: Any) -> None:
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.parametrize("call", ["fsync", "first replace"])
def test_a_failure_leaves_the_old_pair(
    net: netlib.Net,
    names: tuple[Path, Path],
    here: Path,
    monkeypatch: pytest.MonkeyPatch,
    call: str,
) -> None:
    write_pair(net, state_of(net, 5), *names)
    before = everything_in(here)
    net.params["a"][0].data[...] = 9
    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync" if call == "fsync" else "replace", full_disk)
        with pytest.raises(
            netlib.WeightsError,
            match=r"(w|s)\.[a-z.5]+: cannot write the snapshot: No space left on device$",
        ):
            write_pair(net, state_of(net, 6), *names)
    assert everything_in(here) == before


def test_the_state_is_synced_once_and_before_the_weights_are_renamed(
    net: netlib.Net, names: tuple[Path, Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[str] = []
    sync_file, rename = atomic.sync_file, os.replace
    monkeypatch.setattr(
        atomic, "sync_file", lambda path: (calls.append(f"sync {path.name[1]}"), sync_file(path))
    )
    monkeypatch.setattr(
        os,
        "replace",
        lambda old, new: (calls.append(f"rename {Path(new).name[0]}"), rename(old, new)),
    )
    write_pair(net, state_of(net), *names)
    assert calls == ["sync s", "sync w", "rename w", "rename s"]


def test_a_checksum_does_not_admit_links_into_other_files(here: Path) -> None:
    with h5py.File("w.h5", "w") as file:
        file["data/fc/0"] = h5py.ExternalLink("other.h5", "/secret")
    Path("w.h5").write_bytes(hdf5.sealed(Path("w.h5").read_bytes()))
    with pytest.raises(netlib.WeightsError, match=r"link into another file, 'other\.h5'"):
        snapshot.read_weights("w.h5")


def test_two_trainings_into_one_prefix(tmp_path: Path) -> None:
    with snapshot.prefix_in_use(tmp_path / "w"):
        with pytest.raises(
            netlib.WeightsError, match=rf"/w: another training .* \(process {os.getpid()}\); wait"
        ):
            snapshot.prefix_in_use(tmp_path / "w").__enter__()
        with snapshot.prefix_in_use(tmp_path / "w2"):
            pass
    with snapshot.prefix_in_use(tmp_path / "w"):
        pass
    assert everything_in(tmp_path) == {}


def test_the_probe_leaves_nothing_and_names_the_directory(
    here: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with snapshot.prefix_in_use(Path("new/prefix")):
        assert list(everything_in(Path("new"))) == [".prefix.netlib.lock"]
    monkeypatch.setattr(Path, "write_bytes", full_disk)
    full = r"new: cannot write snapshots there: No space left on device$"
    with pytest.raises(netlib.WeightsError, match=full):
        snapshot.prefix_in_use(Path("new/prefix")).__enter__()
    assert everything_in(Path("new")) == {}


@pytest.fixture
def pair(net: netlib.Net, names: tuple[Path, Path]) -> tuple[Path, Path]:
    write_pair(net, state_of(net), *names)
    return names


STATE = "this is a solver state, not weights; expected its pair, dir/w_iter_5.caffemodel.h5 (... --snapshot)"


@bad_inputs(
    netlib.WeightsError,
    {
        "folder": (
            lambda at, pair: snapshot.read_weights(at),
            "...: cannot read weights: Is a directory; expected a file",
        ),
        "a state as weights": (
            lambda at, pair: snapshot.read_weights(pair[1]),
            f"...solverstate...: {STATE}",
        ),
        "weights as a state": (
            lambda at, pair: snapshot.read_state(pair[0]),
            "...caffemodel...: this is a weights file; "
            "pass it as --weights, or its pair *.solverstate... here",
        ),
        "no weights": (
            lambda at, pair: snapshot.read_weights(at / "no"),
            "...no: cannot read weights: No such file ...",
        ),
        "nothing": (
            lambda at, pair: snapshot.read_weights(at / "empty"),
            "...empty: it has no layers; expected weights (.caffemodel); the file is empty",
        ),
        "text": (
            lambda at, pair: snapshot.read_weights(at / "text"),
            "...: ...; expected weights (.caffemodel); it looks like a text file",
        ),
        "data": (
            lambda at, pair: snapshot.read_weights(at / "data.h5"),
            "...data.h5: no group /data; expected weights in the layout of Caffe's HDF5 snapshots",
        ),
        "data as a state": (
            lambda at, pair: snapshot.read_state(at / "data.h5"),
            "...data.h5: not a solver state",
        ),
        "text as a state": (
            lambda at, pair: snapshot.read_state(at / "text"),
            "...text: ...; expected a solver state (.solverstate); it looks like a text file",
        ),
        "no state": (
            lambda at, pair: snapshot.read_state(at / "no"),
            "...no: cannot read a solver state: No such file...",
        ),
    },
)
def test_files_of_another_kind(
    here: Path, pair: tuple[Path, Path], given: Callable[..., object], rejected: Any
) -> None:
    """The error names the weights that belong to a state, and the options for resuming
    and for starting.
    """
    write_hdf5("data.h5", depth=np.zeros(3))
    Path("text").write_text("type: 'SGD'")
    Path("empty").touch()
    with rejected:
        given(here, pair)


@pytest.mark.parametrize(
    "structure",
    [
        {"data/a/first": np.zeros(3)},
        {"data/a/0": "text"},
        {"iter": np.zeros(0, int), "history/0": np.zeros(3)},
        {"iter/x": np.zeros(3), "history/0": np.zeros(3)},
        {"iter": np.zeros(1, int), "history/7": np.zeros(3)},
        {"iter": np.zeros(1, int), "history": np.zeros(3)},
        {"iter": np.zeros(1, int), "history/0": np.zeros(3), "netlib": "no JSON"},
        {"iter": np.zeros(1, int), "history/0": np.zeros(3), "netlib": "[1, 2]"},
        {"iter": np.zeros(1, int), "history/0": np.zeros(3), "learned_net": np.zeros(2)},
    ],
    ids=str,
)
def test_unexpected_content_gives_at_most_an_error_of_one_line(
    net: netlib.Net, here: Path, structure: dict[str, Any]
) -> None:
    path = write_hdf5("x.h5", **structure)
    try:
        snapshot.read_state(path) if "iter" in str(structure) else net.copy_from(path)
    except netlib.WeightsError as error:
        assert "\n" not in str(error)
