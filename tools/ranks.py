"""The processes that ``mpiexec`` started this command in, as the ranks of one training."""

from __future__ import annotations

import os
import sys

from netlib import engine
from netlib.errors import NetlibError
from netlib.ranks import ALONE, Ranks

STARTED = ("OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "MPI_LOCALNRANKS")  # how launchers say how many processes there are


def world(divide: bool = False, patience: float | None = None) -> Ranks:
    """The ranks of this training; alone if nobody started several. Raises NetlibError.

    divide    the prototxt's batch is that of all ranks together
    patience  s to wait for a rank; by default by the length of the steps
    """
    started = next((int(os.environ[name]) for name in STARTED if os.environ.get(name, "").isdecimal()), 1)
    if started == 1 and "mpi4py" not in sys.modules:
        return ALONE
    try:
        from mpi4py import MPI
    except ImportError as error:
        raise NetlibError(f"{started} processes were started to train together, which needs mpi4py: {error}; "
                          "python -m pip install 'deepmodel-numpy[mpi]'") from None  # fmt: skip
    count = MPI.COMM_WORLD.Get_size()
    if count == 1 and started == 1:
        return ALONE
    if count != started > 1:
        library = MPI.Get_library_version().split("\n")[0].split(",")[0].rstrip("\0")
        raise NetlibError(f"mpiexec started {started} processes, but mpi4py, with {library}, sees {count}: mpiexec is "
                          "another MPI's; use the one that mpi4py was built with")  # fmt: skip
    from netlib.mpi import MPIRanks

    return MPIRanks(MPI.COMM_WORLD, divide, patience)


def threads_of(ranks: Ranks) -> int | None:
    """How many threads each rank has by default, where several share a machine; None: as ever."""
    return None if ranks.count == 1 else max(1, engine.available_cpus() // ranks.beside)
