"""Options of popular forks of Caffe that this project does not have; fork_types.py has
their layer types.

An option that only selects an implementation (an algorithm, a precision, a number of threads), or
whose value has no effect, is accepted and ignored. Any other is an error. Options whose layers are
implemented are declared with them, in the files of layers/. Sources: caffe.proto of NVIDIA's,
Intel's, SSD's and DeepLab's forks.
"""

from __future__ import annotations

from netlib.proto.prototxt import Field, Scalar

ANY = "any"  # all values only select an implementation, or have no effect without another option
NONE = ""  # every value changes the result
ENGINES = ("MKL2017", "MKLDNN")  # Intel's values of ``engine``

# Dataclass of a message -> values without effect -> the options that have this one
_BY_VALUE = {
    "BatchNormParameter": {
        ANY: "engine",
        "false": "scale_bias use_weight_bias bias_term relu",
        NONE: "scale_filler bias_filler filler",
        "0": "stats_batch_size",
    },
    "ConcatParameter": {ANY: "engine per_fla_fuse"},
    "ConvolutionParameter": {
        ANY: (
            "cudnn_convolution_algo_seeker conv_algos_override conv_algorithm negative_slope coeff"
        ),
        "false": "relu",
        "NONE_FUSION": "fusion_type",
        "1": "hole hole_h hole_w",
    },
    "DataParameter": {ANY: "threads parser_threads precache", "false": "shuffle", NONE: "side"},
    "DropoutParameter": {ANY: "engine random_seed"},
    "EltwiseParameter": {ANY: "engine"},
    "ELUParameter": {"1": "lambda"},
    "Filler": {"1": "scale"},
    "ImageDataParameter": {
        ANY: "threads cache precache",
        "0": "short_side min_height min_width",
        "1": "dataset_share_per_node",
    },
    "InnerProductParameter": {ANY: "engine negative_slope", "false": "relu"},
    "LayerParameter": {
        ANY: (
            "forward_type backward_type forward_math backward_math debug cudnn_math_override "
            "engine multinode mn_activation_param mn_grad_compress_param"
        ),
        NONE: "quantization_param",
    },
    "LossParameter": {"0": "label_smoothing", ANY: "pre_fixed_normalizer"},
    "NetParameter": {
        ANY: (
            "default_forward_type default_backward_type default_forward_math "
            "default_backward_math default_conv_algos_override default_cudnn_math_override "
            "reduce_buckets eltwise_mem_sharing global_grad_scale global_grad_scale_adaptive "
            "engine compile_net_state multinode"
        ),
        "0": "bn_stats_batch_size",
    },
    "PoolingParameter": {
        "false": "torch_pooling",
        "true": "avg_include_pad",
        "1": "axis",
        NONE: "pad_3d kernel_size_3d stride_3d",
    },
    "ReLUParameter": {ANY: "fuse"},
    "ReshapeParameter": {"1": "pixelshuffler"},
    "SolverParameter": {
        ANY: (
            "ap_version show_per_class_result solver_data_type store_blobs_in_old_format "
            "max_momentum momentum_power weight_decay_power max_weight_decay plateau_winsize "
            "engine larc_policy larc_eta larc_turbo warmup_start_lr local_gw_ratio stagelr "
            "stageiter"
        ),
        '"classification"': "eval_type",
        '"fixed"': "momentum_policy weight_decay_policy",
        "false": "larc disabled_update local_lr_auto",
        "0": "min_lr test_and_snapshot_last_epochs warmup_iter test_offset",
    },
    "TransformationParameter": {
        ANY: (
            "use_gpu_transform forward_packing random_seed display allow_upscale "
            "interpolation_algo_up interpolation_algo_down"
        ),
        "0": (
            "img_rand_resize_lower img_rand_resize_upper rand_resize_ratio_lower "
            "rand_resize_ratio_upper num_labels crop_h crop_w pad"
        ),
        "1": (
            "vertical_stretch_lower vertical_stretch_upper horizontal_stretch_lower "
            "horizontal_stretch_upper"
        ),
        "false": "flow bgr2rgb",
        NONE: (
            "resize_param noise_param distort_param expand_param emit_constraint "
            "random_resize_param random_aspect_ratio_param"
        ),
    },
}
# Dataclass of a message -> name of an option -> its value without effect
OPTIONS = {
    message: {name: value for value, names in values.items() for name in names.split()}
    for message, values in _BY_VALUE.items()
}


def has_no_effect(message: str, item: Field) -> bool:
    """Whether a field of the named message is an option of a fork whose value does not
    change the result.
    """
    harmless = OPTIONS.get(message, {}).get(item.name, NONE)
    if harmless in (ANY, NONE):
        return harmless == ANY
    return isinstance(item.value, Scalar) and _same(item.value, harmless)


def effect_of(message: str, name: str) -> str:
    """What is wrong with an option of a fork, for an error message; empty if no fork has it."""
    harmless = OPTIONS.get(message, {}).get(name)
    if harmless is None:
        return ""
    expected = f", expected {harmless}" if harmless else ""
    return f"of a fork of Caffe changes the result; not supported{expected}"


def _same(value: Scalar, harmless: str) -> bool:
    """Whether a value is ``harmless``, which is written as in a prototxt."""
    if harmless.startswith('"'):
        return value.kind == "string" and value.text == harmless.strip('"')
    if harmless in ("true", "false"):
        return value.truth() is (harmless == "true")
    try:
        return float(value.text.removesuffix("f")) == float(harmless)
    except ValueError:
        return value.text == harmless
