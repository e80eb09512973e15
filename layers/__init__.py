"""The layers, and the table that gives each type name its class."""

from layers.accuracy import Accuracy
from layers.augment import HandAugment
from layers.concat import Concat
from layers.convolution import Convolution
from layers.dropout import Dropout
from layers.dummy_data import DummyData
from layers.eltwise import Eltwise
from layers.euclidean_loss import EuclideanLoss
from layers.flatten import Flatten
from layers.hand_model import HandModel
from layers.hdf5_data import HDF5Data
from layers.inner_product import InnerProduct
from layers.input import Input
from layers.phys_limit import PhysLimit, ReleasedPhysLimit
from layers.pooling import Pooling
from layers.power import Power
from layers.relu import ReLU
from layers.reshape import Reshape
from layers.scale import Scale
from layers.sigmoid import Sigmoid
from layers.silence import Silence
from layers.slice import Slice
from layers.smooth_l1_loss import SmoothL1Loss
from layers.softmax import Softmax
from layers.softmax_loss import SoftmaxWithLoss
from layers.split import Split
from layers.tanh import TanH
from netlib.layer import Layer

LAYER_TYPES: dict[str, type[Layer]] = {
    "Accuracy": Accuracy,
    "Concat": Concat,
    "Convolution": Convolution,
    "DeepHandModel": HandModel,  # the released system's name
    "DeepHandModelDofConstraintLoss": ReleasedPhysLimit,  # the released system's name
    "Dropout": Dropout,
    "DummyData": DummyData,
    "Eltwise": Eltwise,
    "EuclideanLoss": EuclideanLoss,
    "Flatten": Flatten,
    "HDF5Data": HDF5Data,
    "HandAugment": HandAugment,
    "HandModel": HandModel,
    "InnerProduct": InnerProduct,
    "Input": Input,
    "PhysLimit": PhysLimit,
    "Pooling": Pooling,
    "Power": Power,
    "ReLU": ReLU,
    "Reshape": Reshape,
    "Scale": Scale,
    "Sigmoid": Sigmoid,
    "Silence": Silence,
    "Slice": Slice,
    "SmoothL1Loss": SmoothL1Loss,
    "Softmax": Softmax,
    "SoftmaxWithLoss": SoftmaxWithLoss,
    "Split": Split,
    "TanH": TanH,
}
