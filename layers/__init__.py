"""The layers, and the table that gives each type name its class.

They stand in the rooms of Caffe's layer catalogue: data, vision, activation, normalization, recurrent, common, loss;
and hand, for our own.
"""

from layers.activation.power import Power
from layers.activation.relu import ReLU
from layers.activation.scale import Scale
from layers.activation.sigmoid import Sigmoid
from layers.activation.tanh import TanH
from layers.common.axpy import Axpy
from layers.common.concat import Concat
from layers.common.dropout import Dropout
from layers.common.eltwise import Eltwise
from layers.common.flatten import Flatten
from layers.common.inner_product import InnerProduct
from layers.common.reshape import Reshape
from layers.common.silence import Silence
from layers.common.slice import Slice
from layers.common.softmax import Softmax
from layers.common.split import Split
from layers.data.dummy_data import DummyData
from layers.data.hdf5_data import HDF5Data
from layers.data.input import Input
from layers.hand.augment import HandAugment
from layers.hand.hand_model import HandModel
from layers.hand.phys_limit import PhysLimit, ReleasedPhysLimit
from layers.loss.accuracy import Accuracy
from layers.loss.euclidean_loss import EuclideanLoss
from layers.loss.smooth_l1_loss import SmoothL1Loss
from layers.loss.softmax_loss import SoftmaxWithLoss
from layers.normalization.batch_norm import BatchNorm
from layers.normalization.lrn import LRN
from layers.normalization.mvn import MVN
from layers.recurrent.lstm import LSTM
from layers.recurrent.rnn import RNN
from layers.vision.convolution import Convolution
from layers.vision.crop import Crop
from layers.vision.deconvolution import Deconvolution
from layers.vision.im2col import Im2col
from layers.vision.pooling import Pooling
from layers.vision.roi_pooling import ROIPooling
from layers.vision.spp import SPP
from netlib.layer import Layer

LAYER_TYPES: dict[str, type[Layer]] = {
    "Accuracy": Accuracy,
    "Axpy": Axpy,  # SENet's
    "BatchNorm": BatchNorm,
    "Concat": Concat,
    "Convolution": Convolution,
    "Crop": Crop,
    "Deconvolution": Deconvolution,
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
    "Im2col": Im2col,
    "InnerProduct": InnerProduct,
    "Input": Input,
    "LRN": LRN,
    "LSTM": LSTM,
    "MVN": MVN,
    "PhysLimit": PhysLimit,
    "Pooling": Pooling,
    "Power": Power,
    "RNN": RNN,
    "ROIPooling": ROIPooling,  # Fast R-CNN's
    "ReLU": ReLU,
    "Reshape": Reshape,
    "SPP": SPP,
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
