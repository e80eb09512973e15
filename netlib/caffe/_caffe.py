"""caffe._caffe: the names of pycaffe's compiled module, from which scripts and Python
layers import.

A script may compare classes by identity, ``type(net.params["fc1"]) is caffe._caffe.BlobVec``, so
these names are the classes of the objects. Vectors of numbers, strings, layers and nets are Python
lists. The functions about the process (device, log, timer, number of solvers) are defined here.
"""

from __future__ import annotations

import logging
import os
import sys
import time
from typing import Any

from netlib.blob import Blob as Blob
from netlib.blob import Blobs as RawBlobVec  # noqa: F401
from netlib.blob import BlobVec as BlobVec
from netlib.caffe.pycaffe import (
    AdaDeltaSolver,
    AdaGradSolver,
    AdamSolver,
    NesterovSolver,
    Net,
    RMSPropSolver,
    SGDSolver,
    Solver,
    get_solver,
)
from netlib.caffe.pycaffe import SolverParameter as SolverParameter
from netlib.distributed import ranks
from netlib.errors import warn_once
from netlib.layer import Layer
from netlib.net import set_random_seed
from netlib.proto.messages import LayerParameter as LayerParameter
from netlib.proto.options import layer_type_list
from netlib.training import report

BoolVec = DtypeVec = IntVec = LayerVec = NetVec = StringVec = list
__version__ = "1.0.0"  # version of Caffe whose interface this is

__all__ = [  # the names that are also those of the package caffe
    "NCCL",
    "AdaDeltaSolver",
    "AdaGradSolver",
    "AdamSolver",
    "Layer",
    "NesterovSolver",
    "Net",
    "RMSPropSolver",
    "SGDSolver",
    "Solver",
    "Timer",
    "get_solver",
    "has_nccl",
    "init_log",
    "layer_type_list",
    "log",
    "set_device",
    "set_mode_cpu",
    "set_mode_gpu",
    "set_multiprocess",
    "set_random_seed",
    "set_solver_count",
    "set_solver_rank",
    "solver_count",
    "solver_rank",
]

_log = logging.getLogger("netlib")
_LEVELS = (logging.INFO, logging.WARNING, logging.ERROR, logging.CRITICAL)  # glog's levels 0 to 3
_ADVICE = (
    "run several solvers as processes of mpiexec, with ranks=MPIRanks(...): docs/distributed.md"
)


def _is_shown(record: logging.LogRecord) -> bool:
    """Whether GLOG_minloglevel, which scripts set before they import caffe, lets a
    record through.
    """
    level = os.environ.get("GLOG_minloglevel", "")  # noqa: SIM112  # glog's name
    return not level.isdecimal() or record.levelno >= _LEVELS[min(int(level), len(_LEVELS) - 1)]


_log.addFilter(_is_shown)


class Timer:
    """Measures wall-clock time between ``start`` and ``stop``."""

    def __init__(self) -> None:
        self._begin = self._seconds = 0.0

    def start(self) -> None:
        """Start measuring."""
        self._begin = time.perf_counter()

    def stop(self) -> None:
        """Stop measuring."""
        self._seconds = time.perf_counter() - self._begin

    @property
    def ms(self) -> float:
        """Milliseconds from start to stop."""
        return self._seconds * 1000


def set_mode_cpu() -> None:
    """Do nothing; exists for compatibility with pycaffe, as netlib always runs on the CPU."""


def set_mode_gpu() -> None:
    """Warn once that netlib runs on the CPU only; exists for compatibility with pycaffe."""
    warn_once("set_mode_gpu: accepted, but this runs on the CPU")


def set_device(number: int) -> None:
    """Warn once that there is only the CPU."""
    warn_once(f"set_device({number}): accepted, but this runs on the CPU")


def init_log(level: int | None = None, stderr: bool = True) -> None:
    """Log to standard error, from glog's level 0 (information) to 3 (fatal), in glog's format.

    Without it, only warnings are shown, from the level in the environment variable
    GLOG_minloglevel on.
    """
    _log.removeFilter(_is_shown)
    _log.setLevel(_LEVELS[min(max(level or 0, 0), len(_LEVELS) - 1)])
    if stderr and not _log.handlers:
        handler = logging.StreamHandler(sys.stderr)
        handler.setFormatter(report.CaffeFormatter())
        _log.addHandler(handler)


def log(text: str) -> None:
    """Log each line of a text."""
    for line in text.split("\n"):
        _log.info("%s", line)


# Solvers that train together are separate processes (netlib/distributed/mpi.py),
# started by mpiexec.


def solver_count() -> int:
    """Return the number of solvers that train together."""
    return ranks.latest.count


def set_solver_count(count: int) -> None:
    """Do nothing if the number is the current one. Raises NotImplementedError otherwise."""
    if count != solver_count():
        raise NotImplementedError(f"set_solver_count({count}): {_ADVICE}")


def solver_rank() -> int:
    """Return the rank of this solver among those that train together."""
    return ranks.latest.rank


def set_solver_rank(rank: int) -> None:
    """Do nothing if the rank is the current one. Raises NotImplementedError otherwise."""
    if rank != solver_rank():
        raise NotImplementedError(f"set_solver_rank({rank}): {_ADVICE}")


def set_multiprocess(on: bool) -> None:
    """Do nothing: every process has its own random numbers, seeded by ``set_random_seed``."""


def has_nccl() -> bool:
    """Return False: NCCL connects GPUs, which are not supported."""
    return False


class NCCL:
    """Not supported. Raises NotImplementedError."""

    def __init__(self, solver: Any, uid: str) -> None:
        self.new_uid()

    @staticmethod
    def new_uid() -> str:
        """Not supported. Raises NotImplementedError."""
        raise NotImplementedError(
            "NCCL needs GPUs, but netlib runs on the CPU; use MPI to train with several "
            "processes: docs/distributed.md"
        )
