"""Options and layer types of popular forks of Caffe that this project does not have.

An option that only selects an implementation (an algorithm, a precision, a number of threads), or whose value has no
effect, is accepted and ignored. Any other is an error that says what the option does. Options whose layers are
implemented are declared with them, in the files of layers/. Sources: the caffe.proto of each fork.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from netlib.errors import FORK_NAMES, option_advice
from netlib.proto.prototxt import Field, Scalar

NVIDIA, INTEL, SSD = "NVIDIA's", "Intel's", "SSD's"
SEGNET, PSPNET, DEEPLAB, YOLO, OPENVINO = "SegNet's", "PSPNet's", "DeepLab's", "YOLO's", "OpenVINO's"


@dataclass(frozen=True)
class Option:
    """An option of a fork.

    harmless  its value without effect; None: all values only select an implementation
    effect    what another value does, with ``advice`` on what to write instead
    """

    fork: str
    harmless: str | None = None
    effect: str = ""
    advice: str = ""

    def has_effect(self, item: Field) -> bool:
        """Whether the value of the field changes the result."""
        if self.effect and self.harmless is None:
            return True
        return self.harmless is not None and not (isinstance(item.value, Scalar) and _same(item.value, self.harmless))

    def __str__(self) -> str:
        harmless = f"{self.harmless}, or " if self.harmless and self.advice else self.harmless or ""
        expected = f"; expected {harmless}{self.advice}" if harmless or self.advice else ""
        forks = "forks" if " and " in self.fork else "fork"
        return f"of {self.fork} {forks}, which changes the result: it {self.effect}{expected}"


_SCALE_AFTER = "a layer Scale with bias_term: true after it"
_RELU_AFTER = "a layer ReLU after it"
_AUGMENTS = "changes the images"
_DISTRIBUTION = Option(INTEL)

ENGINES = ("MKL2017", "MKLDNN")  # Intel's values of ``engine``
# Dataclass of a message -> name of a field
OPTIONS: dict[str, dict[str, Option]] = {
    "BatchNormParameter": {
        "engine": Option(f"{NVIDIA} and {INTEL}"),
        "scale_bias": Option(NVIDIA, "false", "multiplies by a learned scale and adds a learned bias", _SCALE_AFTER),
        "scale_filler": Option(NVIDIA, None, "adds a learned scale and bias", _SCALE_AFTER),
        "bias_filler": Option(f"{NVIDIA} and {INTEL}", None, "adds a learned scale and bias", _SCALE_AFTER),
        "filler": Option(INTEL, None, "adds a learned scale and bias", _SCALE_AFTER),
        "use_weight_bias": Option(INTEL, "false", "adds a learned scale and bias", _SCALE_AFTER),
        "bias_term": Option(INTEL, "false", "adds a learned bias", _SCALE_AFTER),
        "stats_batch_size": Option(INTEL, "0", "normalizes parts of the batch by their own mean and variance"),
        "relu": Option(INTEL, "false", "replaces negative values by 0", _RELU_AFTER),
    },
    "ConcatParameter": {"engine": Option(INTEL), "per_fla_fuse": Option(INTEL)},
    "ConvolutionParameter": {
        "cudnn_convolution_algo_seeker": Option(NVIDIA),
        "conv_algos_override": Option(NVIDIA),
        "conv_algorithm": Option(INTEL),
        "relu": Option(INTEL, "false", "replaces negative values by 0", _RELU_AFTER),
        "negative_slope": Option(INTEL),  # without relu it has no effect
        "fusion_type": Option(INTEL, "NONE_FUSION", "adds another blob", "a layer Eltwise after it"),
        "coeff": Option(INTEL),  # without fusion_type it has no effect
        **dict.fromkeys(("hole", "hole_h", "hole_w"), Option(DEEPLAB, "1", "spaces the kernel's elements", "dilation")),
    },
    "DataParameter": {
        "threads": Option(NVIDIA),
        "parser_threads": Option(NVIDIA),
        "precache": Option(NVIDIA),
        "shuffle": Option(f"{NVIDIA} and {INTEL}", "false", "changes the order of the items"),
        "side": Option(INTEL, None, "writes labels of detections"),
    },
    "DropoutParameter": {"engine": Option(NVIDIA), "random_seed": Option(NVIDIA)},
    "EltwiseParameter": {"engine": Option(INTEL)},
    "ELUParameter": {"lambda": Option(NVIDIA, "1", "multiplies the result", "a layer Power with this scale after it")},
    "Filler": {"scale": Option(INTEL, "1", "multiplies the initial values")},
    "ImageDataParameter": {
        "threads": Option(NVIDIA),
        "cache": Option(NVIDIA),
        "precache": Option(NVIDIA),
        "short_side": Option(NVIDIA, "0", "resizes the images"),
        "dataset_share_per_node": Option(NVIDIA, "1", "reads only a part of the images"),
        "min_height": Option(INTEL, "0", "resizes the images"),
        "min_width": Option(INTEL, "0", "resizes the images"),
    },
    "InnerProductParameter": {
        "engine": Option(INTEL),
        "relu": Option(INTEL, "false", "replaces negative values by 0", _RELU_AFTER),
        "negative_slope": Option(INTEL),
    },
    "LayerParameter": {
        "forward_type": Option(NVIDIA),
        "backward_type": Option(NVIDIA),
        "forward_math": Option(NVIDIA),
        "backward_math": Option(NVIDIA),
        "debug": Option(NVIDIA),
        "cudnn_math_override": Option(NVIDIA),
        "engine": Option(INTEL),
        "multinode": _DISTRIBUTION,
        "mn_activation_param": _DISTRIBUTION,
        "mn_grad_compress_param": _DISTRIBUTION,
        "quantization_param": Option(INTEL, None, "computes with 8-bit integers", "the net in single precision"),
    },
    "LossParameter": {
        "label_smoothing": Option(f"{NVIDIA} and {INTEL}", "0", "replaces each label by a distribution"),
        "pre_fixed_normalizer": Option(INTEL),  # only normalization: PRE_FIXED reads it
    },
    "NetParameter": {
        "default_forward_type": Option(NVIDIA),
        "default_backward_type": Option(NVIDIA),
        "default_forward_math": Option(NVIDIA),
        "default_backward_math": Option(NVIDIA),
        "default_conv_algos_override": Option(NVIDIA),
        "default_cudnn_math_override": Option(NVIDIA),
        "reduce_buckets": Option(NVIDIA),
        "eltwise_mem_sharing": Option(NVIDIA),
        "global_grad_scale": Option(NVIDIA),  # the update divides by it again
        "global_grad_scale_adaptive": Option(NVIDIA),
        "engine": Option(INTEL),
        "compile_net_state": Option(INTEL),
        "multinode": _DISTRIBUTION,
        "bn_stats_batch_size": Option(INTEL, "0", "normalizes parts of the batch by their own mean and variance"),
    },
    "PoolingParameter": {
        "torch_pooling": Option(NVIDIA, "false", "rounds the size of the top down", "round_mode: FLOOR"),
        "avg_include_pad": Option(INTEL, "true", "does not count padding in a mean"),
        "axis": Option(INTEL, "1", "pools over other axes"),
        **dict.fromkeys(("pad_3d", "kernel_size_3d", "stride_3d"), Option(INTEL, None, "pools over three axes")),
    },
    "ReLUParameter": {"fuse": Option(INTEL)},
    "ReshapeParameter": {"pixelshuffler": Option(INTEL, "1", "moves channels to rows and columns")},
    "SolverParameter": {
        "eval_type": Option(SSD, '"classification"', "evaluates detections in tests"),
        "ap_version": Option(SSD),
        "show_per_class_result": Option(SSD),
        "solver_data_type": Option(NVIDIA),
        "store_blobs_in_old_format": Option(NVIDIA),
        "min_lr": Option(NVIDIA, "0", "bounds the learning rate"),
        "momentum_policy": Option(NVIDIA, '"fixed"', "changes the momentum during the training"),
        "max_momentum": Option(NVIDIA),  # without the policy it has no effect; the same holds below
        "momentum_power": Option(NVIDIA),
        "weight_decay_policy": Option(NVIDIA, '"fixed"', "changes the weight decay during the training"),
        "weight_decay_power": Option(NVIDIA),
        "max_weight_decay": Option(NVIDIA),
        "larc": Option(NVIDIA, "false", "adapts the learning rate to each parameter"),
        **dict.fromkeys(("larc_policy", "larc_eta", "larc_turbo"), Option(NVIDIA)),
        "test_and_snapshot_last_epochs": Option(NVIDIA, "0", "tests and writes snapshots in the last epochs"),
        "plateau_winsize": Option(SSD),
        "engine": Option(INTEL),
        "disabled_update": Option(INTEL, "false", "does not change the weights"),
        "warmup_iter": Option(INTEL, "0", "begins with a lower learning rate", "rampup_interval and rampup_lr"),
        "warmup_start_lr": Option(INTEL),
        "local_lr_auto": Option(INTEL, "false", "adapts the learning rate to each parameter"),
        "local_gw_ratio": Option(INTEL),
        "test_offset": Option(INTEL, "0", "moves the iterations of tests"),
        **dict.fromkeys(("stagelr", "stageiter"), Option(INTEL)),
    },
    "TransformationParameter": {
        "use_gpu_transform": Option(NVIDIA),
        "forward_packing": Option(NVIDIA),
        "random_seed": Option(NVIDIA),
        "display": Option(NVIDIA),
        "allow_upscale": Option(NVIDIA),  # without resizing these have no effect
        "interpolation_algo_up": Option(NVIDIA),
        "interpolation_algo_down": Option(NVIDIA),
        **dict.fromkeys(("img_rand_resize_lower", "img_rand_resize_upper", "rand_resize_ratio_lower",
                         "rand_resize_ratio_upper"), Option(NVIDIA, "0", _AUGMENTS)),
        **dict.fromkeys(("vertical_stretch_lower", "vertical_stretch_upper", "horizontal_stretch_lower",
                         "horizontal_stretch_upper"), Option(NVIDIA, "1", _AUGMENTS)),
        "num_labels": Option(NVIDIA, "0", "reads several labels of an image"),
        "crop_h": Option(SSD, "0", _AUGMENTS, "crop_size"),
        "crop_w": Option(SSD, "0", _AUGMENTS, "crop_size"),
        **dict.fromkeys(("resize_param", "noise_param", "distort_param", "expand_param", "emit_constraint"),
                        Option(SSD, None, _AUGMENTS)),
        **dict.fromkeys(("random_resize_param", "random_aspect_ratio_param"), Option(INTEL, None, _AUGMENTS)),
        "flow": Option(INTEL, "false", _AUGMENTS),
        "bgr2rgb": Option(INTEL, "false", "exchanges blue and red"),
        "pad": Option(INTEL, "0", _AUGMENTS),
    },
}

# Layer type -> its fork. Similar names compute something else, so none of them is a misspelling.
TYPES: dict[str, str] = {
    **dict.fromkeys(("DetectNetTransformation", "L1Loss", "TRT"), NVIDIA),
    **dict.fromkeys(("BoxAnnotatorOHEM", "BoxData", "EvalDetection", "MnActivation", "RegionLoss",
                     "SmoothL1LossOHEM", "SoftmaxWithLossOHEM", "SpatialDropout"), INTEL),
    **dict.fromkeys(("AnnotatedData", "DetectionEvaluate", "MultiBoxLoss", "VideoData"), SSD),
    **dict.fromkeys(("AdaptiveBiasChannel", "BiasChannel", "DenseCRF", "DomainTransform", "ImageSegData", "MatRead",
                     "MatWrite", "SegAccuracy", "SpatialProduct", "UniqueLabel"), DEEPLAB),
    **dict.fromkeys(("Reorg", "YoloDetectionOutput", "YoloSeg", "Yolov3", "Yolov3DetectionOutput"), YOLO),
    **dict.fromkeys(("GRN", "PriorBoxClustered", "ScaleFilter"), OPENVINO),
    "DenseImageData": SEGNET,
}


def has_no_effect(message: str, item: Field) -> bool:
    """Whether a field of the named message is an option of a fork whose value does not change the result."""
    option = OPTIONS.get(message, {}).get(item.name)
    return option is not None and not option.has_effect(item)


def effect_of(message: str, name: str) -> str:
    """What an option of a fork does, for an error message; empty if no fork has it."""
    option = OPTIONS.get(message, {}).get(name)
    return str(option) if option else ""


def type_advice(name: str, known: Iterable[str]) -> str:
    """Advice on an unknown layer type: its fork, or the known type of which it is a misspelling.

    A similar name is often another layer (ReLU6, Deconvolution), so a misspelling has the letters of a known type with
    other capitals, or from six letters on one wrong, missing, additional or exchanged letter.
    """
    if name in FORK_NAMES and name not in known:
        return option_advice(name, ())
    if name in TYPES:
        return f" (a layer of {TYPES[name]} fork of Caffe, which is not supported)"
    letters = _letters(name)
    for meant in known:
        other = _letters(meant)
        same_digits = [c for c in letters if c.isdigit()] == [c for c in other if c.isdigit()]
        if letters == other or (len(letters) >= 6 and same_digits and _differ_by_one(letters, other)):
            return f" (did you mean {meant!r}?)"
    return ""


def _letters(name: str) -> str:
    return name.casefold().replace("_", "").replace("-", "").replace(" ", "")


def _differ_by_one(a: str, b: str) -> bool:
    """Whether two words differ by one wrong, missing or additional letter, or by two exchanged ones."""
    i = next((i for i, (one, other) in enumerate(zip(a, b)) if one != other), min(len(a), len(b)))
    exchanged = a[i : i + 2] == b[i : i + 2][::-1] and a[i + 2 :] == b[i + 2 :]
    return exchanged or a[i + 1 :] in (b[i:], b[i + 1 :]) or a[i:] == b[i + 1 :]


def _same(value: Scalar, harmless: str) -> bool:
    """Whether a value is ``harmless``, which is written as in a prototxt."""
    if harmless.startswith('"'):
        return value.kind == "string" and value.text == harmless.strip('"')
    if harmless in ("true", "false"):
        return value.text in ({"true", "True", "t", "1"} if harmless == "true" else {"false", "False", "f", "0"})
    try:
        return float(value.text.removesuffix("f")) == float(harmless)
    except ValueError:
        return value.text == harmless
