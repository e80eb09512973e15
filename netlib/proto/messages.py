"""Caffe's messages: the fields of nets, layers, solvers and solver states, in text
and binary files.

Each field is one line: its name, type, number in the binary format, default and meaning. The
options of layer types are declared with the layers.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from netlib.proto.prototxt import Message
from netlib.proto.schema import Doubles, Floats, Int64, Natural, Phase, numbered


@dataclass(frozen=True)
class BlobShape:
    """The shape of a blob, one ``dim`` per axis."""

    dim: tuple[Int64, ...] = numbered(1, (), packed=True)


@dataclass(frozen=True, eq=False)
class BlobProto:
    """A blob in a file: its shape, and its values in single or double precision."""

    shape: BlobShape | None = numbered(7, None)
    data: Floats | None = numbered(5, None, packed=True)
    diff: Floats | None = numbered(6, None, packed=True)
    double_data: Doubles | None = numbered(8, None, packed=True)
    double_diff: Doubles | None = numbered(9, None, packed=True)
    # NVIDIA's Caffe, OpenCV
    raw_data_type: Literal["DOUBLE", "FLOAT", "FLOAT16"] = numbered(10, "DOUBLE")
    raw_data: bytes = numbered(12, b"")  # instead of data
    num: int = numbered(1, 0)  # older form of ``shape``, always four axes
    channels: int = numbered(2, 0)
    height: int = numbered(3, 0)
    width: int = numbered(4, 0)


@dataclass(frozen=True)
class BlobProtoVector:
    """Several blobs."""

    blobs: tuple[BlobProto, ...] = numbered(1, ())


@dataclass(frozen=True, eq=False)
class Datum:
    """An image and its label, as stored in Caffe's databases."""

    channels: int = numbered(1, 0)
    height: int = numbered(2, 0)
    width: int = numbered(3, 0)
    data: bytes = numbered(4, b"")  # one byte per value, channel by channel; or an encoded image
    label: int = numbered(5, 0)
    float_data: Floats | None = numbered(6, None)  # instead of data
    encoded: bool = numbered(7, False)  # data is an image file: PNG, JPEG ...


@dataclass(frozen=True)
class NetState:
    """The state that a net is built for; rules of layers include or exclude them by it."""

    phase: Phase = numbered(1, "TEST")
    level: int = numbered(2, 0)
    stage: tuple[str, ...] = numbered(3, ())


@dataclass(frozen=True)
class NetStateRule:
    """Matches a NetState if all conditions given here hold."""

    phase: Phase | None = numbered(1, None)
    min_level: int | None = numbered(2, None)
    max_level: int | None = numbered(3, None)
    stage: tuple[str, ...] = numbered(4, ())  # all of them must be set
    not_stage: tuple[str, ...] = numbered(5, ())  # none of them may be set


@dataclass(frozen=True)
class ParamSpec:
    """How one parameter of a layer is trained and shared."""

    name: str | None = numbered(1, None)  # parameters with the same name are shared
    # equal shapes, or only equal counts
    share_mode: Literal["STRICT", "PERMISSIVE"] = numbered(2, "STRICT")
    # multiplies the solver's learning rate; 0 freezes the parameter
    lr_mult: float = numbered(3, 1.0)
    decay_mult: float = numbered(4, 1.0)  # multiplies the solver's weight decay


@dataclass(frozen=True)
class Filler:
    """A ``weight_filler``, ``bias_filler`` or ``filler`` block."""

    type: str = numbered(1, "constant")
    value: float = numbered(2, 0.0)  # constant
    min: float = numbered(3, 0.0)  # uniform
    max: float = numbered(4, 1.0)  # uniform
    mean: float = numbered(5, 0.0)  # gaussian
    std: float = numbered(6, 1.0)  # gaussian
    # gaussian: expected number of non-zero weights per output; negative: all
    sparse: int = numbered(7, -1)
    variance_norm: Literal["FAN_IN", "FAN_OUT", "AVERAGE"] = numbered(8, "FAN_IN")  # xavier, msra


@dataclass(frozen=True)
class PythonParameter:
    """The ``python_param`` block of a layer of type Python."""

    module: str = numbered(1)  # imported from the working directory or PYTHONPATH
    layer: str = numbered(2)  # name of the class
    param_str: str = numbered(3, "")
    share_in_parallel: bool = numbered(4, False)


@dataclass(frozen=True)
class LossParameter:
    """The ``loss_param`` block of loss layers that normalize over labels."""

    ignore_label: int | None = numbered(1, None)  # items with this label are ignored
    normalization: Literal["FULL", "VALID", "BATCH_SIZE", "NONE"] = numbered(3, "VALID")
    normalize: bool | None = numbered(2, None)  # older: true is VALID, false is BATCH_SIZE


# Numbers of the options blocks of layer types. Each block is declared in the file of its layer.
BLOCKS = {
    "transform_param": 100,
    "loss_param": 101,
    "accuracy_param": 102,
    "argmax_param": 103,
    "batch_norm_param": 139,
    "bias_param": 141,
    "clip_param": 148,
    "concat_param": 104,
    "contrastive_loss_param": 105,
    "convolution_param": 106,
    "crop_param": 144,
    "data_param": 107,
    "dropout_param": 108,
    "dummy_data_param": 109,
    "eltwise_param": 110,
    "elu_param": 140,
    "embed_param": 137,
    "exp_param": 111,
    "flatten_param": 135,
    "hdf5_data_param": 112,
    "hdf5_output_param": 113,
    "hinge_loss_param": 114,
    "image_data_param": 115,
    "infogain_loss_param": 116,
    "inner_product_param": 117,
    "input_param": 143,
    "log_param": 134,
    "lrn_param": 118,
    "memory_data_param": 119,
    "mvn_param": 120,
    "parameter_param": 145,
    "pooling_param": 121,
    "power_param": 122,
    "prelu_param": 131,
    "python_param": 130,
    "recurrent_param": 146,
    "reduction_param": 136,
    "relu_param": 123,
    "reshape_param": 133,
    "scale_param": 142,
    "sigmoid_param": 124,
    "slice_param": 126,
    "softmax_param": 125,
    "spp_param": 132,
    "swish_param": 147,
    "tanh_param": 127,
    "threshold_param": 128,
    "tile_param": 138,
    # from SSD
    "permute_param": 202,
    "prior_box_param": 203,
    "detection_output_param": 204,
    "norm_param": 206,
    # from Fast R-CNN's fork of Caffe
    "roi_pooling_param": 8266711,
    "smooth_l1_loss_param": 8266712,
    # Blocks of forks with different numbers (FORK_NUMBERS). These six are numbers of forks that no
    # other block has.
    "bn_param": 152,
    "psroi_pooling_param": 153,
    "interp_param": 163,
    "relu6_param": 300,
    "shuffle_channel_param": 164,
    "upsample_param": 177,
    # of this project
    "hand_model_param": 10001,
    "phys_limit_param": 10002,
    "hand_augment_param": 10003,
}

# Type -> its block, and numbers of this block in forks. In other layers they are the numbers
# of other blocks.
FORK_NUMBERS = {
    "Interp": ("interp_param", (143, 147)),  # DeepLab and PSPNet, a fork for Windows
    "LSTM": ("recurrent_param", (151,)),  # NVIDIA
    "RNN": ("recurrent_param", (151,)),
    "PSROIPooling": ("psroi_pooling_param", (10002,)),  # OpenCV
    "ROIPooling": ("roi_pooling_param", (154,)),  # Intel
    "ReLU6": ("relu6_param", (211, 2060, 100000)),  # YOLO, two forks for MobileNet
    "ShuffleChannel": ("shuffle_channel_param", (159, 166)),
    "SmoothL1Loss": ("smooth_l1_loss_param", (148, 212)),  # Intel, OpenVINO
    "Upsample": ("upsample_param", (137, 147, 149, 150)),  # SegNet, its version for cuDNN 5, YOLO
}


@dataclass(frozen=True)
class LayerParameter:
    """One ``layer { ... }``.

    Options of its type (``convolution_param`` ...) are kept as trees in ``blocks``.
    """

    name: str = numbered(1, "")
    type: str = numbered(2, "")
    bottom: tuple[str, ...] = numbered(3, ())
    top: tuple[str, ...] = numbered(4, ())
    phase: Phase | None = numbered(10, None)  # default: that of the net
    loss_weight: tuple[float, ...] = numbered(5, ())  # one per top
    param: tuple[ParamSpec, ...] = numbered(6, ())  # one per parameter
    blobs: tuple[BlobProto, ...] = numbered(7, ())  # values of the parameters, in weights files
    # per bottom, whether to compute its gradient
    propagate_down: tuple[bool, ...] = numbered(11, ())
    include: tuple[NetStateRule, ...] = numbered(8, ())
    exclude: tuple[NetStateRule, ...] = numbered(9, ())
    # every ``*_param { ... }``
    blocks: dict[str, Message] = field(default_factory=dict, metadata={"numbers": BLOCKS})


@dataclass(frozen=True)
class NetParameter:
    """A net."""

    name: str = numbered(1, "")
    layer: tuple[LayerParameter, ...] = numbered(100, ())
    input: tuple[str, ...] = numbered(3, ())  # old style: names of the input blobs
    input_shape: tuple[BlobShape, ...] = numbered(8, ())  # old style: one per input
    input_dim: tuple[int, ...] = numbered(4, ())  # oldest style: four numbers per input
    force_backward: bool = numbered(5, False)  # compute all gradients, needed or not
    state: NetState = numbered(6, NetState())
    debug_info: bool = numbered(7, False)


@dataclass(frozen=True)
class SolverParameter:
    """Options of a solver."""

    net: str | None = numbered(24, None)  # the net for training and testing
    net_param: Message | None = numbered(25, None)  # the same, inline
    train_net: str | None = numbered(1, None)
    train_net_param: Message | None = numbered(21, None)
    test_net: tuple[str, ...] = numbered(2, ())
    test_net_param: tuple[Message, ...] = numbered(22, ())
    train_state: NetState = numbered(26, NetState())
    test_state: tuple[NetState, ...] = numbered(27, ())
    test_iter: tuple[Natural, ...] = numbered(3, ())  # per test net, batches of one test
    test_interval: Natural = numbered(4, 0)  # iterations between tests
    test_compute_loss: bool = numbered(19, False)  # also report the total loss of the test net
    test_initialization: bool = numbered(32, True)  # test before the first iteration
    base_lr: float = numbered(5, 0.0)
    lr_policy: str = numbered(8, "")  # fixed, step, exp, inv, multistep, poly, sigmoid
    gamma: float = numbered(9, 0.0)
    power: float = numbered(10, 0.0)
    stepsize: Natural = numbered(13, 0)
    stepvalue: tuple[Natural, ...] = numbered(34, ())
    # iterations of an initial linear increase (NVIDIA's Caffe)
    rampup_interval: Natural = numbered(10001, 0)
    rampup_lr: float = numbered(10002, 0.0)  # initial rate of this increase, up to base_lr
    max_iter: Natural = numbered(7, 0)
    iter_size: Natural = numbered(36, 1)  # batches summed in one iteration
    display: Natural = numbered(6, 0)  # iterations between log lines; 0: none
    average_loss: Natural = numbered(33, 1)  # iterations averaged in the displayed loss
    type: str = numbered(40, "SGD")  # SGD, Nesterov, AdaGrad, RMSProp, AdaDelta, Adam
    # old
    solver_type: Literal["SGD", "NESTEROV", "ADAGRAD", "RMSPROP", "ADADELTA", "ADAM"] | None = (
        numbered(30, None)
    )
    momentum: float = numbered(11, 0.0)  # Adam's beta1, AdaDelta's decay
    momentum2: float = numbered(39, 0.999)  # Adam's beta2
    rms_decay: float = numbered(38, 0.99)
    delta: float = numbered(31, 1e-8)
    weight_decay: float = numbered(12, 0.0)
    regularization_type: str = numbered(29, "L2")
    # bound on the joint L2 norm of all gradients; negative: none
    clip_gradients: float = numbered(35, -1.0)
    snapshot: Natural = numbered(14, 0)  # iterations between snapshots; 0: only at the end
    snapshot_prefix: str = numbered(15, "")
    snapshot_after_train: bool = numbered(28, True)
    snapshot_diff: bool = numbered(16, False)  # also store the gradients, in the binary format
    snapshot_format: Literal["HDF5", "BINARYPROTO"] = numbered(37, "BINARYPROTO")
    # files of initial weights; one string may list several with commas
    weights: tuple[str, ...] = numbered(42, ())
    random_seed: Int64 = numbered(20, -1)  # negative: a new seed each run
    solver_mode: Literal["CPU", "GPU"] = numbered(17, "CPU")
    device_id: int = numbered(18, 0)
    debug_info: bool = numbered(23, False)
    layer_wise_reduce: bool = numbered(41, True)


@dataclass(frozen=True)
class SolverState:
    """State of a training run, in addition to the weights."""

    iter: int = numbered(1, 0)
    learned_net: str = numbered(2, "")  # path of the weights file
    history: tuple[BlobProto, ...] = numbered(3, ())
    current_step: int = numbered(4, 0)
    # extra JSON of this project for an exact resume; Caffe ignores it
    netlib: str = numbered(10001, "")
