"""pycaffe's interface: ``import netlib.caffe as caffe``, or ``netlib.install_as_caffe()`` and ``import caffe``.

Net, Layer and the solvers are those of netlib with pycaffe's additional methods. NetSpec, io, Classifier and
draw are modules of this package; NetSpec, draw and caffe_pb2 need the package protobuf. Everything runs on the CPU;
requests for a GPU only log a warning.
"""

from netlib import TEST, TRAIN
from netlib.caffe import _caffe, io, proto
from netlib.caffe._caffe import (
    NCCL,
    AdaDeltaSolver,
    AdaGradSolver,
    AdamSolver,
    Layer,
    NesterovSolver,
    Net,
    RMSPropSolver,
    SGDSolver,
    Solver,
    Timer,
    get_solver,
    has_nccl,
    init_log,
    layer_type_list,
    log,
    set_device,
    set_mode_cpu,
    set_mode_gpu,
    set_multiprocess,
    set_random_seed,
    set_solver_count,
    set_solver_rank,
    solver_count,
    solver_rank,
)
from netlib.caffe.classifier import Classifier
from netlib.caffe.net_spec import NetSpec, layers, params, to_proto

__version__ = _caffe.__version__
__all__ = [
    "NCCL", "TEST", "TRAIN", "AdaDeltaSolver", "AdaGradSolver", "AdamSolver", "Classifier", "Layer", "NesterovSolver",
    "Net", "NetSpec", "RMSPropSolver", "SGDSolver", "Solver", "Timer", "_caffe",
    "get_solver", "has_nccl", "init_log", "io", "layer_type_list", "layers", "log", "params",
    "proto", "set_device", "set_mode_cpu", "set_mode_gpu", "set_multiprocess", "set_random_seed", "set_solver_count",
    "set_solver_rank", "solver_count", "solver_rank", "to_proto",
]
