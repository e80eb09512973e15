"""Full, read-only or failing disks, paths that are not regular files, files that change, clocks that run backwards.

Each name is a fault; its cases are the events at which it occurs, or the objects that it affects.
"""

from __future__ import annotations

import argparse
import contextlib
import ctypes
import errno
import gc
import itertools
import os
import resource
import signal
import socket
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import netlib  # before NumPy: it chooses the BLAS threads

# isort: split

import numpy as np

from netlib.errors import NetlibError
from netlib.training.callbacks import Functions
from tests.faults import readers, runs
from tests.faults.isolation import BrokenPromise, Outcome

# ---------------------------------------------------------------------------------------------- every write fails

FAULTS = {"full disk": errno.ENOSPC, "read-only disk": errno.EROFS, "one failing write": errno.EIO}
SIZES = (0, 1, 100, 1000, 4096, 8192, 20000, 65536, 100000)  # size limits of a file in bytes


def failing_disk(fault: str, run: str, number: int) -> Outcome:
    """A run that cannot create, sync or rename files from event ``number`` on; over if it has fewer events."""
    before = runs.undisturbed(run)
    struck = False

    def fail(event: int, what: str, path: str | None) -> None:
        nonlocal struck
        reached = event == number + 1 if fault == "one failing write" else event > number
        struck = struck or reached
        if reached and (what in runs.CREATING or (fault != "full disk" and what != "fcntl.flock")):
            raise OSError(FAULTS[fault], os.strerror(FAULTS[fault]), *([path] if path else []))

    def disturbed() -> str:
        runs.at_events(fail)
        before.run.run()
        return "struck" if struck else "over"

    with readers._copied(before.folder):
        status, answer = runs.forked(disturbed)
        if answer == "over":
            return Outcome("over")
        expect_refusal(status, answer, f"{fault} at file event {number + 1}")
        runs.finish(before, f"a {fault} at file event {number + 1}")
    return Outcome("held")


def expect_refusal(status: int, answer: Any, what: str) -> None:
    """Check that a run failed with a one-line error, or succeeded."""
    if status < 0:
        raise BrokenPromise("CRASH", f"{what}: ended by {signal.Signals(-status).name}")
    if isinstance(answer, list) and answer[0] != "refused":
        raise BrokenPromise(answer[0], f"{what}: {answer[1]}")
    if isinstance(answer, list) and not (answer[1].isprintable() and ":" in answer[1]):
        raise BrokenPromise("UNCLEAR", f"{what}: {answer[1]!r}")


def limited_size(run: str, number: int) -> Outcome:
    """A run with a limit on the size of files, like a quota; it also applies to files that HDF5 writes."""
    if number >= len(SIZES):
        return Outcome("over")
    before = runs.undisturbed(run)

    def limited() -> str:
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (SIZES[number], resource.RLIM_INFINITY))
        before.run.run()
        return "held"

    with readers._copied(before.folder):
        status, answer = runs.forked(limited)
        expect_refusal(status, answer, f"files of at most {SIZES[number]} bytes")
        runs.finish(before, f"files of at most {SIZES[number]} bytes")
    return Outcome("held")


# ---------------------------------------------------------------------------------------------- no files


def _fifo(path: Path) -> None:
    os.mkfifo(path)


THINGS: dict[str, Callable[[Path], None]] = {
    "nothing": lambda path: None,
    "an empty file": lambda path: path.touch(),
    "a directory": lambda path: path.mkdir(),
    "a FIFO": _fifo,
    "/dev/zero": lambda path: path.symlink_to("/dev/zero"),
    "a link to itself": lambda path: path.symlink_to(path.name),
    "a link to nothing": lambda path: path.symlink_to("nowhere"),
    "a file of 1 TB": lambda path: os.truncate(os.open(path, os.O_CREAT | os.O_WRONLY), 1 << 40),
}


def instead_of_a_file(thing: str, number: int) -> Outcome:
    """A reader whose file is replaced by something else; one case for each reader and file."""
    places = [(reader, i) for reader in readers.READERS if reader.modules for i in range(2)]
    if number >= len(places):
        return Outcome("over")
    reader, which = places[number]

    def read() -> str:
        here = Path(tempfile.mkdtemp(dir="."))
        with readers._inside(here):
            files = reader.make()
            path = Path(files[which % len(files)])
            path.unlink()
            THINGS[thing](path)
            try:
                reader.read(path)
            except NetlibError as error:
                outcome = readers.judged(error, path)
                if outcome.failed:
                    raise BrokenPromise(outcome.kind, f"{reader.name}: {thing} as {path}: {outcome.detail}") from None
        return "held"

    status, answer = runs.forked(read)
    runs.expect_good(status, answer, f"{reader.name}: {thing}")
    return Outcome("held")


# ---------------------------------------------------------------------------------------------- changes under way


def _cut(path: Path) -> None:
    os.truncate(path, 100)


def _zero(path: Path) -> None:
    with path.open("r+b") as file:
        file.write(b"\0" * path.stat().st_size)


def _replace(path: Path) -> None:
    Path("other").write_bytes(b"no HDF5 at all")
    os.replace("other", path)


CHANGES: dict[str, Callable[[Path], None]] = {
    "cut": _cut,
    "zeroed": _zero,
    "removed": Path.unlink,
    "replaced": _replace,
}


def changed_under_way(change: str, number: int) -> Outcome:
    """If a data file changes during a training run, the run stops with a one-line error or continues."""
    if number >= 6:
        return Outcome("over")
    before = runs.undisturbed("training hdf5")

    def disturbed() -> str:
        solver = netlib.get_solver("solver.prototxt", seed=3)
        if number:
            solver.step(number)
        CHANGES[change](Path("rows.h5"))
        solver.step(6 - number)
        return "held"

    with readers._copied(before.folder):
        status, answer = runs.forked(disturbed)
        expect_refusal(status, answer, f"rows.h5 {change} after {number} iterations")
    return Outcome("held")


# -------------------------------------------------------------------------------------- two at once, links, clocks


def two_trainings(number: int) -> Outcome:
    """Two runs with one prefix: the second is rejected, the first continues, and killing it frees the prefix."""
    if number >= 2:
        return Outcome("over")
    before = runs.undisturbed("training hdf5")

    def waiting() -> str:
        def wait() -> None:
            begun.set()
            go.wait()

        solver = netlib.get_solver("solver.prototxt", seed=3)
        solver.callbacks.append(Functions(on_start=lambda: wait() if solver.iter == 3 else None))
        solver.solve(runs.last_state())
        return "held"

    def meanwhile(child: int) -> None:
        begun.wait()
        status, answer = runs.forked(before.run.run)
        if number:
            os.kill(child, signal.SIGKILL)
        go.set()
        if not isinstance(answer, list) or answer[0] != "refused":
            second.append(f"the second training ended with {status}, {answer}")

    second: list[str] = []
    begun, go = runs.Event(), runs.Event()
    with readers._copied(before.folder):
        status, answer = runs.forked(waiting, meanwhile)
        if second:
            raise BrokenPromise("SILENT", second[0])
        if not number:
            runs.expect_good(status, answer, "the first of two trainings")
        runs.finish(before, "two trainings at once")
    return Outcome("held")


def planted_links(run: str, number: int) -> Outcome:
    """Links at all predictable names of temporary files refer to another file, which must not change."""
    if number >= 2:
        return Outcome("over")
    before = runs.undisturbed(run)

    def plant() -> str:
        victim = Path("victim").resolve()
        if number:  # a training run is rejected for it, so the other names would not be used
            Path(".s.netlib.lock").symlink_to(victim)
        guesses = [] if number else [*before.names, "s_iter_1000000000.solverstate", "s_iter_1000000000.solverstate.h5"]
        for name in guesses:
            for suffix in ("tmp", "old", "tmp.long.tmp"):
                with contextlib.suppress(FileExistsError, FileNotFoundError):
                    Path(name).with_name(f".{Path(name).name}.{os.getpid()}.{suffix}").symlink_to(victim)
        before.run.run()
        return "held"

    with readers._copied(before.folder):
        Path("victim").write_text("precious")
        status, answer = runs.forked(plant)
        expect_refusal(status, answer, "planted links")
        if Path("victim").read_bytes() != b"precious":
            raise BrokenPromise("LOST", "a file was written through a planted link")
    return Outcome("held")


def clock(number: int) -> Outcome:
    """A training with clocks that stop, run backwards or jump gives the same result."""
    steps = (0.0, -1.0, -1e6, 1e9)
    if number >= len(steps):
        return Outcome("over")
    before = runs.undisturbed("training hdf5")

    def disturbed() -> str:
        now = [1e9]

        def tick() -> float:
            now[0] += steps[number]
            return now[0]

        for name in ("time", "perf_counter", "monotonic"):
            setattr(time, name, tick)
        return readers.digest(before.run.run())

    with readers._copied(before.folder):
        status, answer = runs.forked(disturbed)
        runs.expect_good(status, answer, f"a clock that goes by {steps[number]} s")
        if answer != before.result:
            raise BrokenPromise("SILENT", f"another result with a clock that goes by {steps[number]} s")
    return Outcome("held")


Work = Callable[[], object]


def soak(begin: Callable[[], contextlib.AbstractContextManager[Work]], rounds: int, cases: int, number: int) -> Outcome:
    """Much work leaves memory, open files and threads unchanged; ``begin()`` yields a function for one round."""
    if number >= cases:
        return Outcome("over")
    rounds = rounds if number else 3

    def live() -> str:
        with begin() as work:
            for _ in range(2):
                work()
            before = _used()
            for _ in range(rounds):
                work()
            after = _used(before[2])
        if after[1] > before[1] or Counter(after[2]) - Counter(before[2]):  # fewer: some ended in between
            raise BrokenPromise("LEAK", f"files and threads were {before[1:]}, after {rounds} rounds {after[1:]}")
        if after[0] - before[0] > 2_000_000 + 20_000 * rounds:
            raise BrokenPromise("LEAK", f"{(after[0] - before[0]) / 1e6:.1f} MB after {rounds} rounds")
        return "held"

    with tempfile.TemporaryDirectory(dir=".") as folder, readers._inside(Path(folder)):
        status, answer = runs.forked(live)
        runs.expect_good(status, answer, begin.__name__)
    return Outcome("held")


@contextlib.contextmanager
def solvers() -> Iterator[Work]:
    """Nets and solvers that are built, trained, restored and released."""
    readers.make_solver()
    for name, text in (("vision.prototxt", readers.VISION), ("old.prototxt", readers.OLD_NET)):
        readers.put(name, text)
    yield _some_work


@contextlib.contextmanager
def tracking() -> Iterator[Work]:
    """A tracker that finds and loses a hand, 20 frames a round, with its outputs."""
    from handpose import load_predictor
    from handpose.frames.cameras import ICVL
    from handpose.frames.recording import DepthFrame
    from handpose.sequences.recordings import SyntheticRecording
    from handpose.tracking.tracker import Tracker
    from tools.common.track_outputs import Outputs, add_output_options

    parser = argparse.ArgumentParser()
    add_output_options(parser)
    seen = [frame.depth for frame in SyntheticRecording("rest", ICVL, rate=15, seconds=0.7)]
    tracker, numbers = Tracker(load_predictor(ICVL, fit="fast")), itertools.count()
    named = ["--json", "a.jsonl", "--csv", "a.csv", "--udp", "127.0.0.1:9"]
    with Outputs(parser.parse_args(named), tracker.header("soak"), 15.0) as outputs:

        def work() -> None:
            for depth in [*seen, *[np.zeros_like(seen[0])] * (20 - len(seen))]:
                number = next(numbers)
                frame = DepthFrame(number, number / 15, depth)
                outputs.write(depth, tracker.step(frame))

        yield work


@contextlib.contextmanager
def serving() -> Iterator[Work]:
    """A live page with clients that read, that do not, and that leave in the middle of a frame, 50 frames a round."""
    from websockets.sync.client import connect

    from handpose.output.live.messages import LINES
    from handpose.output.live.server import LiveServer

    with LiveServer("127.0.0.1", 0, "{}", "page") as server:

        def work() -> None:
            clients = [connect(server.lines_url, max_size=None) for _ in range(3)]
            for client in clients:
                client.recv()  # the header
            for _ in range(50):
                server.put(LINES, "x" * 100_000)
            clients[0].recv()
            for client in clients:
                client.socket.shutdown(socket.SHUT_RDWR)
                client.close()
            while server.has_clients(LINES):  # they are seen to have left when a frame cannot be sent
                server.put(LINES, "after")
                time.sleep(0.001)

        yield work


# The work, its rounds in a case, and the number of cases; the first has three rounds.
SOAKS = {"soak": (solvers, 60, 2), "soak of the tracker": (tracking, 25, 6), "soak of the live page": (serving, 60, 2)}


def _some_work() -> None:
    for _ in range(3):
        readers.read_solver(Path("solver.prototxt"))
        solver = netlib.get_solver("solver.prototxt")
        solver.step(2)
        solver.restore(solver.snapshot())
        readers.read_net(Path("vision.prototxt"))


def _used(remaining: Sequence[str] = ()) -> tuple[int, int, list[str]]:
    """Return the bytes of memory, the number of open files and the names of threads, when all but ``remaining`` have
    had time to end.
    """
    gc.collect()
    for thread in set(threading.enumerate()) - {threading.main_thread()}:
        thread.join(timeout=60 if remaining and thread.name not in remaining else 1)
    with contextlib.suppress(OSError, AttributeError):
        ctypes.CDLL(None).malloc_trim(0)
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return (
        pages * resource.getpagesize(),
        len(list(Path("/proc/self/fd").iterdir())),
        sorted(thread.name for thread in threading.enumerate()),
    )


# ---------------------------------------------------------------------------------------------- the table

_RUNS = tuple(run.name for run in runs.RUNS)
CASES: dict[str, Callable[[int, int], Outcome]] = {
    **{
        f"{fault}: {run}": (lambda seed, number, f=fault, r=run: failing_disk(f, r, number))
        for fault in FAULTS
        for run in _RUNS
    },
    **{f"limited size: {run}": (lambda seed, number, r=run: limited_size(r, number)) for run in _RUNS},
    **{f"{thing} for a file": (lambda seed, number, t=thing: instead_of_a_file(t, number)) for thing in THINGS},
    **{f"data {change}": (lambda seed, number, c=change: changed_under_way(c, number)) for change in CHANGES},
    **{f"planted links: {run}": (lambda seed, number, r=run: planted_links(r, number)) for run in _RUNS},
    "two trainings": lambda seed, number: two_trainings(number),
    "clock": lambda seed, number: clock(number),
    **{name: (lambda seed, number, s=some: soak(*s, number)) for name, some in SOAKS.items()},
}
NAMES = tuple(CASES)


def case(name: str, seed: int, number: int) -> Outcome:
    """Run one case of a fault; over if there are fewer cases."""
    return CASES[name](seed, number)
