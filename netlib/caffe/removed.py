"""Names that pycaffe had in 2014 and has no more, with what to write instead."""

from collections.abc import Mapping

_TRANSFORMER = (
    "preprocessing is caffe.io.Transformer's: "
    "t = caffe.io.Transformer({'data': net.blobs['data'].data.shape}), then t.%s; "
    "a caffe.Classifier has one, net.transformer"
)
_PHASE = "give the phase when the net is made: caffe.Net(file, caffe.%s, weights=weights)"

_OF_MODULE = "set_mode_cpu", "set_mode_gpu", "set_device"
_OF_TRANSFORMER = (
    "set_mean",
    "set_channel_swap",
    "set_raw_scale",
    "set_input_scale",
    "preprocess",
    "deprocess",
    "mean",
    "channel_swap",
    "raw_scale",
    "input_scale",
)

MODULE = {"set_phase_test": _PHASE % "TEST", "set_phase_train": _PHASE % "TRAIN"}
NET = dict(MODULE)
NET |= {name: f"it is a function of the module: caffe.{name}" for name in _OF_MODULE}
NET |= {name: _TRANSFORMER % name for name in _OF_TRANSFORMER}
CLASSIFIER = {
    "gpu": "remove it, this runs on the CPU",
    "mean_file": "give the array: mean=numpy.load(file); what input_scale was then is raw_scale",
}


def error(owner: object, described: str, name: str, advice: Mapping[str, str]) -> AttributeError:
    """The error of a missing attribute, with the advice if there is any."""
    if name in advice:
        return AttributeError(f"{name} was removed from pycaffe in 2014: {advice[name]}")
    return AttributeError(f"{described} has no attribute {name!r}", name=name, obj=owner)
