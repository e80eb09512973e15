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


def _names(names: str, harmless: str) -> dict[str, str]:
    return dict.fromkeys(names.split(), harmless)


# Dataclass of a message -> name of an option -> its value without effect
OPTIONS: dict[str, dict[str, str]] = {
    "BatchNormParameter": _names("engine", ANY)
    | _names("scale_bias use_weight_bias bias_term relu", "false")
    | _names("scale_filler bias_filler filler", NONE)
    | _names("stats_batch_size", "0"),
    "ConcatParameter": _names("engine per_fla_fuse", ANY),
    "ConvolutionParameter": _names(
        "cudnn_convolution_algo_seeker conv_algos_override conv_algorithm", ANY
    )
    | _names("negative_slope coeff", ANY)
    | _names("relu", "false")
    | _names("fusion_type", "NONE_FUSION")
    | _names("hole hole_h hole_w", "1"),
    "DataParameter": _names("threads parser_threads precache", ANY)
    | _names("shuffle", "false")
    | _names("side", NONE),
    "DropoutParameter": _names("engine random_seed", ANY),
    "EltwiseParameter": _names("engine", ANY),
    "ELUParameter": _names("lambda", "1"),
    "Filler": _names("scale", "1"),
    "ImageDataParameter": _names("threads cache precache", ANY)
    | _names("short_side min_height min_width", "0")
    | _names("dataset_share_per_node", "1"),
    "InnerProductParameter": _names("engine negative_slope", ANY) | _names("relu", "false"),
    "LayerParameter": _names(
        "forward_type backward_type forward_math backward_math debug cudnn_math_override engine",
        ANY,
    )
    | _names("multinode mn_activation_param mn_grad_compress_param", ANY)
    | _names("quantization_param", NONE),
    "LossParameter": _names("label_smoothing", "0") | _names("pre_fixed_normalizer", ANY),
    "NetParameter": _names(
        "default_forward_type default_backward_type default_forward_math default_backward_math", ANY
    )
    | _names(
        "default_conv_algos_override default_cudnn_math_override reduce_buckets eltwise_mem_sharing",
        ANY,
    )
    | _names("global_grad_scale global_grad_scale_adaptive engine compile_net_state multinode", ANY)
    | _names("bn_stats_batch_size", "0"),
    "PoolingParameter": _names("torch_pooling", "false")
    | _names("avg_include_pad", "true")
    | _names("axis", "1")
    | _names("pad_3d kernel_size_3d stride_3d", NONE),
    "ReLUParameter": _names("fuse", ANY),
    "ReshapeParameter": _names("pixelshuffler", "1"),
    "SolverParameter": _names(
        "ap_version show_per_class_result solver_data_type store_blobs_in_old_format", ANY
    )
    | _names(
        "max_momentum momentum_power weight_decay_power max_weight_decay plateau_winsize engine",
        ANY,
    )
    | _names(
        "larc_policy larc_eta larc_turbo warmup_start_lr local_gw_ratio stagelr stageiter", ANY
    )
    | _names("eval_type", '"classification"')
    | _names("momentum_policy weight_decay_policy", '"fixed"')
    | _names("larc disabled_update local_lr_auto", "false")
    | _names("min_lr test_and_snapshot_last_epochs warmup_iter test_offset", "0"),
    "TransformationParameter": _names(
        "use_gpu_transform forward_packing random_seed display allow_upscale", ANY
    )
    | _names("interpolation_algo_up interpolation_algo_down", ANY)
    | _names(
        "img_rand_resize_lower img_rand_resize_upper rand_resize_ratio_lower rand_resize_ratio_upper",
        "0",
    )
    | _names(
        "vertical_stretch_lower vertical_stretch_upper horizontal_stretch_lower horizontal_stretch_upper",
        "1",
    )
    | _names("num_labels crop_h crop_w pad", "0")
    | _names("flow bgr2rgb", "false")
    | _names("resize_param noise_param distort_param expand_param emit_constraint", NONE)
    | _names("random_resize_param random_aspect_ratio_param", NONE),
}


def has_no_effect(message: str, item: Field) -> bool:
    """Whether a field of the named message is an option of a fork whose value does not
    change the result.
    """
    harmless = OPTIONS.get(message, {}).get(item.name)
    return harmless == ANY or bool(
        harmless and isinstance(item.value, Scalar) and _same(item.value, harmless)
    )


def effect_of(message: str, name: str) -> str:
    """What is wrong with an option of a fork, for an error message; empty if no fork has it."""
    harmless = OPTIONS.get(message, {}).get(name)
    if harmless is None:
        return ""
    return "of a fork of Caffe changes the result; not supported" + (
        f", expected {harmless}" if harmless else ""
    )


def _same(value: Scalar, harmless: str) -> bool:
    """Whether a value is ``harmless``, which is written as in a prototxt."""
    if harmless.startswith('"'):
        return value.kind == "string" and value.text == harmless.strip('"')
    if harmless in ("true", "false"):
        return value.text in (
            {"true", "True", "t", "1"} if harmless == "true" else {"false", "False", "f", "0"}
        )
    try:
        return float(value.text.removesuffix("f")) == float(harmless)
    except ValueError:
        return value.text == harmless
