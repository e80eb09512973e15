"""Programs for several ranks, which assert on every rank.

mpiexec -n N python -m mpi4py tests/support/rank_programs.py NAME
"""

import json
import os
import signal
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

import netlib  # noqa: I001  before NumPy
import numpy as np
from mpi4py import MPI

from netlib.distributed import mpi
from netlib.distributed.ranks import checksum as checksum_of
from netlib.errors import DataError, NetlibError
from netlib.distributed.mpi import MPIRanks


def caught(kind, function, *arguments):
    """Return the text of the error raised, which must be of exactly this kind."""
    try:
        function(*arguments)
    except NetlibError as error:
        assert type(error) is kind, error
        return str(error)
    raise AssertionError("no error")


def sums(ranks):
    """Sums are made in the order of the ranks, bit for bit, for any number of elements, and
    change nothing else.
    """
    for dtype in (np.float32, np.float64):
        for shapes in ([(1,)], [(5,), (3, 7), ()], [(1000,), (2, 2)]):
            all_ranks = [
                [
                    (10.0 ** rng.integers(-6, 7, s) * rng.standard_normal(s)).astype(dtype)
                    for s in shapes
                ]
                for rng in map(np.random.default_rng, range(ranks.count))
            ]
            arrays = [np.array(a) for a in all_ranks[ranks.rank]]
            ranks.average(arrays)
            for got, *of_ranks in zip(arrays, *all_ranks):
                total = of_ranks[0].copy()
                for other in of_ranks[1:]:
                    total = total + other
                assert got.dtype == dtype
                assert got.tobytes() == (total / dtype(ranks.count)).tobytes()
    ranks.average([])


def agreement(ranks):
    """Every rank receives the decisions of the others."""
    N, rank = ranks.count, ranks.rank
    ranks.introduce({"data": [1, 2], "net": "x"})
    assert ranks.agree(float(rank), "snapshot" if rank == 1 else None) == (N - 1) / 2
    assert ranks.asked(None) is None  # only rank 0 is asked for a snapshot
    ranks.agree(0.0, "snapshot" if rank == 0 else None)
    assert ranks.asked(None) == "snapshot"
    ranks.agree(0.0, "stop" if rank == N - 1 else "snapshot")
    assert ranks.asked(None) == "stop"
    done = []
    ranks.at_root(lambda: done.append(rank), lambda: "snapshot" if rank == 0 else "stop")
    assert done == [0] * (rank == 0) and ranks.asked(None) == "snapshot"
    everyone = ranks.everyone({"number": 2**62 + rank, "text": "ü" * rank})
    assert everyone == [{"number": 2**62 + r, "text": "ü" * r} for r in range(N)]


def errors(ranks):
    """An error of one rank is raised on all, with its type; afterwards all continue together."""
    mean = lambda: ranks.agree(1.0, None)  # noqa: E731

    def failing(error):
        with ranks.together():
            raise error

    of_one = failing, DataError("no rows")
    assert caught(DataError, *(of_one if ranks.rank == 2 else (mean,))) == "rank 2: no rows"
    for exchange in ((ranks.everyone, 1), (ranks.introduce, {})):
        assert caught(DataError, *(of_one if ranks.rank == 2 else exchange)) == "rank 2: no rows"
    assert caught(NetlibError, failing, NetlibError("no file")) == "no file"  # on all ranks
    lacking = isinstance(ranks.fail(MemoryError()) if ranks.rank == 1 else None, NetlibError)
    assert (
        lacking
        if ranks.rank == 1
        else caught(NetlibError, mean) == "rank 1: MemoryError: MemoryError"
    )
    said = caught(NetlibError, ranks.introduce, {"net": "a" if ranks.rank < 3 else "b"})
    assert said == 'rank 3 has another net than rank 0: "b", not "a"; expected the same on all'
    assert mean() == 1.0


def killed(ranks):
    """Rank 1 ends in a step; -m mpi4py and the launcher end the others."""
    solver = netlib.get_solver("solver.prototxt", ranks=ranks)
    solver.step(2)
    if ranks.rank == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    solver.step(1)


def failed(ranks):
    """Rank 1 raises an error of Python, of which the others do not hear; -m mpi4py ends them."""
    solver = netlib.get_solver("solver.prototxt", ranks=ranks)
    if ranks.rank == 1:
        solver.on_start.append(lambda: 1 / 0)
    solver.step(1)


def two_solvers(ranks):
    """Two solvers take turns on the same ranks; an error of one rank is raised on all, and both
    solvers continue.
    """
    files = "exact.prototxt", "small_solver.prototxt"
    one, other = (netlib.get_solver(file, ranks=ranks) for file in files)
    one.step(1)
    other.step(1)
    run = one.net.run_forward

    def failing():
        run()
        raise DataError("no rows")

    if ranks.rank == 1:
        one.net.run_forward = failing
    assert caught(DataError, one.step, 1) == "rank 1: no rows"
    one.net.run_forward = run
    for solver in (one, other):
        solver.step(2)
        ranks.introduce({"parameters": checksum_of(solver.net.learnable)})
    assert (one.iter, other.iter) == (3, 3)


def losses(ranks):
    """Train every solver file losses*.prototxt for 8 iterations; write its losses to a .json file
    of the same name.
    """
    for path in sorted(Path().glob("losses*.prototxt")):
        got = train(netlib.get_solver(path, ranks=ranks), 8)
        if ranks.rank == 0:
            path.with_suffix(".json").write_text(json.dumps(got))


def train(solver, iterations):
    """Return the loss of each iteration."""
    got = []
    for _ in range(iterations):
        solver.step(1)
        got.append(solver.smoothed[-1])
    return got


def resume(ranks):
    """Repeated and resumed runs are equal, bit for bit; all ranks have the same bits."""
    bits = []
    for begin in (None, None, "snapshots/exact_iter_3.solverstate"):
        solver = netlib.get_solver("exact.prototxt", ranks=ranks)
        solver.solve(begin)
        assert solver.iter == 6
        arrays = [p.blob.data for p in solver.net.learnable] + [
            h for hs in solver.history for h in hs
        ]
        bits.append((b"".join(a.tobytes() for a in arrays), list(solver.smoothed)))
        ranks.introduce({"parameters": checksum_of(solver.net.learnable)})
    assert bits[0] == bits[1], "not the same again"
    assert bits[0] == bits[2], "a resume is not exact"


def checksum(ranks):
    """A weight that changes on one rank only is detected."""
    mpi.COMPARED_EVERY = 4
    solver = netlib.get_solver("exact.prototxt", ranks=ranks)

    def change():
        if solver.iter == 5 and ranks.rank == 1:
            weights = solver.net.learnable[0].blob.data.view(np.uint32).reshape(-1)
            weights[3] ^= 1  # the last bit

    solver.on_start.append(change)
    said = caught(NetlibError, solver.step, 12)
    assert solver.iter == 8
    assert said.startswith("the parameters of rank 1 differ from those of rank 0")


if __name__ == "__main__":
    ranks = MPIRanks(MPI.COMM_WORLD)
    for name in sys.argv[1:]:
        globals()[name](ranks)
        sys.stdout.write(f"rank {ranks.rank} {name}\n")  # in a single write
