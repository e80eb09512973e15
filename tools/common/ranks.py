"""The processes of one training run, its ranks, started by ``mpiexec`` or by ``--ranks``."""

from __future__ import annotations

import contextlib
import io
import os
import shutil
import sys
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import NoReturn

from netlib import engine
from netlib.distributed.ranks import ALONE, Ranks
from netlib.errors import NetlibError
from tools.common.commands import is_subcommand

OPEN_MPI = ("OMPI_COMM_WORLD_SIZE", "OMPI_COMM_WORLD_RANK")
LAUNCHERS = (  # environment variables with the number of processes and the number of this one
    OPEN_MPI,
    ("PMI_SIZE", "PMI_RANK"),  # MPICH, Intel MPI
    # srun; also set in shells under it, so used only with -m mpi4py
    ("SLURM_STEP_NUM_TASKS", "SLURM_PROCID"),
)


def launcher() -> str | None:
    """The path of mpiexec: that of the package mpich for this Python, or one in PATH."""
    folders = [str(Path(sys.executable).parent), os.environ.get("PATH", "")]
    return shutil.which("mpiexec", path=os.pathsep.join(folders))


def start(count: int) -> NoReturn:
    """Replace this process by ``mpiexec``, which starts the command as ``count`` processes.

    Raises NetlibError.
    """
    mpiexec = launcher()
    if mpiexec is None or find_spec("mpi4py") is None:
        raise NetlibError(
            f"{count} processes that train together need mpi4py and mpiexec, and one is missing; "
            "pip install mpi4py mpich"
        )
    program = ["-m", *sys.argv[0].split()] if is_subcommand() else sys.argv[:1]
    words = [mpiexec, "-n", str(count), sys.executable, "-m", "mpi4py", *program, *sys.argv[1:]]
    sys.stdout.flush()
    os.execv(mpiexec, words)


def is_started() -> bool:
    """Whether a launcher has started this process and others."""
    return _started()[0] > 1


def world(divide: bool = False) -> Ranks:
    """Return the ranks of this training; ``ALONE`` for a single process. Raises NetlibError.

    ``divide`` splits the prototxt's batch among the ranks instead of using it on each.
    """
    started, _ = _started()
    if started == 1 and "mpi4py" not in sys.modules:
        return ALONE
    try:
        import mpi4py

        mpi4py.rc.initialize, mpi4py.rc.finalize = False, True
        from mpi4py import MPI
    except ImportError as error:
        raise NetlibError(
            f"{started} processes were started to train together, which needs mpi4py: {error}; "
            "pip install mpi4py mpich"
        ) from None
    library = " ".join(MPI.Get_library_version().split("\n")[0].split(",")[0].rstrip("\0").split())
    count = 1
    # MPICH would exit here without a message
    if not (library.startswith("MPICH") and OPEN_MPI[0] in os.environ):
        if not MPI.Is_initialized():
            MPI.Init_thread()
        count = MPI.COMM_WORLD.Get_size()
    if count != started > 1:
        raise NetlibError(
            f"{started} processes were started, but mpi4py, with {library}, sees {count}: they were "
            "started by another MPI; use the mpiexec of the MPI that mpi4py was built with"
        )
    if count == 1:
        return ALONE
    from netlib.distributed.mpi import MPIRanks

    return MPIRanks(MPI.COMM_WORLD, divide)


@contextlib.contextmanager
def only_first_prints() -> Iterator[None]:
    """Context manager: only the first of the started processes prints and exits with
    an error status.
    """
    if _started()[1] == 0:
        yield
        return
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        try:
            yield
        except (SystemExit, NetlibError):
            # another status could make the launcher kill the first process before it prints
            sys.exit(0)


def threads_of(ranks: Ranks) -> int | None:
    """Default number of threads per rank if several ranks share a machine; None if
    there is one rank.
    """
    return None if ranks.count == 1 else max(1, engine.available_cpus() // ranks.on_machine)


@contextlib.contextmanager
def ended_together(ranks: Ranks) -> Iterator[None]:
    """Context manager: an error of one rank ends all of them; only rank 0 raises it."""
    try:
        yield
    except (NetlibError, OSError, MemoryError) as error:
        agreed = ranks.fail(error)
        if ranks.rank == 0:
            if agreed is error or not isinstance(error, NetlibError):
                raise
            raise agreed from error


def _started() -> tuple[int, int]:
    """Number of processes that a launcher started, and the number of this one."""
    launchers = LAUNCHERS if "mpi4py" in sys.modules else LAUNCHERS[:-1]
    for count, number in launchers:
        if os.environ.get(count, "").isdecimal() and os.environ.get(number, "").isdecimal():
            return int(os.environ[count]), int(os.environ[number])
    return 1, 0
