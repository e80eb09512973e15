"""Readers: functions that write small good files to the working directory, and functions
that read them.

Databases, recordings, tracks, models and data sets of hands are damaged in their own tests.
"""

from __future__ import annotations

import contextlib
import hashlib
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import h5py
import numpy as np

import netlib
from handpose.synthetic import prior_file
from layers.hand import skeleton
from netlib.caffe.io import load_image
from netlib.errors import NetlibError
from netlib.proto import prototxt, wire
from netlib.proto.upgrade import AnyNetParameter
from netlib.snapshots import snapshot
from tests.support.caffe_messages import write_blob
from tests.support.hdf5_files import write_hdf5
from tests.support.layer_cases import CASES
from tests.support.nets import inputs, ip
from tests.support.running import ROOT, run_tool

HANDS = ROOT / "prototxt" / "hand"
RECORDED = ROOT / "tests" / "caffe" / "solvers"


class Reader(NamedTuple):
    """A row of the table.

    make   writes good files; returns the names of those that are damaged
    read   reads with one of them damaged; returns the content. Raises NetlibError
    exact  whether a checksum detects every change of the content
    """

    name: str
    make: Callable[[], list[str]]
    read: Callable[[Path], Any]
    exact: bool = False


def write(name: str, text: str) -> str:
    Path(name).write_text(text, encoding="utf-8")
    return name


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def digest(value: Any) -> str:
    """Digest of a value made of arrays, numbers and texts; equal values have equal digests."""
    if isinstance(value, dict):
        value = [(key, value[key]) for key in sorted(value, key=str)]
    if isinstance(value, (list, tuple)):
        content = " ".join(map(digest, value)).encode()
    elif isinstance(value, np.ndarray):
        content = f"{value.dtype} {value.shape}".encode() + value.tobytes()
    else:
        content = repr(value).encode()
    return hashlib.sha256(content).hexdigest()


@contextlib.contextmanager
def unchanged_if_refused(content: Callable[[], Any]) -> Iterator[None]:
    before = digest(content())
    try:
        yield
    except NetlibError:
        assert digest(content()) == before, "refused, but changed"
        raise


# -------------------------------------------------------------------------------------------- nets

OLD_NET = """name: "old" input: "x" input_dim: 2 input_dim: 3 input_dim: 4 input_dim: 4
layers { name: "c" type: CONVOLUTION bottom: "x" top: "c" blobs_lr: 1 blobs_lr: 2 weight_decay: 1 weight_decay: 0
         convolution_param { num_output: 2 kernel_size: 3 } }
layers { name: "i" type: INNER_PRODUCT bottom: "c" top: "i" inner_product_param { num_output: 2 } BLOBS }
"""
BLOBS = f"blobs {{ num: 1 channels: 1 height: 2 width: 8 {'data: 0.5 ' * 16} }}"
PRODUCT = inputs(data=(1, 3, 4, 5)) + ip("p", "data", "y")


def make_nets() -> list[str]:
    """Write a net of every layer type that needs no file, and some larger nets."""
    ssd = text_of(ROOT / "tests/layers/detection/small_ssd.prototxt")
    texts = {"old": OLD_NET.replace("BLOBS", ""), "ssd": ssd}
    for kind, case in CASES.items():
        if kind != "DetectionOutput":  # needs prior boxes, as in small_ssd
            texts[kind] = case.net_text(case.bottoms(2))
    return [write(f"{name}.prototxt", text) for name, text in texts.items()]


def run_once(path: Path) -> None:
    net = netlib.Net(path, netlib.TRAIN, seed=1)
    net.run_forward()
    net.run_backward()


# --------------------------------------------------------------------------------------- trainings

WEIGHTS = ["old.caffemodel", "caffe.caffemodel", "net.caffemodel.h5", "net.caffemodel"]


def make_training() -> list[str]:
    """Write the files of a training, in which state and weights of iteration 5 are of an
    earlier version.
    """
    earlier = ROOT / "tests" / "netlib" / "older"
    for file in [*earlier.iterdir(), *RECORDED.glob("train?.h5")]:
        shutil.copy(file, file.name)
    return ["solver.prototxt", "net.prototxt", write("list.txt", "train0.h5\ntrain1.h5\n")]


def solver_of(**changes: object) -> netlib.Solver:
    """A solver that writes no snapshots: their paths may be damaged."""
    options = {"snapshot": 0, "snapshot_after_train": False} | changes
    return netlib.get_solver("solver.prototxt", **options)


def read_solver(path: Path) -> None:
    """Build a solver and make two steps if they are short."""
    solver = solver_of()
    if max([solver.param.iter_size, *solver.param.test_iter]) <= 1000:
        solver.step(2)


def make_weights() -> list[str]:
    """Write weights of a net of 2014, of Caffe itself, and of this project in both formats."""
    make_training()
    tree = prototxt.parse(OLD_NET.replace("BLOBS", BLOBS))
    Path("old.caffemodel").write_bytes(wire.encode(tree, AnyNetParameter))
    shutil.copy(RECORDED / "init.caffemodel", "caffe.caffemodel")
    for name in ("net.caffemodel.h5", "net.caffemodel"):
        netlib.Net("net.prototxt", netlib.TRAIN, seed=2).save(name)
    return WEIGHTS


def read_weights(path: Path) -> None:
    """Copy weights to a net, which must not change if they are rejected."""
    if not path.name.startswith("net."):
        snapshot.read_weights(path)
        return
    net = netlib.Net("net.prototxt", netlib.TEST, seed=1)
    with unchanged_if_refused(lambda: values(net)):
        net.copy_from(path)


def values(net: netlib.Net) -> list[Any]:
    return [param.blob.data for param in net.learnable]


def make_states() -> list[str]:
    """Write snapshots of two iterations in both formats."""
    make_training()
    for layout in ("HDF5", "BINARYPROTO"):
        netlib.get_solver("solver.prototxt", max_iter=2, snapshot_format=layout).solve()
    kinds = "solverstate.h5", "caffemodel.h5", "solverstate", "caffemodel"
    return [f"older_iter_2.{kind}" for kind in kinds]


def make_earlier_states() -> list[str]:
    make_training()
    return ["older_iter_5.solverstate.h5", "older_iter_5.caffemodel.h5"]


def read_state(path: Path) -> Any:
    """Resume and train on; a solver that rejects the state must not change."""
    solver = solver_of(seed=99)

    def content() -> list[Any]:
        training = [solver.iter, solver.history, list(solver.smoothed)]
        return [*training, values(solver.net), solver.net.layer_states()]

    with unchanged_if_refused(content):
        solver.restore(str(path).replace("caffemodel", "solverstate"))
    solver.step(2)
    return content()


# -------------------------------------------------------------------------------------------- data

HAND = (
    inputs(x=(2, 47))
    + """layer { name: "h" type: "HandModel" bottom: "x" top: "y"
    hand_model_param { skeleton: "hand.prototxt" } }"""
)
DATA = """layer { name: "d" type: "HDF5Data" top: "data" top: "label"
    hdf5_data_param { source: "list.txt" batch_size: 6 } }"""
IMAGES = """layer { name: "d" type: "ImageData" top: "data" top: "label"
    transform_param { mean_file: "mean.binaryproto" crop_size: 8 }
    image_data_param { source: "list.txt" batch_size: 5 } }"""
PICTURES = {  # name -> shape
    "a.png": (12, 16, 3),
    "b.jpg": (12, 16, 3),
    "c.png": (12, 16),
    "d.bmp": (12, 16, 3),
    "e.png": (12, 16, 4),
}


def make_skeleton() -> list[str]:
    write("net.prototxt", HAND)
    prior = text_of(HANDS / "nyu_prior.prototxt").replace("nyu.prototxt", "hand.prototxt")
    hand = text_of(HANDS / "nyu.prototxt")
    return [write("hand.prototxt", hand), write("prior.prototxt", prior)]


def read_skeleton(path: Path) -> None:
    found = skeleton.load(Path("hand.prototxt"))
    if found.param.flesh is not None:
        found.with_surface()
    run_once(Path("net.prototxt"))
    prior_file.load(Path("prior.prototxt"))


def make_hdf5() -> list[str]:
    """Write contiguous rows, rows in compressed chunks and rows behind a link, and the
    list of the files.
    """
    write("net.prototxt", DATA)
    rows = np.random.default_rng(4).uniform(-0.9, 0.9, (5, 2, 3)).astype("f4")
    write_hdf5("a.h5", data=rows, label=np.zeros(5, "f4"))
    packed: dict[str, Any] = {"chunks": (8, 2, 3), "compression": "gzip", "shuffle": True}
    with h5py.File("b.h5", "w") as file:
        file.create_dataset("data", data=np.ones((40, 2, 3), "f4"), **packed)
        file.create_dataset("label", data=np.arange(40), maxshape=(None,))
    with h5py.File("c.h5", "w", libver="latest") as file:
        file["group/deep"] = np.zeros((3, 2, 3), np.float16)
        file["data"], file["label"] = h5py.SoftLink("/group/deep"), np.zeros(3)
        file.attrs["made_from"] = "a text that is not of a fixed length"
    return ["a.h5", "b.h5", "c.h5", write("list.txt", "a.h5\nb.h5\nc.h5\n")]


def make_pictures() -> list[str]:
    for name, shape in PICTURES.items():
        noise = np.random.default_rng(0).integers(0, 255, shape, np.uint8)
        assert cv2.imwrite(name, cv2.blur(noise, (5, 5)))
    write_blob(Path("mean.binaryproto"), np.full((1, 3, 12, 16), 100, np.float32))
    write("net.prototxt", IMAGES)
    lines = "".join(f"{name} {i}\n" for i, name in enumerate(PICTURES))
    return [*PICTURES, write("list.txt", lines), "mean.binaryproto"]


def read_batches(path: Path) -> None:
    net = netlib.Net("net.prototxt", netlib.TRAIN, seed=1)
    for _ in range(3):
        net.run_forward()


def read_pictures(path: Path) -> None:
    """Read pictures and their list with the layer, with caffe.io and with
    tools/compute_image_mean.py.
    """
    read_batches(path)
    if path.name in PICTURES:
        load_image(path)
    done = run_tool("compute_image_mean list.txt -resize_width=4 -resize_height=4", status=None)
    if done.status:
        raise NetlibError(done.err.splitlines()[-1])


READERS = (
    Reader("net", make_nets, run_once),
    Reader("solver", make_training, read_solver),
    Reader("skeleton", make_skeleton, read_skeleton),
    Reader("weights", make_weights, read_weights),
    Reader("state", make_states, read_state, exact=True),
    Reader("state of an earlier version", make_earlier_states, read_state),
    Reader("HDF5 data", make_hdf5, read_batches),
    Reader("pictures", make_pictures, read_pictures),
)
