"""Damaged files, kills and full disks.

Readers: a damaged file gives a right result or a one-line error: no traceback, no crash, no
hang, bounded memory. The cases run in a forked process, which is replaced when it dies. Its
death is accepted for an HDF5 file without this project's checksum only, because such a file can
crash the HDF5 library.

Writers: after a kill, or on a full disk, the old files or the new ones are there, and the next
run succeeds. Temporary files, which are hidden, may remain. tests/netlib/snapshots/test_kills.py
kills trainings.
"""

from __future__ import annotations

import argparse
import errno
import faulthandler
import functools
import os
import random
import re
import resource
import shutil
import signal
import sys
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from experiments.package_model import write_model
from handpose.frames.cameras import Camera
from handpose.frames.recording import DepthFrame
from handpose.frames.writing import RecordingWriter
from layers.hand import skeleton
from netlib.errors import NetlibError
from netlib.files.hdf5 import SEAL, SEAL_BYTES
from netlib.proto import prototxt
from netlib.proto.binaryproto import write_blob
from netlib.snapshots.hdf5_format import MAGIC
from tests.faults.damage import damaged
from tests.faults.readers import PRODUCT, READERS, Reader, digest, make_states, read_state
from tests.support.made_tracks import any_track, header_of
from tools.common.track_outputs import Outputs, add_output_options

CASES = 40
LIMIT_S, MEMORY = 60, 3 << 30  # of a case; bytes in addition to those of the process that is forked
TEXT_SUFFIXES = (".prototxt", ".txt")
THINGS: tuple[Callable[[Path], object], ...] = (  # in the place of a file
    lambda path: None,
    Path.mkdir,
    os.mkfifo,
    lambda path: path.symlink_to("/dev/zero"),
    lambda path: path.symlink_to(path.name),
    lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 1 << 40),
)

SIZES = (0, 1, 100, 1000, 4096, 20000)  # limits of a file, in bytes

pytestmark = [
    pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork"),
    pytest.mark.filterwarnings("ignore:.*fork.*:DeprecationWarning"),
]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "good").mkdir()
    monkeypatch.chdir(tmp_path / "good")
    monkeypatch.setenv("NETLIB_ENGINE", "plain")  # has no threads, which a fork would lose
    return tmp_path


def in_child(function: Callable[[], Iterator[str]]) -> tuple[int, list[str]]:
    """Run a function in a forked process; returns its exit status, negative for a signal, and the
    lines it yields.
    """
    readable, writable = os.pipe()
    if (child := os.fork()) == 0:
        status = 99
        try:
            for line in function():
                os.write(writable, f"{line}\n".encode("ascii", "backslashreplace"))
            status = 0
        finally:  # a child must never continue as its parent
            os._exit(status)
    os.close(writable)
    with os.fdopen(readable) as stream:
        lines = stream.read().splitlines()
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), lines


def failures(reader: Reader, folder: Path, cases: int = CASES) -> list[str]:
    """Damage the files of a reader, whose good ones are in the working directory; returns one line
    for each failure.
    """
    files = {name: Path(name).read_bytes() for name in reader.make()}
    found: list[str] = []
    first = 0
    while first < cases:
        status, lines = in_child(
            functools.partial(_results, reader, files, folder, range(first, cases))
        )
        begun = [line for line in lines if line.startswith("begin ")]
        found += [line for line in lines if not line.startswith("begin ")]
        if status and not begun[-1].endswith("may crash"):
            found.append(
                f"{begun[-1]}: ended by {signal.Signals(-status).name if status < 0 else status}"
            )
        first = int(begun[-1].split()[1]) + 1
    return found


def _results(
    reader: Reader, files: dict[str, bytes], folder: Path, numbers: range
) -> Iterator[str]:
    """Yield a line at the begin of each case and for each failure."""
    expected = set()
    for name in files:  # an undamaged file can be read
        os.chdir(shutil.copytree(folder / "good", folder / "undamaged"))
        expected.add(digest(reader.read(Path(name))))
        shutil.rmtree(folder / "undamaged")
    if Path("/proc/self/statm").exists():
        used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (used + MEMORY, resource.RLIM_INFINITY))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    faulthandler.disable()
    for number in numbers:
        rng = random.Random(f"{reader.name} {number}")
        path = Path(rng.choice(list(files)))
        content = damaged(
            files[str(path)], files[rng.choice(list(files))], rng, path.suffix in TEXT_SUFFIXES
        )
        may_crash = MAGIC in content[:1024] and not SEAL.fullmatch(content[-SEAL_BYTES:])
        yield f"begin {number} {path}{' may crash' if may_crash else ''}"
        # a new name because of caches
        case = shutil.copytree(folder / "good", folder / f"case{number}")
        os.chdir(case)
        path.unlink()
        if number % 10:
            path.write_bytes(content)
        else:
            rng.choice(THINGS)(path)
        signal.alarm(LIMIT_S)
        if failure := _failure(
            reader, path, expected if reader.exact and content not in files.values() else set()
        ):
            yield f"{number} {path}: {failure}"
        signal.alarm(0)
        shutil.rmtree(case)


def _failure(reader: Reader, path: Path, expected: set[str]) -> str:
    """Read a file; returns what is wrong with the result, if anything."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            found = digest(reader.read(path))
    except NetlibError as error:
        line = str(error)
        names = [path.name, *path.parts[:-1], "layer '"]
        of_another = re.search(r": cannot (read|open|use)|\.(h5|txt|png|jpg):", line)
        is_clear = of_another or any(name in line for name in names)
        return "" if line.isprintable() and is_clear else f"unclear: {line[:200]!r}"
    except BaseException as error:
        place = error.__traceback__
        while place and place.tb_next:
            place = place.tb_next
        where = f"{place.tb_frame.f_code.co_filename}:{place.tb_lineno}" if place else ""
        return f"{type(error).__name__} at {where}: {str(error)[:200]!r}"
    return "read, but not as it was written" if expected and found not in expected else ""


@pytest.mark.parametrize("reader", READERS, ids=lambda reader: reader.name)
def test_damaged_files(reader: Reader, folder: Path) -> None:
    assert failures(reader, folder) == []


def test_the_harness_finds_failures(folder: Path) -> None:
    def read(path: Path) -> object:
        content = path.read_bytes() if path.is_file() else b""
        if len(content) % 3 == 0:
            return {}[content]
        if len(content) % 3 == 1:
            os.kill(os.getpid(), signal.SIGSEGV)
        return content

    def make() -> list[str]:
        Path("a.bin").write_bytes(bytes(range(200)))
        return ["a.bin"]

    found = "\n".join(failures(Reader("bad", make, read, exact=True), folder))
    assert "read, but not as it was written" in found
    assert "KeyError at " in found
    assert "ended by SIGSEGV" in found


def test_a_flipped_bit_in_a_binary_solver_state_is_rejected_or_harmless() -> None:
    make_states()
    path, rng = Path("older_iter_2.solverstate"), random.Random(0)
    content, expected = path.read_bytes(), digest(read_state(path))
    refused = 0
    for _ in range(200):
        bit = rng.randrange(len(content) * 8)
        path.write_bytes(
            content[: bit // 8]
            + bytes([content[bit // 8] ^ 1 << bit % 8])
            + content[bit // 8 + 1 :]
        )
        try:
            assert digest(read_state(path)) == expected
        except NetlibError as error:
            assert str(error).startswith(str(path))
            refused += 1
    assert refused > 190


def write_nets(value: int) -> None:
    net = netlib.Net(prototxt.parse(PRODUCT), netlib.TRAIN, seed=value)
    net.save("net.caffemodel")
    net.save("net.caffemodel.h5")
    write_model(net, None, Path("model.h5"))
    write_blob(np.full((1, 3, 4, 5), value, np.float32), "mean.binaryproto")


def write_tracks(value: int) -> None:
    parser = argparse.ArgumentParser()
    add_output_options(parser)
    header = header_of(skeleton.load())
    names = "--json a.json --csv a.csv --sheet a.png"
    with Outputs(parser.parse_args(names.split()), header, 30.0) as writer:
        for frame in any_track(header, 1, value + 1):
            writer.write(
                np.full((header.camera.height, header.camera.width), 900, np.float32), frame
            )


def write_recordings(value: int) -> None:
    for name in (f"frames{value}", f"stack{value}.npz"):
        shutil.rmtree(name, ignore_errors=True)  # what an earlier run has left is not replaced
        Path(name).unlink(missing_ok=True)
        with RecordingWriter(Path(name), Camera("own", 60, 60, 4, 3, 8, 6), 0.5, 30) as writer:
            for i in range(3):
                writer.write(DepthFrame(i, i / 30, np.full((6, 8), value, np.float32)))


def contents() -> dict[str, bytes]:
    found = {str(path): path for path in Path().rglob("*") if path.is_file()}
    return {name: path.read_bytes() for name, path in found.items() if ".netlib." not in name}


def written(
    write: Callable[[int], None], arm: Callable[[int], object], number: int
) -> Iterator[str]:
    """Write new files under a fault; yields the line of its error."""
    arm(number)
    try:
        write(2)
    except NetlibError as error:
        yield str(error)
    except OSError as error:  # as the tools print it
        yield f"{error.filename}: {error.strerror}"


def kill_before_rename(number: int) -> None:
    def happens(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal number
        if event == "os.rename":  # also of os.replace
            number -= 1
            if not number:
                os.kill(os.getpid(), signal.SIGKILL)

    sys.addaudithook(happens)


def full_disk(number: int) -> None:
    """Let the change of a file with this number fail, and all that need space after it."""

    def happens(event: str, arguments: tuple[Any, ...]) -> None:
        nonlocal number
        writes = event in ("os.mkdir", "fsync") or (
            event == "open" and (arguments[2] or 0) & (os.O_RDWR | os.O_WRONLY)
        )
        if (
            writes
            and not isinstance(arguments[0], int)
            and not str(arguments[0]).startswith(("/dev/", "<_io"))
        ):
            number -= 1
            if number <= 0:
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    sync = os.fsync
    os.fsync = lambda file: (happens("fsync", ("",)), sync(file))[1]
    sys.addaudithook(happens)


def limited_size(number: int) -> None:
    """Let all writes beyond the first bytes of a file fail, also those of other libraries."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SIZES[number - 1], resource.RLIM_INFINITY))


@pytest.mark.parametrize("write", [write_nets, write_tracks, write_recordings])
@pytest.mark.parametrize("fault", [kill_before_rename, full_disk, limited_size])
def test_a_failed_write_leaves_the_old_or_the_new_file(
    write: Callable[[int], None], fault: Callable[[int], object], folder: Path
) -> None:
    write(1)
    old = contents()
    os.chdir(shutil.copytree(folder / "good", folder / "new"))
    write(2)
    new = contents()
    number, is_over = 0, False
    while not is_over and not (fault is limited_size and number == len(SIZES)):
        number += 1
        os.chdir(shutil.copytree(folder / "good", folder / f"{number}"))
        status, lines = in_child(functools.partial(written, write, fault, number))
        line = "".join(lines)
        is_over = not status and not line
        assert (
            status == -signal.SIGKILL if fault is kill_before_rename and not is_over else not status
        ), (number, line)
        if line:
            assert line.isprintable() and any(
                Path(name).name in line for name in [*new, "frames"]
            ), line
        for name, content in contents().items():
            is_growing = Path(name).suffix in (".json", ".csv") and content.endswith(b"\n")
            assert content in (old.get(name), new.get(name)) or (is_growing and line), (
                number,
                name,
                line,
            )
        assert set(old) - set(contents()) == set(), (number, line)
        write(2)
        assert contents() == new, number
    assert number > 2
