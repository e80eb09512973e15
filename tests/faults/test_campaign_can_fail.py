"""The campaign detects failures: readers and runs that are wrong on purpose."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import sys
import tempfile
import time
import warnings
from pathlib import Path

import pytest

from netlib.errors import NetlibError
from netlib.files import atomic
from tests.faults import campaign, commands, kills, mutations, readers, runs
from tests.faults.isolation import BrokenPromise, Outcome, Worker, failing_calls_library
from tests.faults.readers import Reader

HERE = "tests.faults.test_campaign_can_fail"


def case(name: str, seed: int, number: int) -> Outcome:
    """Cases for the worker, each with a different failure."""
    if name == "traceback":
        return Outcome("read", {}["nothing"])
    if name == "crash":
        os.kill(os.getpid(), signal.SIGSEGV)
    if name == "exit":
        os._exit(3)
    if name == "hang":
        while True:
            signal.pause()
    if name == "memory":
        bytearray(8 << 30)
    if name.startswith("command "):
        commands.COMMANDS = (commands.Command(name.removeprefix("command "), files=("out",)),)
        commands.NAMES = (name,)
        commands._main = lambda tool: WRONG_COMMANDS[tool]
        commands.undisturbed.cache_clear()
        with tempfile.TemporaryDirectory() as folder, readers._inside(Path(folder)):
            return commands.case(name, seed, number)
    if name == "careless":
        runs.RUNS = (CARELESS,)
        return kills.case(name, seed, number)
    return Outcome("held", f"{seed} {number}")


def test_what_goes_wrong_is_one_failure_and_ends_nothing() -> None:
    """The worker continues after an exception, a signal, an exit, an endless loop and exhausted memory."""
    with Worker() as worker:
        found = {}
        for name in ("traceback", "crash", "exit", "memory"):
            found[name] = worker.run(HERE, name, 0, 0)
            assert worker.run(HERE, "good", 4, 5) == Outcome("held", "4 5")
        worker.limit_s = 0.5
        found["hang"] = worker.run(HERE, "hang", 0, 0)
    assert {name: outcome.kind for name, outcome in found.items()} == {
        "traceback": "TRACEBACK", "crash": "CRASH", "exit": "CRASH", "memory": "TRACEBACK", "hang": "HANG",
    }
    assert all(outcome.failed for outcome in found.values())
    assert found["traceback"].detail.startswith("KeyError at tests/faults/test_campaign_can_fail.py:")
    assert found["crash"].detail.startswith("the process ended by SIGSEGV")
    assert found["exit"].detail.startswith("the process ended with status 3")
    assert found["memory"].detail.startswith("MemoryError")


def test_a_worker_that_dies_between_two_cases_is_a_crash_of_the_next_one() -> None:
    """A worker may wait for the next case as long as it takes; one that has died meanwhile is replaced."""
    with Worker() as worker:
        assert worker.run(HERE, "good", 0, 0).kind == "held"
        assert worker._child is not None
        os.kill(worker._child.pid, signal.SIGKILL)
        worker._child.wait()
        found = worker.run(HERE, "good", 0, 0)
        assert (found.kind, found.detail) == ("CRASH", "the process ended by SIGKILL")
        assert worker.run(HERE, "good", 4, 5) == Outcome("held", "4 5")


# ---------------------------------------------------------------------------------------------- commands


def in_place(argv: list[str]) -> int:
    """Write in place, which follows links, and loses an old file if the disk fails."""
    try:
        Path("out").write_bytes(b"new\n" * 9000)
    except OSError as error:
        print(f"{error.filename or 'out'}: {error.strerror}", file=sys.stderr)
        return 1
    return 0


def without_a_name(argv: list[str]) -> int:
    """Write atomically, but do not name the file in an error."""
    try:
        atomic.replace_bytes(Path("out"), b"new\n")
    except OSError as error:
        print(f"error {error.errno}", file=sys.stderr)
        return 1
    return 0


def careless_of_errors(argv: list[str]) -> int:
    """Report success whatever happens."""
    with contextlib.suppress(OSError):
        atomic.replace_bytes(Path("out"), b"new\n")
    return 0


def by_the_clock(argv: list[str]) -> int:
    """Divide by the time that has passed."""
    begun = time.time()
    atomic.replace_bytes(Path("out"), b"new\n")
    return int(0 / (time.time() - begun))


WRONG_COMMANDS = {
    "in_place": in_place,
    "without_a_name": without_a_name,
    "careless_of_errors": careless_of_errors,
    "by_the_clock": by_the_clock,
}


@pytest.mark.skipif(failing_calls_library() is None, reason="needs a C compiler")
@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("in_place", {"LOST"}),
        ("without_a_name", {"UNCLEAR"}),
        ("careless_of_errors", {"SILENT"}),
        ("by_the_clock", {"TRACEBACK"}),
    ],
)
def test_wrong_commands(name: str, kinds: set[str]) -> None:
    """Each kind of failure of a command has its own outcome."""
    with Worker() as worker:
        found = {worker.run(HERE, f"command {name}", 0, number).kind for number in range(16)}
    assert kinds <= found, found


# ---------------------------------------------------------------------------------------------- readers


def refuse(message: str) -> None:
    raise NetlibError(message)


class RawError(NetlibError):
    """An error whose text would clear the screen."""

    def __str__(self) -> str:
        return "a.bin: \x1b[2J"


def refuse_raw(path: Path) -> None:
    if path.read_bytes() != b"good" * 9:
        raise RawError


def warn(path: Path) -> None:
    warnings.warn("chatter", RuntimeWarning, stacklevel=1)


WRONG = {
    "a good one": (lambda path: refuse(f"{path}: not a thing") if path.read_bytes() != b"good" * 9 else 1, "refused"),
    "reads anything": (lambda path: path.read_bytes(), "SILENT"),
    "no name": (lambda path: refuse("not a thing") if path.read_bytes() != b"good" * 9 else 1, "UNCLEAR"),
    "commands": (refuse_raw, "UNCLEAR"),
    "chatters": (warn, "WARNING"),
}


@pytest.mark.parametrize("name", WRONG)
def test_wrong_readers(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str) -> None:
    """Each kind of failure of a reader has its own outcome."""
    read, kind = WRONG[name]

    def make() -> list[str]:
        Path("a.bin").write_bytes(b"good" * 9)
        return ["a.bin"]

    monkeypatch.setattr(readers, "READERS", (Reader(name, (), make, read, exact=True),))
    monkeypatch.chdir(tmp_path)
    readers._prepared.cache_clear()
    found = {readers.case(name, 0, number).kind for number in range(10)}
    assert found - {"read"} == {kind}, "damage may leave the bytes as they were"


def test_damage_is_the_same_for_the_same_seed() -> None:
    """Equal seeds and numbers give equal damage, so a case can be repeated; other numbers give other damage."""
    content = b'layer { name: "a" top: "x" dim: 3 }\n' * 20

    def some(seed: str) -> bytes:
        return mutations.damaged(content, b"other", random.Random(seed), is_text=True)[0]

    assert some("net 0 1") == some("net 0 1")
    assert len({some(f"net 0 {number}") for number in range(50)}) > 40


@pytest.mark.parametrize("kind", sorted({*mutations.ANY, *mutations.TEXT}, key=lambda kind: kind.__name__))
def test_every_kind_of_damage_takes_any_bytes(kind: mutations.Damage) -> None:
    """Every kind of damage accepts one byte, bytes that are not text, and text without the pattern it changes."""
    for content in (b"\0", b"\xff\xfe", b"word", b"a: 1\n", bytes(range(256)) * 20):
        for number in range(20):
            assert isinstance(kind(content, b"\0", random.Random(number)), bytes)


# ---------------------------------------------------------------------------------------------- runs


def careless() -> str:
    """Write ``file`` between creating and removing ``temporary``; a killed run leaves ``temporary``."""
    if not Path("file").exists():
        Path("temporary").touch()
        Path("file").write_text("new")
        Path("temporary").unlink()
    return "new"


def check_careless(result: str) -> None:
    """Raise BrokenPromise if ``temporary`` exists without ``file``."""
    if Path("temporary").exists() and not Path("file").exists():
        raise BrokenPromise("LOST", "one without the other")


CARELESS = runs.Run("careless", lambda: None, careless, check_careless)


def test_a_careless_run_is_seen() -> None:
    """The careless run has three file events, and a kill before each has its own outcome."""
    with Worker() as worker:
        told = [worker.run(HERE, "careless", 0, number).kind for number in range(4)]
    assert told == ["held", "LOST", "LEFT", "over"]


def test_the_table() -> None:
    """The table has one row for each promise with cases, and their sum."""
    groups = [campaign.Group(campaign.PROMISES[0], name) for name in ("net", "solver")]
    groups[0].counts.update(refused=1200, TRACEBACK=1)
    groups[0].failures.append((7, Outcome("TRACEBACK", "KeyError")))
    groups[1].counts.update(read=10, over=1)
    head, _, row, total = campaign.table(groups).splitlines()
    assert head == "| guarantee | how it is tested | cases | failures |"
    assert row.startswith("| a damaged file gives a one-line error") and row.endswith("| 1,211 | 1 |")
    assert total == "| | all | 1,211 | 1 |"


def test_every_group_stands_in_one_row() -> None:
    """Every group is in exactly one row, so no case is missing or counted twice."""
    names = [(group.promise.module, group.name) for group in campaign.groups()]
    assert len(set(names)) == len(names)
    assert {name for module, name in names if module.endswith("readers")} == {r.name for r in readers.READERS}
    for module in ("kills", "signals", "disks", "commands"):
        known = __import__(f"tests.faults.{module}", fromlist=["NAMES"]).NAMES
        assert {name for of, name in names if of.endswith(module)} == set(known)
