"""netlib.caffe: calls that are refused, and the line of each error."""

from __future__ import annotations

from io import BytesIO, StringIO

import cv2
import numpy as np
import pytest
from google.protobuf import text_format

import netlib.caffe as caffe
from netlib.caffe import coord_map, draw, io
from netlib.caffe import layers as L
from netlib.caffe import params as P
from netlib.caffe.coord_map import (
    AxisMismatchException,
    CropError,
    UnconnectedError,
    UndefinedMapException,
)
from netlib.caffe.io import ShapeError
from netlib.caffe.net_spec import NotATopError, SpecError, UnknownNameError
from netlib.caffe.proto import caffe_pb2
from netlib.errors import DataError, NetlibError
from netlib.proto.messages import NetParameter
from tests.support.bad_input import bad_inputs

DATA = L.Input(shape={"dim": [1, 1, 64, 64]})
SPEC = caffe.NetSpec()
SPEC.data, SPEC.pair = DATA, L.DummyData(ntop=2)
THREE_PARAMS = 'name: "c" type: "Convolution" param {} param {} param {}'
RESIZE = "resize_image takes an image (H, W, K), a (height, width) and an order from 0 to 5, found an array of shape {}"
UNCONNECTED = "Could not compute map between tops; are they connected by spatial layers?"
RULES = 'layer { name: "relu" type: "ReLU" include { phase: TEST } exclude { phase: TEST } }'


def of(text: str, message: type) -> object:
    return text_format.Parse(text, message())


def option(of_type: str, **options: object):
    """A function that writes a layer with these options."""
    return lambda: getattr(L, of_type)(DATA, **options).to_proto()


def transformer(name: str, *values: object, shape: tuple[int, ...] = (4, 3, 2, 3)):
    """A function that calls a method of a Transformer."""
    made = io.Transformer({"data": shape})
    if len(shape) == 4:
        made.set_transpose("data", (2, 0, 1))
    return lambda: getattr(made, name)(*values)


@bad_inputs(
    ShapeError,
    {
        "a map after one of a later axis": (
            lambda: coord_map.compose((1, 1, 0), (2, 1, 0)),
            AxisMismatchException,
            "a map from axis 1 on cannot follow one from axis 2 on",
        ),
        "crop of another scale": (
            lambda: coord_map.crop(L.Pooling(DATA, kernel_size=2, stride=2), DATA),
            CropError,
            "scale mismatch on crop (a = [2.]): strides and kernels must undo each other",
        ),
        "crop before the top": (
            lambda: coord_map.crop(L.Convolution(DATA, kernel_size=3), DATA),
            CropError,
            "cannot crop negative offset (b = [1.]): the top to be cropped is too small",
        ),
        "crop between pixels": (
            lambda: coord_map.crop(L.Convolution(DATA, kernel_size=2, pad=1), DATA),
            CropError,
            "cannot crop noninteger offset (b = [-0.5])",
        ),
        "from InnerProduct": (
            lambda: coord_map.coord_map_from_to(L.InnerProduct(DATA, num_output=1), DATA),
            UnconnectedError,
            UNCONNECTED,
        ),
        "map of InnerProduct": (
            lambda: coord_map.coord_map(L.InnerProduct(DATA, num_output=1).fn),
            UndefinedMapException,
            "layers of type 'InnerProduct' have no coordinate map",
        ),
        "map of global pooling": (
            lambda: coord_map.coord_map(L.Pooling(DATA, global_pooling=True).fn),
            UndefinedMapException,
            "a Pooling layer without kernel_size has no coordinate map",
        ),
        "map of pad_w": (
            lambda: coord_map.coord_map(L.Convolution(DATA, kernel_size=3, pad_w=1).fn),
            CropError,
            "a Convolution layer has pad_w: cropping does not support legacy _h/_w params; write ...",
        ),
        "rate of ReLU": (
            lambda: draw.get_layer_lr_mult(of('type: "ReLU"', caffe_pb2.LayerParameter)),
            draw.RuleError,
            "ReLU layers do not have a learning rate multiplier",
        ),
        "three params": (
            lambda: draw.get_layer_lr_mult(of(THREE_PARAMS, caffe_pb2.LayerParameter)),
            draw.RuleError,
            "layer 'c': expected at most two params, weights and biases, found 3",
        ),
        "BlobProto without shape": (
            lambda: io.blobproto_to_array(caffe_pb2.BlobProto(data=[7, 8])),
            "a BlobProto has shape (), but 2 values",
        ),
        "BlobProto of a negative size": (
            lambda: io.blobproto_to_array(caffe_pb2.BlobProto(data=[7, 8], shape={"dim": [-1]})),
            "a BlobProto has shape (-1,), but 2 values",
        ),
        "Datum of two axes": (
            lambda: io.array_to_datum(np.zeros((2, 2))),
            "Incorrect array shape: a Datum takes (channels, height, width), found (2, 2)",
        ),
        "Datum without shape": (
            lambda: io.datum_to_array(caffe_pb2.Datum(data=b"ab")),
            "a Datum has shape (0, 0, 0), but 2 values",
        ),
        "encoded Datum": (
            lambda: io.datum_to_array(caffe_pb2.Datum(data=b"ab", encoded=True)),
            "the Datum holds an encoded image; decode its data, for example with OpenCV",
        ),
        "Transformer: another name": (
            transformer("preprocess", "dat", np.zeros((2, 3, 3))),
            NetlibError,
            "'dat' is not one of the net inputs: 'data' (did you mean 'data'?)",
        ),
        "Transformer: an image without channels": (
            transformer("preprocess", "data", np.zeros((2, 3))),
            "preprocess takes an image (H, W, 3) for 'data', found (2, 3)",
        ),
        "Transformer: transpose": (
            transformer("set_transpose", "data", (0, 1)),
            "Transpose order needs to have the same "
            "number of dimensions as the input: 'data' takes each of 0, 1, 2 once, found (0, 1)",
        ),
        "Transformer: swap": (
            transformer("set_channel_swap", "data", (3, 2, 1)),
            "Channel swap needs to have the same "
            "number of dimensions as the input channels: 'data' has 0, 1, 2, found (3, 2, 1)",
        ),
        "Transformer: mean": (
            transformer("set_mean", "data", np.zeros((2, 4, 4))),
            "Mean channels incompatible with input: 'data' has 3, found a mean of shape (2, 4, 4)",
        ),
        "Transformer: the name of a file as mean": (
            transformer("set_mean", "data", "mean.npy"),
            "Mean shape invalid: expected (K,), (H, W) or (K, H, W), found ()",
        ),
        "Transformer: a batch": (
            transformer("deprocess", "data", np.zeros((4, 3, 2, 3))),
            "deprocess takes one item of 'data', found an array of shape (4, 3, 2, 3)",
        ),
        "Transformer: two axes": (
            transformer("preprocess", "data", np.zeros((2, 3, 3)), shape=(1, 5)),
            "preprocess needs an input (N, K, H, W), but 'data' has shape (1, 5)",
        ),
        "resize: order 7": (
            lambda: io.resize_image(np.zeros((4, 4, 3)), (2, 2), interp_order=7),
            RESIZE.format("(4, 4, 3), (2, 2) and 7"),
        ),
        **{
            f"resize: {shape} to {size}": (
                lambda shape=shape, size=size: io.resize_image(np.zeros(shape), size),
                RESIZE.format(f"{shape}, {size} and 1"),
            )
            for shape, size in (((4, 4), (2, 2)), ((4, 4, 3), (0, 2)))
        },
        "oversample: too large": (
            lambda: io.oversample([np.zeros((4, 4, 1))], (5, 2)),
            "oversample cannot crop (5, 2) from an image of shape (4, 4, 1)",
        ),
        "oversample: two sizes": (
            lambda: io.oversample([np.zeros((4, 4, 1)), np.zeros((4, 5, 1))], (2, 2)),
            "oversample takes at least one image, all of the same shape, found (4, 4, 1) and (4, 5, 1)",
        ),
        "oversample: none": (
            lambda: io.oversample([], (2, 2)),
            "oversample takes at least one image, all of the same shape, found none",
        ),
        "option misspelt": (
            option("Convolution", kernal_size=3),
            SpecError,
            "layer 'Convolution1' (Convolution): unknown option 'kernal_size' (did you mean 'kernel_size'?)",
        ),
        "option unknown": (
            option("ReLU", zzz=1),
            SpecError,
            "...unknown option 'zzz'; its options: negative_slope, ...",
        ),
        "option of another block": (
            option("Deconvolution", num_output=1),
            SpecError,
            "...(Deconvolution): option 'num_output' is in another block; write convolution_param=dict(num_output=...)",
        ),
        "option of the loss": (
            option("SoftmaxWithLoss", ignore_label=1),
            SpecError,
            "...write loss_param=dict(ignore_label=...)",
        ),
        "option unknown in two blocks": (
            option("SoftmaxWithLoss", zzz=1),
            SpecError,
            "...; its options: softmax_param=dict(...), loss_param=dict(...)",
        ),
        "option where there are none": (
            option("Silence", zzz=1),
            SpecError,
            "...: unknown option 'zzz'; it has none",
        ),
        "option of a filler": (
            option("Convolution", weight_filler={"tipe": "xavier"}),
            SpecError,
            "...FillerParameter has no field 'tipe' (did you mean 'type'?)",
        ),
        "block": (
            option("Convolution", convolutoin_param={}),
            SpecError,
            "...(did you mean 'convolution_param'?)",
        ),
        **{
            f"{name} {value}": (
                option(layer, **{name: value}),
                SpecError,
                f"...'{name}' of {layer}Parameter cannot be {value!r}...",
            )
            for layer, name, value in (
                ("Convolution", "num_output", "many"),
                ("Convolution", "num_output", [1, 2]),
                ("Convolution", "weight_filler", "xavier"),
                ("Pooling", "pool", 9),
            )
        },
        "tops as a bottom": (
            lambda: L.Silence(L.DummyData(ntop=2), ntop=0),
            NotATopError,
            "Silence input 0 is not a Top (type is <class 'tuple'>)",
        ),
        "one name for two tops": (
            SPEC.to_proto,
            NotATopError,
            "'pair' of the net is not a Top (type is <class 'tuple'>); "
            "unpack a layer with several tops: n.data, n.label = L.HDF5Data(..., ntop=2)",
        ),
        "top unknown": (
            lambda: SPEC.dat,
            UnknownNameError,
            "this net has no top 'dat' (did you mean 'data'?)",
        ),
        "params unknown": (
            lambda: P.Poling.MAX,
            UnknownNameError,
            "params has no 'Poling' (did you mean 'Pooling'?)",
        ),
        "value unknown": (
            lambda: P.Pooling.MEAN,
            UnknownNameError,
            "params.Pooling has no 'MEAN'; it has MAX, AVE, STOCHASTIC, ...",
        ),
    },
)
def test_invalid_calls_are_rejected(given, rejected):
    with rejected:
        given()


PHASE = (
    "{} was removed from pycaffe in 2014: give the phase when the net is made: "
    "caffe.Net(file, caffe.{}, weights=weights)"
)


@bad_inputs(
    AttributeError,
    {
        "set_phase_test": PHASE.format("set_phase_test", "TEST"),
        "set_phase_train": PHASE.format("set_phase_train", "TRAIN"),
        "set_mode_cpu": "...: it is a function of the module: caffe.set_mode_cpu",
        "set_mean": "set_mean was removed ... caffe.io.Transformer...then t.set_mean; ...",
        "preprocess": "...then t.preprocess; a caffe.Classifier has one, net.transformer",
        "blob": "'Net' object has no attribute 'blob'",
    },
)
def test_what_pycaffe_had_in_2014_is_an_error_with_advice(given, rejected):
    net = caffe.Net(NetParameter(), caffe.TEST)
    assert not hasattr(net, given)
    with rejected:
        getattr(net, given)


@bad_inputs(
    AttributeError,
    {
        "set_phase_test": PHASE.format("set_phase_test", "TEST"),
        "set_phase": "module 'netlib.caffe' has no attribute 'set_phase'",
    },
)
def test_what_the_module_had_in_2014_is_an_error_with_advice(given, rejected):
    with rejected:
        getattr(caffe, given)


@bad_inputs(
    TypeError,
    {
        "gpu": "Classifier(..., gpu=...): remove it, this runs on the CPU",
        "mean_file": "Classifier(..., mean_file=...): give the array: mean=numpy.load(file); "
        "what input_scale was then is raw_scale",
        "means": "Classifier(..., means=...): it has no such option",
    },
)
def test_unknown_options_of_a_classifier_are_rejected(given, rejected):
    with rejected:
        caffe.Classifier("net.prototxt", "net.caffemodel", **{given: None})


def test_classes_of_errors():
    """The errors are of this project's class, and of the classes that scripts for pycaffe catch."""
    assert all(
        issubclass(cls, NetlibError)
        for cls in (AxisMismatchException, UnconnectedError, UndefinedMapException)
    )
    assert issubclass(NetlibError, RuntimeError)
    assert issubclass(ShapeError, ValueError)
    assert issubclass(draw.RuleError, ValueError)
    assert issubclass(CropError, AssertionError)
    assert issubclass(NotATopError, TypeError)
    assert issubclass(UnknownNameError, AttributeError)
    assert issubclass(UnknownNameError, KeyError)


@pytest.mark.parametrize(
    ("option", "error"), [({"zzz": 1}, AttributeError), ({"num_output": {}}, TypeError)]
)
def test_classes_of_wrong_options(option, error):
    """An unknown option is an AttributeError, a value of another type a TypeError,
    as in pycaffe.
    """
    with pytest.raises(error):
        L.Convolution(DATA, **option).to_proto()


@bad_inputs(
    DataError,
    {
        "missing": ("none.png", "...none.png: cannot read the image: No such file..."),
        "empty": ("empty.png", "...empty.png: not an image that OpenCV can decode (0 bytes)"),
        "a text": ("text.png", "...text.png: not an image that OpenCV can decode (5 bytes)"),
        "signed": (
            "a.tiff",
            "...a.tiff: image of type int16; expected 8 or 16 bits unsigned, or floats",
        ),
        "open text": (
            StringIO("hello"),
            "load_image got a file opened as text; expected one opened for bytes, or io.BytesIO",
        ),
        "open bytes": (
            BytesIO(b"hello"),
            "the image: not an image that OpenCV can decode (5 bytes)",
        ),
    },
)
def test_invalid_images_are_rejected(tmp_path, given, rejected):
    (tmp_path / "empty.png").touch()
    (tmp_path / "text.png").write_text("hello")
    assert cv2.imwrite(str(tmp_path / "a.tiff"), np.zeros((2, 2), np.int16))
    with rejected:
        io.load_image(tmp_path / given if isinstance(given, str) else given)


@bad_inputs(
    NetlibError,
    {
        "no pydot": (
            ("pydot", "net.png"),
            "pydot is missing: pip install pydot; pictures also need Graphviz ...",
        ),
        "no Graphviz": (
            ("dot", "net.png"),
            "Graphviz's program dot is missing: install Graphviz (apt install ...",
        ),
        "no suffix": (
            ("", "net"),
            "...net: no suffix; expected one that names the format: .png, .svg, .pdf ...",
        ),
        "no folder": (
            ("", "none/net.raw"),
            "...none/net.raw: cannot write the image: No such file...",
        ),
        "two rules": (
            ("rules", "net.raw"),
            draw.RuleError,
            "layer 'relu' has both include and exclude specified.",
        ),
    },
)
def test_drawings_without_their_programs_are_rejected(tmp_path, monkeypatch, given, rejected):
    missing, name = given
    if missing == "pydot":
        monkeypatch.setitem(__import__("sys").modules, "pydot", None)
    else:
        pytest.importorskip("pydot")
        monkeypatch.setattr("shutil.which", lambda name: None)
    with rejected:
        draw.draw_net_to_file(
            of(RULES if missing == "rules" else "", caffe_pb2.NetParameter),
            tmp_path / name,
            phase=caffe.TEST,
        )
