"""pycaffe's interface: ``import netlib.caffe as caffe``, or ``netlib.install_as_caffe()`` and
``import caffe``.

Net, Layer and the solvers are those of netlib with pycaffe's additional methods. NetSpec, io,
Classifier and draw are modules of this package; NetSpec, draw and caffe_pb2 need the package
protobuf. Everything runs on the CPU; requests for a GPU only log a warning.
"""

import sys

from netlib import engine
from netlib.caffe import _caffe, io, proto, removed
from netlib.caffe._caffe import *  # noqa: F403
from netlib.caffe.classifier import Classifier, Detector
from netlib.caffe.net_spec import NetSpec, layers, params, to_proto
from netlib.files import own_modules
from netlib.layer import TEST, TRAIN
from netlib.proto.options import layer_types

__version__ = _caffe.__version__
__all__ = [
    "TEST",
    "TRAIN",
    "Classifier",
    "Detector",
    "NetSpec",
    "_caffe",
    "io",
    "layers",
    "params",
    "proto",
    "to_proto",
]
__all__ += _caffe.__all__


def __getattr__(name: str) -> object:
    """Raise AttributeError, with advice for what pycaffe had in 2014."""
    raise removed.error(sys.modules[__name__], f"module {__name__!r}", name, removed.MODULE)


def install_as_caffe() -> None:
    """Make ``import caffe`` return this package in this process, even if Caffe is installed.

    From then on, a script's own modules named ``layers`` or ``fast`` are found before those
    of this project.
    """
    own_modules.take_caffe()
    layer_types()
    engine.get()
    own_modules.yield_names()
