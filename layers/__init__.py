"""The layers, and the table that gives each type name its class.

They stand in the rooms of Caffe's layer catalogue: data, vision, activation, common, loss; and hand, for our own.
"""

from layers.activation.power import Power
from layers.activation.relu import ReLU
from layers.activation.scale import Scale
from layers.activation.sigmoid import Sigmoid
from layers.activation.tanh import TanH
from layers.common.argmax import ArgMax
from layers.common.batch_reindex import BatchReindex
from layers.common.concat import Concat
from layers.common.dropout import Dropout
from layers.common.eltwise import Eltwise
from layers.common.embed import Embed
from layers.common.filter import Filter
from layers.common.flatten import Flatten
from layers.common.inner_product import InnerProduct
from layers.common.parameter import Parameter
from layers.common.reduction import Reduction
from layers.common.reshape import Reshape
from layers.common.silence import Silence
from layers.common.slice import Slice
from layers.common.softmax import Softmax
from layers.common.split import Split
from layers.common.tile import Tile
from layers.data.data import Data
from layers.data.dummy_data import DummyData
from layers.data.hdf5_data import HDF5Data
from layers.data.hdf5_output import HDF5Output
from layers.data.image_data import ImageData
from layers.data.input import Input
from layers.data.memory_data import MemoryData
from layers.data.window_data import WindowData
from layers.hand.augment import HandAugment
from layers.hand.hand_model import HandModel
from layers.hand.phys_limit import PhysLimit, ReleasedPhysLimit
from layers.loss.accuracy import Accuracy
from layers.loss.euclidean_loss import EuclideanLoss
from layers.loss.smooth_l1_loss import SmoothL1Loss
from layers.loss.softmax_loss import SoftmaxWithLoss
from layers.vision.convolution import Convolution
from layers.vision.pooling import Pooling
from netlib.layer import Layer

LAYER_TYPES: dict[str, type[Layer]] = {
    "Accuracy": Accuracy,
    "ArgMax": ArgMax,
    "BatchReindex": BatchReindex,
    "Concat": Concat,
    "Convolution": Convolution,
    "Data": Data,
    "DeepHandModel": HandModel,  # the released system's name
    "DeepHandModelDofConstraintLoss": ReleasedPhysLimit,  # the released system's name
    "Dropout": Dropout,
    "DummyData": DummyData,
    "Eltwise": Eltwise,
    "Embed": Embed,
    "EuclideanLoss": EuclideanLoss,
    "Filter": Filter,
    "Flatten": Flatten,
    "HDF5Data": HDF5Data,
    "HDF5Output": HDF5Output,
    "HandAugment": HandAugment,
    "HandModel": HandModel,
    "ImageData": ImageData,
    "InnerProduct": InnerProduct,
    "Input": Input,
    "MemoryData": MemoryData,
    "Parameter": Parameter,
    "PhysLimit": PhysLimit,
    "Pooling": Pooling,
    "Power": Power,
    "ReLU": ReLU,
    "Reduction": Reduction,
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
    "Tile": Tile,
    "WindowData": WindowData,
}
