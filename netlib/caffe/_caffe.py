"""caffe._caffe: the names of pycaffe's compiled module, from which scripts and Python layers import.

A script may compare classes by identity, ``type(net.params["fc1"]) is caffe._caffe.BlobVec``, so these names are the
classes of the objects. Vectors of numbers, strings, layers and nets are Python lists.
"""

from netlib import Layer, layer_type_list, set_mode_cpu, set_mode_gpu, set_random_seed
from netlib.blob import Blob, BlobVec
from netlib.blob import Blobs as RawBlobVec
from netlib.caffe.process import (
    NCCL,
    Timer,
    has_nccl,
    init_log,
    log,
    set_device,
    set_multiprocess,
    set_solver_count,
    set_solver_rank,
    solver_count,
    solver_rank,
)
from netlib.caffe.pycaffe import (
    AdaDeltaSolver,
    AdaGradSolver,
    AdamSolver,
    NesterovSolver,
    Net,
    RMSPropSolver,
    SGDSolver,
    Solver,
    SolverParameter,
    get_solver,
)
from netlib.proto.messages import LayerParameter

BoolVec = DtypeVec = IntVec = LayerVec = NetVec = StringVec = list
__version__ = "1.0.0"  # version of Caffe whose interface this is

__all__ = [
    "NCCL", "AdaDeltaSolver", "AdaGradSolver", "AdamSolver", "Blob", "BlobVec", "BoolVec", "DtypeVec", "IntVec",
    "Layer", "LayerParameter", "LayerVec", "NesterovSolver", "Net", "NetVec", "RMSPropSolver", "RawBlobVec",
    "SGDSolver", "Solver", "SolverParameter", "StringVec", "Timer", "get_solver", "has_nccl", "init_log",
    "layer_type_list", "log", "set_device", "set_mode_cpu", "set_mode_gpu", "set_multiprocess", "set_random_seed",
    "set_solver_count", "set_solver_rank", "solver_count", "solver_rank",
]
