"""What pycaffe says to and asks of the process: device, log, time, number of solvers."""

from __future__ import annotations

import logging
import sys
import time
from typing import Any

from netlib.distributed.ranks import latest
from netlib.system.once import once
from netlib.training import glog

_log = logging.getLogger("netlib")
_LEVELS = (logging.INFO, logging.WARNING, logging.ERROR, logging.CRITICAL)  # glog's 0 to 3
_ADVICE = "several solvers are processes of mpiexec here, each with get_solver(..., ranks=...): docs/distributed.md"


class Timer:
    """Measures wall-clock time between ``start`` and ``stop``."""

    def __init__(self) -> None:
        self._begin = self._seconds = 0.0

    def start(self) -> None:
        """Begin."""
        self._begin = time.perf_counter()

    def stop(self) -> None:
        """End."""
        self._seconds = time.perf_counter() - self._begin

    @property
    def ms(self) -> float:
        """Milliseconds from start to stop."""
        return self._seconds * 1000


def set_device(number: int) -> None:
    """Accepted; there are no devices here."""
    once(f"set_device({number}): accepted, but this runs on the CPU")


def init_log(level: int | None = None, stderr: bool = True) -> None:
    """Send the log of nets and solvers to the standard error, from glog's level 0 (information) to 3 (fatal) on.

    Lines are glog's, as Caffe's log parsers read them. Without it, only warnings are seen.
    """
    _log.setLevel(_LEVELS[min(max(level or 0, 0), len(_LEVELS) - 1)])
    if stderr and not _log.handlers:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(glog.CaffeFormatter())
        _log.addHandler(handler)


def log(text: str) -> None:
    """Lines in the log."""
    for line in text.split("\n"):
        _log.info("%s", line)


# Solvers that train together are processes (netlib/distributed/mpi.py), which mpiexec starts all at once.


def solver_count() -> int:
    """Number of solvers that train together."""
    return latest[0].count


def set_solver_count(count: int) -> None:
    """Accepted if it is so. Raises NotImplementedError."""
    if count != solver_count():
        raise NotImplementedError(f"set_solver_count({count}): {_ADVICE}")


def solver_rank() -> int:
    """Number of this solver among those that train together."""
    return latest[0].rank


def set_solver_rank(rank: int) -> None:
    """Accepted if it is so. Raises NotImplementedError."""
    if rank != solver_rank():
        raise NotImplementedError(f"set_solver_rank({rank}): {_ADVICE}")


def set_multiprocess(on: bool) -> None:
    """Accepted: every process has its own random numbers, seeded by ``set_random_seed``."""


def has_nccl() -> bool:
    """NCCL joins GPUs; there are none here."""
    return False


class NCCL:
    """NCCL joins GPUs. Raises NotImplementedError."""

    def __init__(self, solver: Any, uid: str) -> None:
        raise NotImplementedError(
            "NCCL joins GPUs, and this runs on the CPU; several processes train together over MPI: docs/distributed.md"
        )

    @staticmethod
    def new_uid() -> str:
        """Raises NotImplementedError."""
        raise NotImplementedError(
            "NCCL joins GPUs, and this runs on the CPU; several processes train together over MPI: docs/distributed.md"
        )
