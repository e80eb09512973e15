"""A Caffe-style layer graph on NumPy: prototxt in, layers, a solver, snapshots.

The interface is pycaffe's.

net = netlib.Net("prototxt/nyu_deploy.prototxt", "weights.caffemodel.h5", netlib.TEST)
joints = net.forward(depth=crop)["pred"]

solver = netlib.get_solver("prototxt/nyu_solver.prototxt")
solver.step(10)
"""

import os
from typing import TYPE_CHECKING

from netlib.files.paths import ROOT, load_module

# A line for the log. BLAS is configured before NumPy is imported; it affects the rounding
# of both engines.
BLAS_NOTE: str = (
    load_module("netlib.blas", ROOT / "fast" / "blas.py").configure()
    if (ROOT / "fast").is_dir()
    else "BLAS: as NumPy sets it up"
)
# OpenCV reads this once, when it is imported
os.environ.setdefault("OPENCV_IO_MAX_IMAGE_PIXELS", str(1 << 28))

from netlib import engine  # noqa: E402
from netlib.blob import Blob, Blobs  # noqa: E402
from netlib.errors import (  # noqa: E402
    DataError,
    DivergenceError,
    LayerError,
    NetlibError,
    PrototxtError,
    WeightsError,
    warn_once,
)
from netlib.files import own_modules  # noqa: E402
from netlib.layer import TEST, TRAIN, Layer  # noqa: E402
from netlib.net import Net, set_random_seed  # noqa: E402
from netlib.proto.options import layer_types  # noqa: E402

if TYPE_CHECKING:
    from netlib import gradcheck as gradcheck
    from netlib.solver import Solver as Solver
    from netlib.solver import get_solver as get_solver

__all__ = [
    "BLAS_NOTE",
    "TEST",
    "TRAIN",
    "Blob",
    "Blobs",
    "DataError",
    "DivergenceError",
    "Layer",
    "LayerError",
    "Net",
    "NetlibError",
    "PrototxtError",
    "Solver",
    "WeightsError",
    "get_solver",
    "gradcheck",
    "install_as_caffe",
    "layer_type_list",
    "set_mode_cpu",
    "set_mode_gpu",
    "set_random_seed",
    "set_threads",
    "threads",
]


def __getattr__(name: str) -> object:
    """Import what only trainings and tests need when it is first used.

    Raises AttributeError for unknown names.
    """
    if name == "gradcheck":
        import netlib.gradcheck as checks

        return checks
    if name in ("Solver", "get_solver"):
        import netlib.solver as solvers

        return getattr(solvers, name)
    raise AttributeError(f"module 'netlib' has no attribute {name!r}")


def layer_type_list() -> list[str]:
    """The names of all layer types."""
    return sorted([*layer_types(), "Python"])


def install_as_caffe() -> None:
    """Make ``import caffe`` return netlib.caffe in this process, even if Caffe is installed.

    From then on, a script's own modules named ``layers`` or ``fast`` are found before those
    of this project.
    """
    own_modules.take_caffe()
    layer_types()
    engine.get()
    own_modules.yield_names()


def threads() -> int:
    """Number of threads in use: ``set_threads``, else NETLIB_NUM_THREADS, else one
    per processor.
    """
    return engine.get().threads()


def set_threads(count: int) -> None:
    """Set the number of threads.

    It may change the rounding of what does not run in slices, as of a single image.
    """
    engine.get().set_threads(count)


def set_mode_cpu() -> None:
    """Do nothing; exists for compatibility with pycaffe, as netlib always runs on the CPU."""


def set_mode_gpu() -> None:
    """Warn once that netlib runs on the CPU only; exists for compatibility with pycaffe."""
    warn_once("set_mode_gpu: accepted, but this runs on the CPU")
