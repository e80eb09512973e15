"""The processes that ``mpiexec`` started this command in, as the ranks of one training."""

from __future__ import annotations

import contextlib
import io
import os
import sys
from collections.abc import Iterator

from netlib import engine
from netlib.distributed.ranks import ALONE, Ranks
from netlib.errors import NetlibError

OPEN_MPI = ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK")
LAUNCHERS = (  # how they tell a process how many there are, and which it is
    OPEN_MPI,
    ("PMI_SIZE", "PMI_RANK"),  # MPICH, Intel MPI
    ("SLURM_STEP_NUM_TASKS", "SLURM_PROCID"),  # srun; also in a shell that it started, so only python -m mpi4py looks
)


def world(divide: bool = False, patience: float | None = None) -> Ranks:
    """The ranks of this training; alone if nobody started several. Raises NetlibError.

    divide    the prototxt's batch is that of all ranks together
    patience  s to wait for a rank; by default by the length of the steps
    """
    started, _ = _started()
    if started == 1 and "mpi4py" not in sys.modules:
        return ALONE
    try:
        import mpi4py

        mpi4py.rc.initialize, mpi4py.rc.finalize = False, True
        from mpi4py import MPI
    except ImportError as error:
        raise NetlibError(f"{started} processes were started to train together, which needs mpi4py: {error}; "
                          "pip install mpi4py mpich") from None  # fmt: skip
    library = " ".join(MPI.Get_library_version().split("\n")[0].split(",")[0].rstrip("\0").split())
    count = 1
    if not (library.startswith("MPICH") and OPEN_MPI[0] in os.environ):  # it would end here, without a word
        if not MPI.Is_initialized():
            MPI.Init_thread()
        count = MPI.COMM_WORLD.Get_size()
    if count != started > 1:
        raise NetlibError(f"{started} processes were started, but mpi4py, with {library}, sees {count}: they were "
                          "started for another MPI; use the mpiexec of the MPI that mpi4py was built with")  # fmt: skip
    if count == 1:
        return ALONE
    from netlib.distributed.mpi import MPIRanks

    return MPIRanks(MPI.COMM_WORLD, divide, patience)


@contextlib.contextmanager
def first_speaks() -> Iterator[None]:
    """Within it, of all processes that were started only the first writes, and ends with an error if it must."""
    if _started()[1] == 0:
        yield
        return
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            yield
        except (SystemExit, NetlibError):
            sys.exit(0)  # with another status the launcher might end the first before it has spoken


def threads_of(ranks: Ranks) -> int | None:
    """How many threads each rank has by default, where several share a machine; None: as ever."""
    return None if ranks.count == 1 else max(1, engine.available_cpus() // ranks.beside)


@contextlib.contextmanager
def ended_together(ranks: Ranks) -> Iterator[None]:
    """Within it, an error of one rank ends all of them; rank 0 alone raises it."""
    try:
        yield
    except (NetlibError, OSError, MemoryError) as error:
        agreed = ranks.fail(error)
        if ranks.rank == 0:
            if agreed is error or not isinstance(error, NetlibError):
                raise
            raise agreed from error


def _started() -> tuple[int, int]:
    """How many processes a launcher started, and which this is."""
    launchers = LAUNCHERS if "mpi4py" in sys.modules else LAUNCHERS[:-1]
    for count, number in launchers:
        if os.environ.get(count, "").isdecimal() and os.environ.get(number, "").isdecimal():
            return int(os.environ[count]), int(os.environ[number])
    return 1, 0
