"""The layers, and the table of their types.

Sub-packages follow Caffe's layer catalogue: data, vision, activation, normalization, recurrent, common, loss.
``detection`` holds layers of the SSD branch, ``hand`` the layers of this project.
"""

from layers.activation.absval import AbsVal
from layers.activation.bias import Bias
from layers.activation.bnll import BNLL
from layers.activation.clip import Clip
from layers.activation.elu import ELU
from layers.activation.exp import Exp
from layers.activation.log import Log
from layers.activation.power import Power
from layers.activation.prelu import PReLU
from layers.activation.relu import ReLU
from layers.activation.relu6 import ReLU6
from layers.activation.scale import Scale
from layers.activation.sigmoid import Sigmoid
from layers.activation.swish import Swish
from layers.activation.tanh import TanH
from layers.activation.threshold import Threshold
from layers.common.argmax import ArgMax
from layers.common.axpy import Axpy
from layers.common.batch_reindex import BatchReindex
from layers.common.concat import Concat
from layers.common.dropout import Dropout
from layers.common.eltwise import Eltwise
from layers.common.embed import Embed
from layers.common.filter import Filter
from layers.common.flatten import Flatten
from layers.common.inner_product import InnerProduct
from layers.common.parameter import Parameter
from layers.common.permute import Permute
from layers.common.reduction import Reduction
from layers.common.reshape import Reshape
from layers.common.shuffle_channel import ShuffleChannel
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
from layers.detection.detection_output import DetectionOutput
from layers.detection.prior_box import PriorBox
from layers.hand.augment import HandAugment
from layers.hand.hand_model import HandModel
from layers.hand.phys_limit import PhysLimit, ReleasedPhysLimit
from layers.hand.sized_hand_model import SizedHandModel
from layers.loss.accuracy import Accuracy
from layers.loss.contrastive_loss import ContrastiveLoss
from layers.loss.euclidean_loss import EuclideanLoss
from layers.loss.hinge_loss import HingeLoss
from layers.loss.infogain_loss import InfogainLoss
from layers.loss.multinomial_logistic_loss import MultinomialLogisticLoss
from layers.loss.sigmoid_cross_entropy_loss import SigmoidCrossEntropyLoss
from layers.loss.smooth_l1_loss import SmoothL1Loss
from layers.loss.softmax_loss import SoftmaxWithLoss
from layers.normalization.batch_norm import BatchNorm
from layers.normalization.lrn import LRN
from layers.normalization.mvn import MVN
from layers.normalization.normalize import Normalize
from layers.recurrent.lstm import LSTM
from layers.recurrent.lstm_unit import LSTMUnit
from layers.recurrent.rnn import RNN
from layers.vision.convolution import Convolution
from layers.vision.crop import Crop
from layers.vision.deconvolution import Deconvolution
from layers.vision.depthwise_convolution import ConvolutionDepthwise, DepthwiseConvolution
from layers.vision.im2col import Im2col
from layers.vision.interp import Interp
from layers.vision.nearest_upsample import NearestUpsample
from layers.vision.pooling import Pooling
from layers.vision.roi_pooling import ROIPooling
from layers.vision.spp import SPP
from layers.vision.upsample import Upsample
from netlib.layer import Layer

LAYER_TYPES: dict[str, type[Layer]] = {
    "AbsVal": AbsVal,
    "Accuracy": Accuracy,
    "ArgMax": ArgMax,
    "Axpy": Axpy,  # from SENet
    "BNLL": BNLL,
    "BatchNorm": BatchNorm,
    "BatchReindex": BatchReindex,
    "Bias": Bias,
    "Clip": Clip,
    "Concat": Concat,
    "ContrastiveLoss": ContrastiveLoss,
    "Convolution": Convolution,
    "ConvolutionDepthwise": ConvolutionDepthwise,  # from MobileNet's forks
    "Crop": Crop,
    "Data": Data,
    "Deconvolution": Deconvolution,
    "DeepHandModel": HandModel,  # name in the released system
    "DeepHandModelDofConstraintLoss": ReleasedPhysLimit,  # name in the released system
    "DetectionOutput": DetectionOutput,  # from SSD
    "DepthwiseConvolution": DepthwiseConvolution,  # from MobileNet's forks
    "Dropout": Dropout,
    "DummyData": DummyData,
    "ELU": ELU,
    "Eltwise": Eltwise,
    "Embed": Embed,
    "EuclideanLoss": EuclideanLoss,
    "Exp": Exp,
    "Filter": Filter,
    "Flatten": Flatten,
    "HDF5Data": HDF5Data,
    "HDF5Output": HDF5Output,
    "HandAugment": HandAugment,
    "HandModel": HandModel,
    "HingeLoss": HingeLoss,
    "Im2col": Im2col,
    "ImageData": ImageData,
    "InfogainLoss": InfogainLoss,
    "InnerProduct": InnerProduct,
    "Input": Input,
    "Interp": Interp,  # from DeepLab and PSPNet
    "LRN": LRN,
    "LSTM": LSTM,
    "LSTMUnit": LSTMUnit,
    "Log": Log,
    "MVN": MVN,
    "MemoryData": MemoryData,
    "MultinomialLogisticLoss": MultinomialLogisticLoss,
    "Normalize": Normalize,  # from SSD
    "PReLU": PReLU,
    "Parameter": Parameter,
    "Permute": Permute,  # from SSD
    "PhysLimit": PhysLimit,
    "Pooling": Pooling,
    "Power": Power,
    "PriorBox": PriorBox,  # from SSD
    "RNN": RNN,
    "ROIPooling": ROIPooling,  # from Fast R-CNN
    "ReLU": ReLU,
    "ReLU6": ReLU6,  # from MobileNet's forks
    "Reduction": Reduction,
    "Reshape": Reshape,
    "SPP": SPP,
    "Scale": Scale,
    "ShuffleChannel": ShuffleChannel,  # from ShuffleNet
    "Sigmoid": Sigmoid,
    "SigmoidCrossEntropyLoss": SigmoidCrossEntropyLoss,
    "Silence": Silence,
    "Slice": Slice,
    "SmoothL1Loss": SmoothL1Loss,
    "Softmax": Softmax,
    "SoftmaxWithLoss": SoftmaxWithLoss,
    "Split": Split,
    "Swish": Swish,
    "TanH": TanH,
    "Threshold": Threshold,
    "Tile": Tile,
    "Upsample": Upsample,  # from SegNet
    "WindowData": WindowData,
}

# Types with a different class for some number of bottoms.
BY_BOTTOMS: dict[tuple[str, int], type[Layer]] = {
    ("DeepHandModel", 2): SizedHandModel,
    ("HandModel", 2): SizedHandModel,
    ("Upsample", 1): NearestUpsample,  # from YOLO's forks
}
