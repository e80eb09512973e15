"""The long campaign: tens of thousands of cases on all processors, and a table of what they found.

    python -m tests.faults.campaign                             all of it, 1,500 cases for each reader: half an hour
    python -m tests.faults.campaign --only "resume" --seed 7    what has this in its name, with other dice
    python -m tests.faults.campaign --only "weights hdf5" --seed 7 --case 123      one case again
    python -m tests.faults.campaign --write                     put the table into docs/reliability.md

Exit status 1 if a promise was broken. The short run, with fixed seeds, is part of the tests.
"""

from __future__ import annotations

import argparse
import importlib
import os
import signal
import sys
import time
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field

from tests.faults.isolation import ROOT, Outcome, Worker

CASES = 1500
PAGE = ROOT / "docs" / "reliability.md"
BEGIN, END = "<!-- the campaign's table begins -->", "<!-- the campaign's table ends -->"


@dataclass(frozen=True)
class Promise:
    """A row of the table.

    promise, how  text of the row in docs/reliability.md
    module        module with the cases that test it, in the groups whose names start with one of ``begin``
    dice          for random cases, their number relative to --cases; None if the cases are enumerated
    """

    promise: str
    how: str
    module: str
    begin: tuple[str, ...] = ("",)
    dice: float | None = None

    def names(self) -> list[str]:
        """Names of its groups of cases."""
        module = importlib.import_module(self.module)
        names = [r.name for r in module.READERS] if self.module.endswith("readers") else list(module.NAMES)
        others = [b for p in PROMISES if p.module == self.module and p is not self for b in p.begin if b]
        taken = [n for n in names if not self.begin[0] and any(n.startswith(b) for b in others)]
        return [n for n in names if n.startswith(self.begin) and n not in taken]


_F = "tests.faults."
PROMISES = (
    Promise("a damaged file gives a one-line error or is still readable: no traceback, no crash, no hang",
            "every reader on files with flipped bits, truncated, spliced, with extreme numbers and unusual names",
            _F + "readers", dice=1),
    Promise("content with a checksum is correct or rejected; the solver is unchanged after a rejection",
            "solver states and their weights, packaged models, depth images, damaged in the same way", _F + "readers",
            ("resume", "packaged", "depth picture"), 1),
    Promise("other objects (a FIFO, a folder, /dev/zero, a link to itself, 1 TB) give a one-line error",
            "in place of every file of every reader", _F + "disks", ("nothing for", "an empty", "a directory", "a FIFO",
            "/dev/zero", "a link", "a file of")),
    Promise("after a kill nothing is lost; the next run ends bit for bit the same and removes temporary files",
            "SIGKILL before every file operation of every run that writes", _F + "kills"),
    Promise("a signal stops a training run with a snapshot, from which it continues bit for bit",
            "SIGINT, SIGTERM, SIGHUP during every forward pass, also of tests, and every file operation of a snapshot",
            _F + "signals", ("SIGINT at a f", "SIGTERM at a f", "SIGHUP at a f")),
    Promise("... at any time", "the same at random moments", _F + "signals",
            ("SIGINT at a r", "SIGTERM at a r", "SIGHUP at a r"), 0.1),
    Promise("a full, read-only or failing disk gives a one-line error; old files are whole; the next run ends the same",
            "from every file operation on; files limited to nine sizes", _F + "disks",
            ("full", "read-only", "one failing", "limited")),
    Promise("data truncated, zeroed, removed or replaced during a training run: a one-line error, or the run continues",
            "after every iteration", _F + "disks", ("data ",)),
    Promise("two training runs with one prefix: the second is rejected; killing the first releases the prefix", "both",
            _F + "disks", ("two",)),
    Promise("no temporary file is written through a symbolic link", "links at all predictable names",
            _F + "disks", ("planted",)),
    Promise("every command that writes ends with one line or a right result; old and other files are whole; the next "
            "run is as without a fault", "a call that fails, is cut or interrupted, also in FFmpeg and HDF5; links, "
            "folders, pipes in place of outputs; limits on file size, descriptors, memory; odd clocks", _F + "commands",
            dice=0.04),
    Promise("clocks have no effect", "stopped, running backwards, jumping", _F + "disks", ("clock",)),
    Promise("no leaks", "hundreds of nets and solvers built, trained, restored, released; thousands of frames tracked, "
            "written and sent to clients that read, stall and leave", _F + "disks", ("soak",)),
)


@dataclass
class Group:
    """The cases with one name, and their outcomes."""

    promise: Promise
    name: str
    counts: Counter[str] = field(default_factory=Counter)
    failures: list[tuple[int, Outcome]] = field(default_factory=list)

    def numbers(self, cases: int) -> Iterator[int]:
        """Yield the numbers of the cases: a given number of random ones, or until the outcome of a case is "over"."""
        number = 0
        while not self.counts["over"] and (self.promise.dice is None or number < self.promise.dice * cases):
            yield number
            number += 1

    def run(self, seed: int, cases: int, only: int | None = None) -> Group:
        """Run all cases in a separate process."""
        with Worker() as worker:
            for number in self.numbers(cases) if only is None else (only,):
                outcome = worker.run(self.promise.module, self.name, seed, number)
                self.counts[outcome.kind] += 1
                if outcome.failed:
                    self.failures.append((number, outcome))
                if outcome.kind == "BROKEN" or self.counts["HANG"] > 20:
                    break
        return self

    @property
    def cases(self) -> int:
        """Number of cases that were run."""
        return self.counts.total() - self.counts["over"]


def groups(only: str = "") -> list[Group]:
    """All groups, or those with ``only`` in their names; the longest first."""
    return [Group(promise, name) for promise in PROMISES for name in promise.names() if only in name]


def table(done: list[Group]) -> str:
    """Markdown table of the promises and the results."""
    lines = ["| guarantee | how it is tested | cases | failures |", "|---|---|---:|---:|"]
    for promise in PROMISES:
        own = [group for group in done if group.promise is promise]
        if own:
            cases, failures = sum(g.cases for g in own), sum(len(g.failures) for g in own)
            lines.append(f"| {promise.promise} | {promise.how} | {cases:,} | {failures:,} |")
    cases, failures = sum(g.cases for g in done), sum(len(g.failures) for g in done)
    return "\n".join([*lines, f"| | all | {cases:,} | {failures:,} |"]) + "\n"


def main(argv: list[str] | None = None) -> int:
    """Run the campaign; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=CASES, metavar="N", help="for each reader (default: %(default)s)")
    parser.add_argument(
        "--seed", type=int, default=int(time.time()), metavar="S", help="of the dice (default: the time)"
    )
    parser.add_argument("--only", default="", metavar="NAME", help="groups with this in their names")
    parser.add_argument("--case", type=int, metavar="NUMBER", help="this case alone")
    parser.add_argument("--write", action="store_true", help=f"put the table into {PAGE.relative_to(ROOT)}")
    parser.add_argument("--verbose", action="store_true", help="show every failure, not only different ones")
    args = parser.parse_args(argv)
    signal.signal(signal.SIGINT, signal.default_int_handler)  # background jobs ignore it
    begun, todo, done = time.monotonic(), groups(args.only), list[Group]()
    print(f"seed {args.seed}, {len(todo)} groups of cases", file=sys.stderr)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for group in pool.map(lambda group: group.run(args.seed, args.cases, args.case), todo):
            done.append(group)
            told = ", ".join(f"{count} {kind}" for kind, count in sorted(group.counts.items()) if kind != "over")
            print(f"{time.monotonic() - begun:6.0f} s  {len(done)}/{len(todo)}  {group.name}: {told}", file=sys.stderr)
            for number, outcome in group.failures if args.verbose else distinct(group.failures):
                print(f"          case {number}: {outcome.kind} {outcome.detail}", file=sys.stderr)
    text = table(done)
    print(text, end="")
    if args.write:
        page = PAGE.read_text(encoding="utf-8")
        head, tail = page.split(BEGIN)[0], page.split(END)[1]
        PAGE.write_text(f"{head}{BEGIN}\n{text}{END}{tail}", encoding="utf-8")
    return 1 if any(group.failures for group in done) else 0


def failures(worker: Worker, module: str, name: str, numbers: Iterable[int], seed: int = 0) -> list[str]:
    """Run some cases of a group, as the tests do; returns one line per failure."""
    told = []
    for number in numbers:
        outcome = worker.run(_F + module, name, seed, number)
        if outcome.kind == "over":
            break
        if outcome.failed:
            told.append(f"--only {name!r} --seed {seed} --case {number}: {outcome.kind} {outcome.detail}")
        if outcome.kind == "BROKEN":  # all others would be too
            break
    return told


def distinct(failures: list[tuple[int, Outcome]]) -> list[tuple[int, Outcome]]:
    """The first failure of each kind and place."""
    seen: dict[tuple[str, str], tuple[int, Outcome]] = {}
    for number, outcome in failures:
        seen.setdefault((outcome.kind, outcome.detail[:40] if outcome.kind != "LEFT" else ""), (number, outcome))
    return list(seen.values())


if __name__ == "__main__":
    sys.exit(main())
