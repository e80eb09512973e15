"""netlib/files/hdf5.py: files that refer to other files, crash the library or hang it; rows by plain reads."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from netlib import files
from netlib.errors import DataError, WeightsError
from netlib.files import hdf5, hdf5_helper
from netlib.files.paths import ROOT
from netlib.snapshots import hdf5_format
from tests.support.hdf5_files import write_hdf5

PRETENDER = """
import json, os, signal, sys
print(json.dumps({"ready": True}), flush=True)
for line in sys.stdin:
    name = os.path.basename(json.loads(line)["path"])
    if "crash" in name:
        os.kill(os.getpid(), signal.SIGSEGV)
    while "endless" in name:
        signal.pause()
    print(json.dumps({"fault": ""}), flush=True)
"""


@pytest.fixture
def pretender(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Replace the helper process by one that crashes or hangs, depending on the name of the file."""
    (tmp_path / "pretender.py").write_text(PRETENDER)
    state = hdf5_helper._State()
    monkeypatch.setattr(hdf5_helper, "CHECK", tmp_path / "pretender.py")
    monkeypatch.setattr(hdf5_helper, "SECONDS", 60.0)
    monkeypatch.setattr(hdf5_helper, "_state", state)
    yield
    state.end()


# ---------------------------------------------------------------------------------------------- rejected files


def test_what_is_wrong_says_what_was_wanted(tmp_path: Path) -> None:
    """Errors of the file and of the block have the caller's error class."""
    path = write_hdf5(tmp_path / "a.h5", x=np.zeros(3))
    with hdf5.opened(path, "weights", WeightsError) as file:
        assert list(file) == ["x"]
    wrong = r"a\.h5: cannot read weights: damaged, or not as expected: .*'y'"
    with pytest.raises(WeightsError, match=wrong), hdf5.opened(path, "weights", WeightsError) as file:
        file["y"]
    (tmp_path / "text.h5").write_text("no HDF5")
    wrong = r"text\.h5: cannot read the data: damaged or truncated: .*signature not found"
    with pytest.raises(DataError, match=wrong), hdf5.opened(tmp_path / "text.h5", "the data"):
        pass


def external_link(file: h5py.File) -> None:
    """Following the link would open any file or pipe that it names."""
    file["deep/x"] = h5py.ExternalLink("other.h5", "x")


def external_storage(file: h5py.File) -> None:
    """The values are the bytes of another file."""
    file.create_dataset("x", (4,), "u1", external=[("/etc/hostname", 0, 4)])


def virtual(file: h5py.File) -> None:
    """A virtual data set that refers to itself: reading it overflows the library's stack."""
    layout = h5py.VirtualLayout((4,), "f4")
    layout[:] = h5py.VirtualSource(file.filename, "x", (4,))
    file.create_virtual_dataset("x", layout)


def never_written(file: h5py.File) -> None:
    """HDF5 would fill in the values."""
    file.create_dataset("x", (10**12,), "f4", chunks=(1024,))


def another_filter(file: h5py.File) -> None:
    """HDF5 would search for a plug-in and load it."""
    file.create_dataset("x", data=np.zeros(100), compression="gzip", scaleoffset=2, chunks=(10,))


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (
            external_link,
            "'/deep/x' is a link into another file, 'other.h5', which is not followed; expected all in one",
        ),
        (external_storage, "data set '/x' is kept in another file, '/etc/hostname', which is not read; expected all"),
        (virtual, "data set '/x' is virtual"),
        (never_written, "data set '/x' claims 4000000000000 bytes, but only 0 are stored; expected data"),
        (another_filter, "data set '/x' is compressed by filter 6 ("),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_files_that_are_not_opened(tmp_path: Path, make: Any, fault: str) -> None:
    """The error states the fault and what is expected."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        make(file)
    with pytest.raises(DataError) as error, hdf5.opened(tmp_path / "a.h5", "the data"):
        pass
    assert str(error.value).startswith(f"{tmp_path}/a.h5: cannot read the data: {fault}")


def test_links_within_a_file(tmp_path: Path) -> None:
    """Links are followed; a broken or circular link matters only if it is read."""
    with h5py.File(write_hdf5(tmp_path / "a.h5", x=np.arange(3)), "r+") as file:
        file["y"], file["nowhere"] = h5py.SoftLink("/x"), h5py.SoftLink("/none")
        file["group/up"] = file["/"]
    assert hdf5.File(tmp_path / "a.h5", ("x", "y")).datasets[1][:].tolist() == [0, 1, 2]
    with pytest.raises(DataError, match="no data set 'nowhere'; it has x, y"):
        hdf5.File(tmp_path / "a.h5", ("nowhere",))


def test_the_library_crashes(tmp_path: Path, pretender: None) -> None:
    """The library crashes in the helper process; the next file is checked by a new helper."""
    with pytest.raises(DataError, match=r"damaged: the HDF5 library crashes on it \(status -11\)"):
        hdf5.File(write_hdf5(tmp_path / "crash.h5", x=np.zeros(3)), ("x",))
    assert hdf5.File(write_hdf5(tmp_path / "good.h5", x=np.zeros(3)), ("x",)).rows == 3


def test_the_library_never_returns(tmp_path: Path, pretender: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """A helper that does not finish is ended after a time limit; the next file is checked by a new one."""
    with monkeypatch.context() as patch, pytest.raises(DataError, match="damaged: the HDF5 library does not finish"):
        patch.setattr(hdf5_helper, "SECONDS", 0.1)
        hdf5.File(write_hdf5(tmp_path / "endless.h5", x=np.zeros(3)), ("x",))
    assert hdf5.File(write_hdf5(tmp_path / "good.h5", x=np.zeros(3)), ("x",)).rows == 3


def test_a_file_is_looked_at_once(tmp_path: Path, pretender: None) -> None:
    """A file is checked once; a changed file has another identity."""
    path = write_hdf5(tmp_path / "crash.h5", x=np.zeros(3))
    with path.open("rb") as stream:
        before = files.identity(stream.fileno())
    hdf5_helper.fault_of.cache_clear()
    for _ in range(3):
        hdf5_helper.fault_of(str(path), before)
    assert hdf5_helper.fault_of.cache_info().misses == 1
    os.utime(path, ns=(1, 1))
    with path.open("rb") as stream:
        assert files.identity(stream.fileno()) != before


def test_without_a_helper(
    tmp_path: Path, pretender: None, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """If the helper cannot be started, the file is opened without a check and a note is logged."""
    monkeypatch.setattr(hdf5_helper, "CHECK", tmp_path / "not there.py")
    path = write_hdf5(tmp_path / "a.h5", x=np.zeros(3))
    assert hdf5.File(path, ("x",)).rows == 3
    assert "cannot start the helper process" in caplog.text


def test_a_file_that_is_exchanged_after_the_look(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file that is replaced between the check and the opening raises an error."""
    path, other = write_hdf5(tmp_path / "a.h5", x=np.zeros(3)), write_hdf5(tmp_path / "other.h5", x=np.zeros(3))

    def look(name: str, identity: object) -> str:
        other.replace(path)
        return ""

    monkeypatch.setattr(hdf5_helper, "fault_of", look)
    with pytest.raises(DataError, match=r"a\.h5: was changed while it was opened; run again"):
        hdf5.File(path, ("x",))


def test_content_that_was_read_before(tmp_path: Path) -> None:
    """Content that was read before is opened from memory; a file that has changed since raises an error."""
    path = write_hdf5(tmp_path / "x.h5", a=np.arange(3))
    content = files.read_content(path, "data")
    for _ in range(2):
        with hdf5.opened(content, "data") as file:
            np.testing.assert_array_equal(file["a"][...], [0, 1, 2])
    write_hdf5(path, a=np.zeros(3))
    with pytest.raises(DataError, match=r"x\.h5: was changed while it was opened"), hdf5.opened(content, "data"):
        pass


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_a_forked_process_has_a_helper_of_its_own(tmp_path: Path) -> None:
    """A forked process starts its own helper; the parent's helper keeps running."""
    one, two = write_hdf5(tmp_path / "one.h5", x=np.zeros(1)), write_hdf5(tmp_path / "two.h5", x=np.zeros(2))
    hdf5.File(one, ("x",))
    parents = hdf5_helper._state.helper
    child = os.fork()
    if child == 0:
        rows = hdf5.File(two, ("x",)).rows
        own = hdf5_helper._state.helper is not parents
        hdf5_helper._state.end()
        os._exit(rows if own else 99)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 2
    assert hdf5.File(write_hdf5(tmp_path / "three.h5", x=np.zeros(3)), ("x",)).rows == 3
    assert hdf5_helper._state.helper is parents


def test_a_helper_that_is_gone(tmp_path: Path) -> None:
    """If the helper was killed between two files, a new one checks the next file."""
    hdf5.File(write_hdf5(tmp_path / "one.h5", x=np.zeros(1)), ("x",))
    helper = hdf5_helper._state.helper
    assert helper is not None
    helper._process.kill()
    helper._process.wait()
    assert hdf5.File(write_hdf5(tmp_path / "two.h5", x=np.zeros(2)), ("x",)).rows == 2


@pytest.mark.skipif(not hasattr(os, "getsid"), reason="there are no sessions here")
def test_a_terminals_signals_do_not_reach_the_helper(tmp_path: Path) -> None:
    """The helper runs in its own session, so Ctrl-C ends the training but does not kill the helper."""
    hdf5.File(write_hdf5(tmp_path / "one.h5", x=np.zeros(1)), ("x",))
    assert hdf5_helper._state.helper is not None
    assert os.getsid(hdf5_helper._state.helper._process.pid) != os.getsid(0)


def test_an_answer_that_nobody_waited_for(tmp_path: Path, pretender: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """After an interrupted check the helper is ended, so that its late answer is not used for the next file."""
    hdf5.File(write_hdf5(tmp_path / "one.h5", x=np.zeros(1)), ("x",))
    helper = hdf5_helper._state.helper
    assert helper is not None
    with pytest.raises(KeyboardInterrupt), monkeypatch.context() as patch:
        patch.setattr(helper, "_out", Interrupted(helper._out))
        hdf5.File(write_hdf5(tmp_path / "two.h5", x=np.zeros(2)), ("x",))
    assert hdf5_helper._state.helper is None
    assert hdf5.File(write_hdf5(tmp_path / "three.h5", x=np.zeros(3)), ("x",)).rows == 3


class Interrupted:
    """A stream whose readline is interrupted by Ctrl-C."""

    def __init__(self, stream: Any) -> None:
        self.close = stream.close

    def readline(self) -> str:
        """Raise KeyboardInterrupt."""
        raise KeyboardInterrupt


@pytest.mark.skipif(not hasattr(os, "fork"), reason="there is no fork here")
def test_the_end_of_a_process_whose_child_lives_on(tmp_path: Path) -> None:
    """The helper ends with its process, although a forked child still holds the helper's pipe open."""
    write_hdf5(tmp_path / "a.h5", x=np.zeros(1))
    done = subprocess.run(
        [sys.executable, "-c", PARENT, str(tmp_path / "a.h5")], env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, timeout=120, check=True,
    )
    os.kill(int(done.stdout), signal.SIGKILL)


PARENT = """
import os, signal, sys
from pathlib import Path
from netlib.files import hdf5
hdf5.File(Path(sys.argv[1]), ("x",))
if (child := os.fork()) == 0:
    os.close(1)
    signal.pause()
print(child)
"""


@pytest.mark.skipif(not hasattr(signal, "setitimer"), reason="there are no timers here")
def test_a_helper_whose_process_was_killed(tmp_path: Path) -> None:
    """The helper ends by itself after its time limit, even if the library does not return."""
    endless = CHECK_IN_CIRCLES.format(folder=str(hdf5_helper.CHECK.parent))
    done = subprocess.run(
        [sys.executable, "-c", endless],
        input='{"path": "a.h5", "seconds": 0.05}\n',
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == -signal.SIGALRM


CHECK_IN_CIRCLES = """
import signal, sys
sys.path.append({folder!r})
import hdf5_check
hdf5_check.fault_of = lambda path: signal.pause()
hdf5_check.main()
"""


# ---------------------------------------------------------------------------------------------- rows


def test_numbers_that_no_array_has(tmp_path: Path) -> None:
    """Values with 12 significant bits in 16 are converted by HDF5 instead of read as they are stored."""
    kind = h5py.h5t.STD_I16LE.copy()
    kind.set_precision(12)
    kind.set_offset(4)
    values = np.arange(6000, dtype=np.int16).reshape(2, 3000) % 1000
    with h5py.File(tmp_path / "a.h5", "w") as file:
        dataset = h5py.h5d.create(file.id, b"x", kind, h5py.h5s.create_simple(values.shape))
        dataset.write(h5py.h5s.ALL, h5py.h5s.ALL, values)
    assert np.array_equal(hdf5.File(tmp_path / "a.h5", ("x",)).datasets[0], values)


@pytest.mark.parametrize("shape", [(), (3,), (40, 40)], ids=["numbers", "small rows", "large rows"])
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", "<i2", "u1"])
@pytest.mark.parametrize("options", [{}, {"chunks": True}, {"compression": "gzip"}], ids=str)
def test_rows_are_what_h5py_reads(tmp_path: Path, shape: tuple[int, ...], dtype: str, options: dict[str, Any]) -> None:
    """A single row, a range, a list of rows and all rows equal h5py's; take converts to the type of ``out``."""
    values = np.random.default_rng(3).integers(0, 100, (20, *shape)).astype(dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", data=values, **options)
    rows = hdf5.File(tmp_path / "a.h5", ("x",)).datasets[0]
    assert (rows.shape, rows.dtype) == (values.shape, values.dtype)
    for key in (0, 19, -1, slice(None), slice(3, 9), slice(15, 2, -3), [5, 6, 7, 1, 0, 19, 19], np.array([4])):
        assert np.array_equal(rows[key], values[key]), key
    assert np.array_equal(np.asarray(rows), values)
    out = np.empty((4, *shape), np.float32)
    rows.take(np.array([7, 8, 2, 3]), out)
    assert np.array_equal(out, values[[7, 8, 2, 3]])


def test_a_loop_over_members_does_not_stop_other_threads(tmp_path: Path) -> None:
    """Between two members of a group, also of weights that are read, another thread can use h5py."""
    path = write_hdf5(tmp_path / "a.h5", **{"data/a/0": np.zeros(1), "data/b/0": np.zeros(1)})
    rows: list[int] = []
    with h5py.File(path) as file:
        loops = hdf5_format._layers(file["data"]), iter(hdf5.members(file["data"]))
        assert [next(loop)[0] for loop in loops] == ["a", "a"]
        reader = threading.Thread(target=lambda: rows.append(len(h5py.File(path)["data"])), daemon=True)
        reader.start()
        reader.join(60)
        assert rows == [2]
