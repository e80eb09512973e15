"""A Caffe-style layer graph on NumPy: prototxt in, layers, a solver, snapshots.

The interface is pycaffe's.

net = netlib.Net("prototxt/nyu_deploy.prototxt", "weights.caffemodel.h5", netlib.TEST)
joints = net.forward(depth=crop)["pred"]

solver = netlib.get_solver("prototxt/nyu_solver.prototxt")
solver.step(10)
"""

import os
from importlib import import_module
from importlib.util import find_spec
from typing import TYPE_CHECKING

from netlib.errors import (
    DataError,
    DivergenceError,
    LayerError,
    NetlibError,
    PrototxtError,
    WeightsError,
)
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

if TYPE_CHECKING:
    from netlib import gradcheck
    from netlib.blob import Blob, Blobs
    from netlib.caffe import install_as_caffe, set_mode_cpu, set_mode_gpu
    from netlib.layer import TEST, TRAIN, Layer
    from netlib.net import Net, set_random_seed
    from netlib.proto.options import layer_type_list
    from netlib.solver import Solver, get_solver

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


# Imported on first use, because a command prepares its process before NumPy is imported.
_MODULE_OF = {
    "TEST": "layer",
    "TRAIN": "layer",
    "Blob": "blob",
    "Blobs": "blob",
    "Layer": "layer",
    "Net": "net",
    "Solver": "solver",
    "get_solver": "solver",
    "layer_type_list": "proto.options",
    "set_random_seed": "net",
}
_MODULE_OF |= dict.fromkeys(("install_as_caffe", "set_mode_cpu", "set_mode_gpu"), "caffe")


def __getattr__(name: str) -> object:
    """Import and return a public name, or a module of this package.

    Raises AttributeError for others.
    """
    module = f"netlib.{_MODULE_OF.get(name, name)}"
    if name in _MODULE_OF:
        return getattr(import_module(module), name)
    if find_spec(module):
        return import_module(module)
    raise AttributeError(f"module 'netlib' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__


def threads() -> int:
    """Number of threads in use: ``set_threads``, else NETLIB_NUM_THREADS, else one
    per processor.
    """
    from netlib import engine

    return engine.get().threads()


def set_threads(count: int) -> None:
    """Set the number of threads.

    It may change the rounding of what does not run in slices, as of a single image.
    """
    from netlib import engine

    engine.get().set_threads(count)
