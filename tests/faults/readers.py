"""All readers: their files, the modules that open them, and whether a wrong result can be detected.

A case damages one of the good files of a reader and reads it. The reader must fail with a one-line error that names the
file or the fault, or read the file. If a checksum protects the content (``exact``), the result must then be the content
that was written.

``READERS`` is the table. tests/faults/test_campaign_is_complete.py compares it with the sources and fails for a module
that opens a file but is in no row.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import itertools
import math
import os
import random
import re
import shutil
import struct
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import netlib  # before NumPy: it chooses the BLAS threads

# isort: split

import cv2
import h5py
import numpy as np

from netlib.errors import NetlibError
from tests.faults import mutations
from tests.faults.isolation import ROOT, BrokenPromise, Outcome
from tests.support.nets import inputs

sys.path.append(str(ROOT / "tests" / "support"))

RECORDED = ROOT / "tests" / "caffe"
TEXT_SUFFIXES = (".prototxt", ".txt", ".log", ".md", ".pbtxt", ".json", ".jsonl")


@dataclass(frozen=True)
class Reader:
    """A row of the table.

    name     name of the reader
    modules  the files of this project that open its files; empty for a reader of bytes
    make     writes good files to the working directory; returns those that will be damaged
    read     reads with one of them damaged; returns the content. Raises NetlibError
    exact    whether a checksum detects all changes of the content
    """

    name: str
    modules: tuple[str, ...]
    make: Callable[[], list[str]]
    read: Callable[[Path], Any]
    exact: bool = False


# ---------------------------------------------------------------------------------------------- a case


def case(name: str, seed: int, number: int) -> Outcome:
    """Damage a file of a reader, and read it."""
    reader, good, expected = _prepared(name)
    rng = random.Random(f"{name} {seed} {number}")
    path = Path(rng.choice(good.files))
    donor = good.contents[rng.choice(good.files)]
    content, how = mutations.damaged(good.contents[str(path)], donor, rng, path.suffix in TEXT_SUFFIXES)
    with _copied(good.folder):
        path.write_bytes(content)
        with warnings.catch_warnings(record=True) as warned:
            warnings.simplefilter("always")
            try:
                found = digest(reader.read(path))
            except NetlibError as error:
                outcome = judged(error, path)
            else:
                same = not reader.exact or found in expected or content in good.contents.values()
                outcome = Outcome("read") if same else Outcome("SILENT", f"{path}: read, but not as it was written")
    if warned and not outcome.failed:
        where = f"{Path(warned[0].filename).name}:{warned[0].lineno}"
        outcome = Outcome("WARNING", f"{where}: {warned[0].message} (then {outcome.kind})")
    return Outcome(outcome.kind, f"{outcome.detail} [{how}]") if outcome.failed else outcome


# The error may be about a file that the damaged one names, or about a layer that runs.
_ELSEWHERE = re.compile(r": cannot (read|open|use)|^db: entry |^layer '|layer '.*'|^\S+\.(h5|txt|prototxt|png|jpg):")


def judged(error: NetlibError, path: Path) -> Outcome:
    """Check that an error is one printable line that names the file or the layer."""
    line = str(error)
    if not line.isprintable():
        return Outcome("UNCLEAR", f"not one line that can be printed: {line[:200]!r}")
    if len(line) > 2000:
        return Outcome("UNCLEAR", f"{len(line)} characters long: {line[:100]!r}")
    if not any(name in line for name in {path.name, *path.parts[:-1]}) and not _ELSEWHERE.search(line):
        return Outcome("UNCLEAR", f"does not name {path}: {line[:200]!r}")
    return Outcome("refused", line)


@dataclass(frozen=True)
class _Good:
    folder: Path
    files: list[str]
    contents: dict[str, bytes]


@functools.cache
def _prepared(name: str) -> tuple[Reader, _Good, set[str]]:
    """Return a reader with its good files and the digests of their content; once per process."""
    reader = next(reader for reader in READERS if reader.name == name)
    folder = Path(f"good.{name.replace(' ', '_')}").resolve()
    folder.mkdir(exist_ok=True)
    with _inside(folder):
        files = reader.make()
        contents = {file: Path(file).read_bytes() for file in files}
    expected = set()
    for file in files:
        with _copied(folder), warnings.catch_warnings():
            warnings.simplefilter("ignore")
            expected.add(digest(reader.read(Path(file))))
    return reader, _Good(folder, files, contents), expected


_numbers = itertools.count()


@contextlib.contextmanager
def _copied(folder: Path) -> Iterator[None]:
    """Context manager that makes a copy of the folder the working directory, with a new name because of caches."""
    copy = folder.parent / f"case{next(_numbers)}"
    shutil.copytree(folder, copy)
    try:
        with _inside(copy):
            yield
    finally:
        shutil.rmtree(copy, ignore_errors=True)


@contextlib.contextmanager
def _inside(folder: Path) -> Iterator[None]:
    before = Path.cwd()
    os.chdir(folder)
    try:
        yield
    finally:
        os.chdir(before)


def digest(value: Any) -> str:
    """Digest of a value made of arrays, numbers and texts; equal values have equal digests."""
    found = hashlib.sha256()

    def add(item: Any) -> None:
        if isinstance(item, np.ndarray):
            found.update(f"{item.dtype} {item.shape}".encode() + np.ascontiguousarray(item).tobytes())
        elif isinstance(item, dict):
            for key in sorted(item, key=str):
                found.update(repr(key).encode())
                add(item[key])
        elif isinstance(item, (list, tuple)):
            found.update(f"{len(item)} items".encode())
            for one in item:
                add(one)
        else:
            found.update(repr(item).encode())

    add(value)
    return found.hexdigest()


# ---------------------------------------------------------------------------------------------- nets and solvers

NET = """name: "small"
layer { name: "data" type: "HDF5Data" top: "data" top: "label" include { phase: TRAIN }
        hdf5_data_param { source: "list.txt" batch_size: 3 shuffle: true } }
layer { name: "data" type: "HDF5Data" top: "data" top: "label" include { phase: TEST }
        hdf5_data_param { source: "list.txt" batch_size: 3 } }
layer { name: "a" type: "InnerProduct" bottom: "data" top: "a" param { lr_mult: 1 } param { lr_mult: 2 decay_mult: 0 }
        inner_product_param { num_output: 4 weight_filler { type: "xavier" } } }
layer { name: "drop" type: "Dropout" bottom: "a" top: "a" dropout_param { dropout_ratio: 0.3 } }
layer { name: "relu" type: "ReLU" bottom: "a" top: "a" }
layer { name: "b/x" type: "InnerProduct" bottom: "a" top: "b"
        inner_product_param { num_output: 2 weight_filler { type: "gaussian" std: 0.1 } } }
layer { name: "loss" type: "EuclideanLoss" bottom: "b" bottom: "label" top: "loss" }
"""
SOLVER = """net: "net.prototxt" base_lr: 0.05 momentum: 0.9 weight_decay: 0.001
lr_policy: "step" gamma: 0.5 stepsize: 2 max_iter: 6 average_loss: 2
test_iter: 4 test_interval: 2 test_initialization: true
snapshot: 2 snapshot_prefix: "s" snapshot_format: FORMAT random_seed: 3
"""
VISION = """name: "vision" input: "data" input_shape { dim: 2 dim: 3 dim: 9 dim: 11 }
layer { name: "c" type: "Convolution" bottom: "data" top: "c" convolution_param { num_output: 4 kernel_size: 3 pad: 1
        stride: 2 group: 1 dilation: 1 weight_filler { type: "xavier" } bias_filler { type: "constant" value: 0.1 } } }
layer { name: "bn" type: "BatchNorm" bottom: "c" top: "c" batch_norm_param { moving_average_fraction: 0.9 eps: 1e-4 } }
layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { pool: AVE kernel_size: 3 stride: 2 pad: 1 } }
layer { name: "n" type: "LRN" bottom: "p" top: "n" lrn_param { local_size: 3 alpha: 0.1 beta: 0.75 } }
layer { name: "f" type: "InnerProduct" bottom: "n" top: "f" inner_product_param { num_output: 6 axis: 1 } }
layer { name: "s" type: "Slice" bottom: "f" top: "s1" top: "s2" slice_param { axis: 1 slice_point: 2 } }
layer { name: "k" type: "Concat" bottom: "s2" bottom: "s1" top: "k" concat_param { axis: 1 } }
layer { name: "r" type: "Reshape" bottom: "k" top: "r" reshape_param { shape { dim: 0 dim: -1 dim: 1 } } }
layer { name: "t" type: "Tile" bottom: "r" top: "t" tile_param { axis: 2 tiles: 3 } }
layer { name: "e" type: "Reduction" bottom: "t" top: "e" reduction_param { operation: SUMSQ axis: 1 coeff: 0.5 }
        loss_weight: 1 }
"""
OLD_NET = """name: "old" input: "x" input_dim: 2 input_dim: 3 input_dim: 4 input_dim: 4
layers { name: "c" type: CONVOLUTION bottom: "x" top: "c" blobs_lr: 1 blobs_lr: 2 weight_decay: 1 weight_decay: 0
         convolution_param { num_output: 2 kernel_size: 3 } }
layers { name: "r" type: RELU bottom: "c" top: "c" }
layers { name: "i" type: INNER_PRODUCT bottom: "c" top: "i" inner_product_param { num_output: 2 } }
"""
HAND = """layer { name: "x" type: "DummyData" top: "x" dummy_data_param { shape { dim: 2 dim: 47 }
        data_filler { type: "gaussian" std: 0.1 } } }
layer { name: "h" type: "HandModel" bottom: "x" top: "y" hand_model_param { skeleton: "hand.prototxt" } }
layer { name: "l" type: "PhysLimit" bottom: "x" top: "z" phys_limit_param { skeleton: "hand.prototxt" } loss_weight: 1 }
"""


def put(name: str, text: str) -> str:
    """Write a text file."""
    Path(name).write_text(text, encoding="utf-8")
    return name


def put_rows(name: str, seed: int = 0, **shapes: tuple[int, ...]) -> str:
    """Write an HDF5 file of random rows."""
    rng = np.random.default_rng(seed)
    with h5py.File(name, "w") as file:
        for dataset, shape in shapes.items():
            file[dataset] = rng.normal(size=shape).astype(np.float32)
        file.attrs["made_from"] = "a campaign"
    return name


def run_once(net: netlib.Net) -> dict[str, Any]:
    """Run a net forwards and backwards; returns the results."""
    net.run_forward()
    net.run_backward()
    return {name: net.blobs[name].data.copy() for name in net.outputs}


def make_nets() -> list[str]:
    """Write a net of every layer type that needs no file, and some larger nets."""
    from tests.support.layer_cases import CASES

    files = [put("vision.prototxt", VISION), put("old.prototxt", OLD_NET), put("vision2.prototxt", VISION)]
    files.append(put("ssd.prototxt", (ROOT / "tests/layers/detection/small_ssd.prototxt").read_text(encoding="utf-8")))
    for kind, (options, bottoms, more) in CASES.items():
        if kind == "DetectionOutput":  # needs prior boxes, as in small_ssd
            continue
        shapes = [np.shape(array) for array in bottoms(2)]
        text = inputs(**{f"x{i}": shape for i, shape in enumerate(shapes)})
        ends = [f'bottom: "x{i}"' for i in range(len(shapes))] + [f'top: "y{i}"' for i in range(more.get("tops", 1))]
        files.append(
            put(f"{kind}.prototxt", f'{text}layer {{ name: "l" type: "{kind}" {" ".join(ends)} {options} }}\n')
        )
    return files


def read_net(path: Path) -> Any:
    """Build a net and run it once."""
    return run_once(netlib.Net(str(path), netlib.TRAIN, seed=1))


def make_solver(layout: str = "HDF5") -> list[str]:
    """Write a solver that trains and tests on 7 rows."""
    put_rows("rows.h5", data=(7, 5), label=(7, 2))
    put("list.txt", "rows.h5\n")
    return [put("solver.prototxt", SOLVER.replace("FORMAT", layout)), put("net.prototxt", NET)]


def read_solver(path: Path) -> Any:
    """Build a solver and make two steps if they are short; no snapshots, whose paths may be damaged."""
    solver = netlib.get_solver("solver.prototxt", snapshot=0, snapshot_after_train=False)
    if max([solver.param.iter_size, *solver.param.test_iter]) <= 1000:
        solver.step(2)
    return parameters(solver)


def parameters(solver: netlib.Solver) -> list[Any]:
    """All values that training changes."""
    return [p.blob.data.copy() for p in solver.net.learnable]


def make_skeletons() -> list[str]:
    """Write the packaged hand, and a net that uses it."""
    shutil.copy(ROOT / "prototxt" / "hand" / "nyu.prototxt", "hand.prototxt")
    put("net.prototxt", HAND)
    return ["hand.prototxt"]


def read_skeleton(path: Path) -> Any:
    """Load a skeleton with its surface, and run the layers that use it."""
    from layers.hand import skeleton

    found = skeleton.load(path)
    if found.param.flesh is not None:
        found.with_surface()
    return run_once(netlib.Net("net.prototxt", netlib.TRAIN, seed=1))


def make_priors() -> list[str]:
    """Write the packaged prior of the hand next to its skeleton."""
    folder = ROOT / "prototxt" / "hand"
    shutil.copy(folder / "nyu.prototxt", "nyu.prototxt")
    shutil.copy(folder / "nyu_prior.prototxt", "prior.prototxt")
    return ["prior.prototxt"]


def read_prior(path: Path) -> Any:
    """Load a prior and draw hands from it."""
    from handpose.synthetic import prior_file
    from handpose.synthetic.pose_prior import BodySampler

    bodies = BodySampler(prior_file.load(path)).draw(np.random.default_rng(0), 4)
    return bodies.inputs, bodies.joints


# ---------------------------------------------------------------------------------------------- weights and states


def make_weights(suffix: str) -> list[str]:
    """Write the weights of two nets, and the nets."""
    make_solver()
    put("vision.prototxt", VISION)
    for name, model in (("net", "net.prototxt"), ("vision", "vision.prototxt")):
        netlib.Net(model, netlib.TRAIN, seed=2).save(f"{name}{suffix}")
    return [f"net{suffix}", f"vision{suffix}"]


def read_weights(path: Path) -> Any:
    """Copy weights to their net, which must not change if they are rejected."""
    net = netlib.Net(f"{path.name.split('.')[0]}.prototxt", netlib.TEST, seed=1)
    before = digest({name: [blob.data for blob in blobs] for name, blobs in net.params.items()})
    try:
        net.copy_from(path)
    except NetlibError:
        if digest({name: [blob.data for blob in blobs] for name, blobs in net.params.items()}) != before:
            raise BrokenPromise("CHANGED", f"{path}: refused, but the net is not what it was") from None
        raise


def make_old_weights() -> list[str]:
    """Write binary weights of a net of 2014, and of Caffe itself."""
    from netlib.proto import prototxt, wire
    from netlib.proto.upgrade import AnyNetParameter

    blob = "blobs { num: 1 channels: 1 height: 2 width: 8 " + "data: 0.5 " * 16 + "}"
    text = OLD_NET.replace("num_output: 2 }", "num_output: 2 } " + blob)
    Path("old.caffemodel").write_bytes(wire.encode(prototxt.parse(text), AnyNetParameter))
    shutil.copy(RECORDED / "solvers" / "init.caffemodel", "caffe.caffemodel")
    return ["old.caffemodel", "caffe.caffemodel"]


def read_any_weights(path: Path) -> Any:
    """Read weights without a net."""
    from netlib.snapshots import snapshot

    snapshot.read_weights(path)


def make_pair(layout: str) -> list[str]:
    """Write the snapshot of a training run of two iterations."""
    make_solver(layout)
    solver = netlib.get_solver("solver.prototxt", max_iter=2)
    solver.solve()
    suffix = ".h5" if layout == "HDF5" else ""
    return [f"s_iter_2.solverstate{suffix}", f"s_iter_2.caffemodel{suffix}"]


def read_pair(path: Path) -> Any:
    """Resume and train to the end; a solver that rejects the state must not change and can still train."""
    solver = netlib.get_solver("solver.prototxt", seed=99, snapshot=0, snapshot_after_train=False)
    before = digest(everything(solver))
    try:
        solver.restore(str(path).replace("caffemodel", "solverstate"))
    except NetlibError:
        if digest(everything(solver)) != before:
            raise BrokenPromise("CHANGED", f"{path}: refused, but the solver is not what it was") from None
        raise
    solver.step(max(0, min(solver.param.max_iter - solver.iter, 6)))
    return [solver.iter, parameters(solver), list(solver.smoothed)]


def everything(solver: netlib.Solver) -> list[Any]:
    """All values that a restore may change."""
    states = [net.layer_states() for net in [solver.net, *solver.test_nets]]
    return [solver.iter, parameters(solver), solver.history, list(solver.smoothed), states]


def make_old_state() -> list[str]:
    """Write states without a checksum: one of Caffe and one of an earlier version."""
    for file in (ROOT / "tests" / "netlib" / "older").iterdir():
        shutil.copy(file, file.name)
    for name in ("train0.h5", "train1.h5"):
        shutil.copy(RECORDED / "solvers" / name, name)
    put("list.txt", "train0.h5\ntrain1.h5\n")
    return ["older_iter_5.solverstate.h5", "older_iter_5.caffemodel.h5"]


def make_fit() -> list[str]:
    """Write weights with a group about the network's errors."""
    from handpose.fit.network_errors import SIGNS

    table = np.array([[10.0, 4, 1], [50, 8, 0.9], [200, 40, 0.2]])
    with h5py.File("model.caffemodel.h5", "w") as file:
        file["data/a/0"] = np.zeros((2, 2), np.float32)
        file["fit/limbs"] = np.eye(len(_surface_model().limbs)) * 0.04
        file["fit/fast"], file["fit/fast.signs"] = table, np.full(len(SIGNS), 1 / len(SIGNS))
    return ["model.caffemodel.h5"]


@functools.cache
def _surface_model() -> Any:
    from handpose.fit.body import CapsuleModel
    from layers.hand import skeleton

    return CapsuleModel(skeleton.load(), 150.0)


def read_fit(path: Path) -> Any:
    """Read the group in addition to the weights."""
    from handpose.fit.network_errors import read_errors

    read_errors(path, _surface_model())


def make_card() -> list[str]:
    """Write the folder of a model."""
    Path("model").mkdir()
    Path("model/w.h5").write_bytes(b"weights" * 100)
    put("model/deploy.prototxt", NET)
    weights, net = (
        hashlib.sha256(Path("model", name).read_bytes()).hexdigest() for name in ("w.h5", "deploy.prototxt")
    )
    said = {"name": "m", "caffemodel": "w.h5", "license": "MIT", "sha256": weights, "net_sha256": net}
    front = "".join(f"{key}: {value}\n" for key, value in said.items())
    return [put("model/readme.md", f"---\n{front}---\n\n# A model\n"), "model/w.h5", "model/deploy.prototxt"]


def read_packaged(path: Path) -> Any:
    """Read the card of a model, and its weights and net if they are those of the card."""
    from handpose.estimate.packaged import checked_net, checked_weights, net_content, read_card

    card = read_card(Path("model"))
    return checked_weights(card).read_bytes(), net_content(checked_net(card))


# ---------------------------------------------------------------------------------------------- data of layers


def make_hdf5() -> list[str]:
    """Write contiguous rows, rows in compressed chunks and rows behind a link, and the list of the files."""
    put_rows("a.h5", 1, data=(5, 2, 3), label=(5,))
    with h5py.File("b.h5", "w") as file:
        file.create_dataset(
            "data", data=np.ones((40, 2, 3), np.float32), chunks=(8, 2, 3), compression="gzip", shuffle=True
        )
        file.create_dataset("label", data=np.arange(40, dtype=np.int64), maxshape=(None,))
    with h5py.File("c.h5", "w", libver="latest") as file:
        file["group/deep"] = np.zeros((3, 2, 3), np.float16)
        file["data"], file["label"] = h5py.SoftLink("/group/deep"), np.zeros(3)
        file.attrs["made_from"] = "a text that is not of a fixed length"
    put("net.prototxt", 'layer { name: "d" type: "HDF5Data" top: "data" top: "label" '
                        'hdf5_data_param { source: "list.txt" batch_size: 6 shuffle: true } }')
    return ["a.h5", "b.h5", "c.h5", put("list.txt", "a.h5\nb.h5\nc.h5\n")]


def read_batches(path: Path) -> Any:
    """Read a few batches with the net in net.prototxt."""
    net = netlib.Net("net.prototxt", netlib.TRAIN, seed=1)
    for _ in range(3):
        net.run_forward()


def put_picture(name: str, shape: tuple[int, ...], dtype: type = np.uint8, seed: int = 0) -> str:
    """Write a picture file of random pixels, smooth enough for a JPEG."""
    pixels = np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape)
    smooth = cv2.blur(pixels.astype(np.float32), (5, 5))
    if not cv2.imwrite(name, smooth.astype(dtype)):
        raise OSError(name)
    return name


def make_pictures() -> list[str]:
    """Write PNG and JPEG files, their list, and a mean image."""
    from tests.support.caffe_messages import write_blob

    files = [put_picture("a.png", (12, 16, 3)), put_picture("b.jpg", (12, 16, 3)), put_picture("c.png", (12, 16)),
             put_picture("d.bmp", (12, 16, 3)), put_picture("e.png", (12, 16, 4))]
    write_blob(Path("mean.binaryproto"), np.full((1, 3, 12, 16), 100, np.float32))
    put("net.prototxt", 'layer { name: "d" type: "ImageData" top: "x" top: "t" image_data_param { source: "list.txt" '
        'batch_size: 5 } transform_param { mean_file: "mean.binaryproto" crop_size: 8 mirror: true } }')
    listed = "".join(f"{name} {i}\n" for i, name in enumerate(files))
    return [*files, put("list.txt", listed), "mean.binaryproto"]


def make_windows() -> list[str]:
    """Write a list of windows in two pictures."""
    lines = []
    for i in range(2):
        put_picture(f"{i}.png", (12, 16, 3), seed=i)
        lines += [f"# {i}", f"{i}.png", "3 12 16", "2", "5 0.75 2 3 5 6", "5 0.25 1 2 8 4"]
    put("net.prototxt", 'layer { name: "d" type: "WindowData" top: "x" top: "t" window_data_param { source: '
        '"windows.txt" batch_size: 2 fg_fraction: 0.5 context_pad: 1 } transform_param { crop_size: 4 } }')
    return [put("windows.txt", "\n".join(lines) + "\n"), "0.png"]


def make_database() -> list[str]:
    """Write a database of eight entries: pixels, floats and a picture."""
    import lmdb

    from tests.support.caffe_messages import datum

    rng = np.random.default_rng(0)
    entries: list[bytes] = [datum(rng.integers(0, 256, (3, 8, 8)).astype(np.uint8), i) for i in range(6)]
    entries.append(datum(rng.normal(size=(3, 8, 8)).astype(np.float32), 6))
    entries.append(datum(cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1].tobytes(), 7))
    with lmdb.open("db", map_size=1 << 20) as database, database.begin(write=True) as change:
        for i, entry in enumerate(entries):
            change.put(f"{i:08}".encode(), entry)
    put("net.prototxt", 'layer { name: "d" type: "Data" top: "x" top: "t" '
        'data_param { source: "db" backend: LMDB batch_size: 4 } }')
    return ["db/data.mdb"]


def make_datums() -> list[str]:
    """Write single entries of a database."""
    from tests.support.caffe_messages import datum

    image = np.arange(192, dtype=np.uint8).reshape(3, 8, 8)
    Path("pixels.datum").write_bytes(datum(image, 3))
    Path("floats.datum").write_bytes(datum(image.astype(np.float32), 3))
    Path("picture.datum").write_bytes(datum(cv2.imencode(".png", image[0])[1].tobytes(), 3))
    return ["pixels.datum", "floats.datum", "picture.datum"]


def read_datum(path: Path) -> Any:
    """Decode an entry as the layer and the tools do."""
    from layers.data.images import decode_datum

    decode_datum(path.read_bytes(), True, str(path))


def read_database(path: Path) -> Any:
    """Read a database with the layer, and entry by entry as the tools do."""
    from tools.common import databases

    read_batches(path)
    list(databases.read_database("db")[1])


def make_mean() -> list[str]:
    """Write mean images in floats and doubles."""
    from tests.support.caffe_messages import write_blob

    write_blob(Path("mean.binaryproto"), np.ones((1, 3, 4, 5), np.float32))
    write_blob(Path("double.binaryproto"), np.ones((1, 3, 4, 5), np.float64))
    return ["mean.binaryproto", "double.binaryproto"]


def read_mean(path: Path) -> Any:
    """Read the blob."""
    from netlib.proto.binaryproto import read_blob

    read_blob(path)


def read_text_net(path: Path) -> Any:
    """Read a net as tools/upgrade_net.py does."""
    from tools import upgrade_net

    run_tool(upgrade_net.main, str(path), "new.prototxt")


def read_image(path: Path) -> Any:
    """Read an image with caffe.io.load_image, in colour and in grey."""
    from netlib.caffe import io

    for color in (True, False):
        io.load_image(path, color)


def make_run_net() -> list[str]:
    """Write a net, its weights, an image, mean images and names of classes."""
    import netlib
    from tests.support.caffe_messages import write_blob

    put("net.prototxt", inputs(data=(1, 3, 4, 5)) + 'layer { name: "p" type: "InnerProduct" bottom: "data" top: "y" '
        'inner_product_param { num_output: 3 weight_filler { type: "xavier" } } }')
    netlib.Net("net.prototxt", netlib.TEST).save("net.caffemodel")
    write_blob(Path("mean.binaryproto"), np.ones((1, 3, 4, 5), np.float32))
    np.save("mean.npy", np.ones((3, 4, 5)))
    return [put_picture("a.png", (4, 5, 3)), "mean.binaryproto", "mean.npy", put("labels.txt", "cat\ndog\nbird\n")]


def read_run_net(path: Path) -> Any:
    """Run the net on the image with both means."""
    from tools import run_net

    for mean in ("mean.binaryproto", "mean.npy"):
        run_tool(run_net.main, "net.prototxt", "net.caffemodel", "a.png", "--mean-file", mean, "--labels", "labels.txt")


def read_imageset(path: Path) -> Any:
    """Read a list of images with tools/convert_imageset.py."""
    from tools import convert_imageset

    run_tool(convert_imageset.main, "./", "list.txt", "new_db", "--encoded")


def run_tool(main: Callable[[list[str]], int], *arguments: str) -> None:
    """Run the main function of a tool and raise its error line. Other lines are about pictures that it skips."""
    import io

    out, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stderr(errors), contextlib.redirect_stdout(out):
        status = main(list(arguments))
    if status:
        raise NetlibError(errors.getvalue().strip().split("\n")[-1])


# ---------------------------------------------------------------------------------------------- data of hands


def make_depth() -> list[str]:
    """Write a 16-bit frame, a frame in NYU's colours and a crop, as PNG, whose chunks have checksums."""
    return [put_picture("frame.png", (48, 64), np.uint16), put_picture("nyu.png", (48, 64, 3)),
            put_picture("crop.png", (32, 32))]


def read_depth(path: Path) -> Any:
    """Read a frame as tools/predict.py and the data sets do."""
    from handpose.frames.cameras import Camera
    from handpose.frames.images import read_crop, read_frame, read_png
    from handpose.frames.recording import CameraInfo

    if path.name == "crop.png":
        return read_crop(path)
    read_png(path)
    return read_frame(path, CameraInfo(Camera("nyu" if path.name == "nyu.png" else "own", 60, 60, 32, 24, 0, 0)))


def make_nyu() -> list[str]:
    """Write the annotation of a small split in MATLAB's formats 5 and 7.3."""
    from handpose.datasets.nyu_files import write_annotation

    xyz = np.random.default_rng(0).normal(0, 50, (6, 36, 3)) + (0, 0, 700)
    write_annotation(Path("five.mat"), xyz, "synthetic")
    from handpose.frames.cameras import NYU

    with h5py.File("seven.mat", "w", userblock_size=512) as file:
        file["joint_uvd"] = np.ascontiguousarray(NYU.project(xyz)[None].T)
        file["joint_xyz"] = np.ascontiguousarray(xyz[None].T)
    return ["five.mat", "seven.mat"]


def read_nyu(path: Path) -> Any:
    """Read the joints of an annotation."""
    from handpose.datasets import matlab_file
    from handpose.datasets.nyu_files import read_annotation

    with mock.patch.object(matlab_file.subprocess, "run", _matlab_worker_forked):
        read_annotation(path)


def _matlab_worker_forked(command: list[str], **options: Any) -> subprocess.CompletedProcess[bytes]:
    """Run matlab_worker.py in a forked process, because a new one would import SciPy again for every case.

    tests/handpose/datasets/test_matlab_file.py tests the program itself, its crash and its time limit.
    """
    from handpose.datasets import matlab_worker

    with tempfile.TemporaryFile() as out:
        child = os.fork()
        if child == 0:
            status = 99
            try:
                matlab_worker.main(command[3], command[4].split(","), out)
                out.flush()
                status = 0
            finally:  # a child must never continue as its parent
                os._exit(status)
        status = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
        out.seek(0)
        return subprocess.CompletedProcess(command, status, out.read())


def make_icvl() -> list[str]:
    """Write labels of 16 joints."""
    uvd = np.random.default_rng(0).normal(0, 8, (4, 16, 3)) + (160, 120, 400)
    lines = [f"seq/image_{i:04d}.png " + " ".join(f"{n:.3f}" for n in row.ravel()) for i, row in enumerate(uvd)]
    return [put("labels.txt", "\n".join(lines) + "\n")]


def read_icvl(path: Path) -> Any:
    """Read the joints of the labels."""
    from handpose.datasets.icvl_files import read_annotation

    read_annotation([path])


def make_centers() -> list[str]:
    """Write crop centres as text and as NumPy files."""
    centers = np.random.default_rng(0).normal(0, 8, (5, 3)) + (160, 120, 400)
    np.savetxt("centers.txt", centers)
    np.save("centers.npy", centers)
    np.savez("centers.npz", center_uvd=centers)
    np.savez_compressed("packed.npz", center_uvd=centers, other=centers)
    return ["centers.txt", "centers.npy", "centers.npz", "packed.npz"]


def read_centers(path: Path) -> Any:
    """Read the centres of five frames."""
    from handpose.datasets.published_frames import read_centers as read

    read(path, 5)


def make_predictions() -> list[str]:
    """Write published joints, two per frame."""
    return [put("joints.txt", "320 240 700  330.5 230 512\n" * 4)]


def read_predictions(path: Path) -> Any:
    """Read predictions in pixels and in mm."""
    from handpose.frames.cameras import NYU
    from handpose.scoring import published_predictions

    if published_predictions.is_list(path):
        from netlib.files.hdf5 import read_list

        return read_list(str(path), None)
    published_predictions.read_joints(path, 2, "uvd", NYU)


def make_logs() -> list[str]:
    """Write a log of Caffe and a short one."""
    shutil.copy(RECORDED / "logs" / "a_avgloss.log", "caffe.log")
    return ["caffe.log", put("short.log", "I0101 Iteration 20 (5 iter/s, 1s/20 iters), loss = 0.5\n"
                             "    Test net output #0: acc = 0.25\nIteration 40, loss = 0.25\n")]


def read_log(path: Path) -> Any:
    """Read the curves of a log."""
    from tools import plot_log

    plot_log.read_log(path)


def make_examples() -> list[str]:
    """Write crops and joints."""
    put_rows("a.h5", depth=(5, 1, 16, 16), joint=(5, 93))
    put_rows("b.h5", depth=(3, 16, 16))
    return ["a.h5", "b.h5", put("list.txt", "a.h5\nb.h5\n")]


def read_examples(path: Path) -> Any:
    """Read examples as tools/show_data.py does."""
    from handpose.datasets.examples import examples_of

    examples_of(path, 4)


def make_labels() -> list[str]:
    """Write a file of frames with all of its data sets."""
    rng = np.random.default_rng(0)
    uvd = rng.normal(0, 20, (6, 3)) + (320, 240, 700)
    from handpose.frames.cameras import NYU

    with h5py.File("part.h5", "w") as file:
        file["joint"] = rng.uniform(-0.9, 0.9, (6, 93)).astype(np.float32)
        file["half_cube"] = np.full(6, 150.0)
        file["center_uvd"], file["center"] = uvd, NYU.unproject(uvd)
        file.attrs["made_from"] = "a campaign"
    return ["part.h5"]


def read_labels(path: Path) -> Any:
    """Read joints, half-cubes and centres."""
    from handpose.datasets import labels
    from netlib.files.hdf5 import File

    labels.read(path, [31])
    labels.read_crop_centers([File(path, ("joint",))])


def make_companions() -> list[str]:
    """Write a file of frames and its companion."""
    make_labels()
    _fit_companion()
    return ["part.h5", "angles/part.h5"]


def _fit_companion() -> Any:
    from handpose.fit.joints import companions
    from layers.hand import skeleton

    with contextlib.suppress(OSError):
        os.utime("part.h5", ns=(10**18, 10**18))  # a companion stores the modification time of its file
    return companions.fit_list([Path("part.h5")], Path("angles"), "list.txt", skeleton.load(), starts=1)


def read_companions(path: Path) -> Any:
    """Keep the companion if it is complete, else write it again."""
    _fit_companion()


def make_store() -> list[str]:
    """Write an entry of the store of Table 1, the frames that are drawn, and a speed."""
    from experiments.table1 import speed, store
    from tests.support import made_store

    entry = store.write(Path("store"), made_store.entry())
    store.write_shown(Path("store"), "one_hand", made_store.shown())
    speed.write(Path("store/speed.json"), speed.Speed(100.0, 1000.0, 64, "fast", 2, "a machine"))
    return [entry.as_posix(), "store/one_hand/shown.json", "store/speed.json"]


def read_store(path: Path) -> Any:
    """Read the store as tools/table1.py --page does."""
    from experiments.table1 import speed, store

    return (store.read_all(Path("store"), "one_hand"), store.read_shown(Path("store"), "one_hand"),
            speed.read(Path("store/speed.json")))


def make_components() -> list[str]:
    """Write files of joints."""
    return [put_rows("a.h5", 1, joint=(40, 93)), put_rows("b.h5", 2, joint=(40, 93))]


def read_components(path: Path) -> Any:
    """Read the joints as tools/table1.py does for DeepPrior."""
    from experiments.table1.derived_nets import write_components

    write_components(Path("out.h5"), [Path("a.h5"), Path("b.h5")])


def make_parts() -> list[str]:
    """Write a data set of one part with its list; of three frames, one picture is missing."""
    make_frames()
    _prepare()
    return ["out/test_000.h5", "out/test.txt", "out/bad_test.txt", "1.png"]


def make_frames() -> None:
    """Write two of the three frames of a data set."""
    Path("out").mkdir()
    for i in range(2):
        put_picture(f"{i}.png", (48, 64, 3), seed=i)


def _prepare() -> Any:
    from handpose.datasets.preparation import PreparedSplit, refuse_foreign
    from handpose.datasets.published_frames import PublishedFrames
    from handpose.frames.cameras import Camera
    from handpose.frames.images import read_png, unpack_depth

    joints = np.zeros((3, 31, 3)) + (0, 0, 700)
    camera = Camera("own", 60, 60, 32, 24, 64, 48)
    frames = PublishedFrames(
        split="test", files=[Path(f"{i}.png") for i in range(3)], center_uvd=np.full((3, 3), (32, 24, 700.0)),
        joints=joints, cube_mm=np.full(3, 3e5), camera=camera, read=lambda path: unpack_depth(read_png(path)),
        made_from="a campaign", centre="nothing",
    )
    split = PreparedSplit(frames, Path("out"))
    refuse_foreign([split], ["a campaign"])
    outcome = split.write(1, lambda count: None, lambda i, error: None)
    split.write_list(outcome)


def read_parts(path: Path) -> Any:
    """Continue the preparation of the data set from the existing files."""
    _prepare()


# ---------------------------------------------------------------------------------------------- recordings


def make_videos() -> list[str]:
    """Write a video with the project's writer, and one of raw values."""
    from handpose.frames.cameras import Camera
    from handpose.frames.formats.video_writer import VideoWriter
    from handpose.frames.recording import DepthFrame

    depth = np.random.default_rng(0).integers(0, 4000, (4, 24, 32)).astype(np.float32)
    for name, images in (("noise.mkv", depth), ("smooth.mkv", np.sort(depth, axis=2))):
        with VideoWriter(Path(name), Camera("own", 30, 30, 16, 12, 32, 24), 1.0, 30) as video:
            for i, image in enumerate(images):
                video.write(DepthFrame(i, i / 30, image))
    return ["noise.mkv", "smooth.mkv"]


def make_azure() -> list[str]:
    """Write a recording in the smallest mode of a Kinect."""
    from tests.support import azure_file

    depth = np.zeros((2, 288, 320), np.uint16)
    return [str(azure_file.write(Path("kinect.mkv"), depth, said=azure_file.calibration()))]


DICE = "some bytes that are damaged\n" * 4


def make_dice() -> list[str]:
    """Write a file whose bytes seed a random file, so that every damage gives another one."""
    return [put("dice.txt", DICE)]


FORMATS = ("16UC1; compressedDepth png", "32FC1; compressedDepth", "16UC1; compressedDepth rvl", "png", "",
           "16UC1; png compressed ", "bgr8; jpeg compressed bgr8")
HEADERS = (b"", bytes(12), bytes(9), struct.pack("<iff", 0, 10100, -1009), struct.pack("<iff", 0, math.nan, 0),
           struct.pack("<iffII", 0, 0, 0, 8, 6), struct.pack("<iffII", 0, 0, 0, 1 << 31, 1 << 31))


def read_mixed_bag(path: Path) -> Any:
    """Read a bag of random records: messages of any type with any name, several types with one name."""
    from handpose.frames.cameras import Camera
    from handpose.frames.formats.ros_bag import open_bag
    from handpose.frames.recording import CameraInfo
    from tests.support import bags

    if path.read_bytes() == DICE.encode():  # the undamaged file is valid
        return
    rng = random.Random(path.read_bytes())
    topics = [*[bags.TOPIC] * 6, "/camera/depth/camera_info", f"{bags.TOPIC}/compressedDepth", "/a",
              f"{bags.REALSENSE}/Depth_0/image/data", f"{bags.REALSENSE}/Depth_0/info/camera_info",
              f"{bags.REALSENSE}/option/Depth_Units/value"]
    depth = np.full((6, 8), 900, np.uint16)

    def records(of: bags.Messages, _: Any) -> bags.Content:
        contents = {
            "sensor_msgs/msg/Image": of.image(depth, 5, rng.choice(["16UC1", "mono16", "rgb8", "32FC1"])),
            "sensor_msgs/msg/CompressedImage": of.packed(depth, 5, rng.choice(FORMATS), rng.choice(HEADERS)),
            "sensor_msgs/msg/CameraInfo": of.info(
                rng.choice([depth.shape, (12, 16)]),
                region=(rng.randrange(3), 0, rng.choice([0, 8]), 6),
                binning=(rng.randrange(3), rng.randrange(3)),
            ),
            "std_msgs/msg/Float32": of.number(0.001),
            "std_msgs/msg/String": of.text(rng.choice(["0.001", "e", ""])),
        }
        kinds = [*contents, *["sensor_msgs/msg/Image"] * 4]
        right = rng.random() < 0.5  # whether all messages have their declared types
        made = []
        for i in range(rng.randint(1, 8)):
            kind = rng.choice(kinds)
            made.append((rng.choice(topics), kind, i, contents[kind if right else rng.choice(kinds)]))
        return made

    write = rng.choice([bags.write_ros1, bags.write_ros2, functools.partial(bags.write_ros2, storage="MCAP")])
    name = "mixed.bag" if write is bags.write_ros1 else "mixed"
    camera = Camera("own", 60, 60, 4, 3, 8, 6)
    try:
        for i, given in enumerate((CameraInfo(camera), CameraInfo())):
            list(open_bag(write(Path(f"{i}_{name}"), depth[None], make=records), given))
    except NetlibError as error:
        if name not in str(error):
            raise
        raise NetlibError(f"{path}: {error}") from error


def read_log_of_many_names(path: Path) -> Any:
    """Read a log of random numbers and lengths of names; one in ten logs is drawn."""
    from tools import plot_log

    rng = random.Random(path.read_bytes())
    names = rng.choice([1, 9, 400, 2000])
    word = rng.choice(["a", "$x$", "\\", "_", "\u202e", "\udce9", "x" * 60000 if names < 10 else "x" * 100])
    lines = [f"Test net output #{i}: {word}{i} = {rng.choice(['1', '-2e30', 'nan', 'inf', '0'])}" for i in range(names)]
    text = "\n".join(["Iteration 0, loss = 1", *lines, "Iteration 5, loss = nan", *lines])
    Path("many.log").write_bytes(text.encode("utf-8", "surrogateescape" if word == "\udce9" else "strict"))
    log = plot_log.read_log("many.log")
    if rng.random() < 0.1:
        plot_log.plot({"many.log": log}, "many.png")


def make_bags() -> list[str]:
    """Write bags of ROS 1, plain and compressed, and of ROS 2 in its three formats."""
    from tests.support import bags

    depth = np.random.default_rng(0).integers(0, 4000, (4, 24, 32)).astype(np.uint16)
    bags.write_realsense(Path("realsense.bag"), depth)
    bags.write_ros1(Path("packed.bag"), depth, compression="LZ4")
    bags.write_ros2(Path("ros2"), depth)
    bags.write_ros2(Path("mcap"), depth, storage="MCAP")
    return ["realsense.bag", "packed.bag", "ros2/metadata.yaml", "ros2/ros2.db3", "mcap/mcap.mcap"]


CAMERA_JSON = """{"name": "own", "fx": 60.0, "fy": 60, "u0": 32, "v0": 24.5, "width": 64, "height": 48,
 "unit_mm": 0.125, "rate": 30, "distortion": {"model": "brown_conrady", "coefficients": [0.1, -0.02, 0.001, 0, 0]}}
"""


def make_camera_json() -> list[str]:
    """Write camera files with the fields of this project, of RealSense and of Azure."""
    realsense = '{"width": 64, "height": 48, "ppx": 31.5, "ppy": 23.5, "fx": 60, "fy": 60, "model": ' \
        '"Brown Conrady", "coeffs": [0, 0.01, 0, 0, 0], "depth_scale": 0.001, "fps": 30}'
    azure = '{"fx": 60, "fy": 60, "cx": 32, "cy": 24, "k1": 0.5, "k2": 0.1, "p1": 0, "p2": 0, "k3": 0.01, ' \
        '"k4": 0.4, "k5": 0.1, "k6": 0.02, "codx": 0, "cody": 0, "metric_radius": 1.7}'
    return [put("own.json", CAMERA_JSON), put("realsense.json", realsense), put("azure.json", azure)]


def read_camera_json(path: Path) -> Any:
    """Read a camera file and use its lens parameters."""
    from handpose.frames import camera_file
    from handpose.frames.raw import calibration_of

    given = camera_file.read(path)
    raw = np.full((48, 64), 4000, np.uint16)
    calibration_of(given, given, given, raw.shape, raw.dtype, str(path)).decoder(str(path))(raw)


def make_depth_folders() -> list[str]:
    """Write frames by number, and frames of MSRA15."""
    Path("frames").mkdir()
    Path("msra").mkdir()
    content = np.array([320, 240, 100, 80, 104, 83], "<i4").tobytes() + np.full(12, 400, "<f4").tobytes()
    Path("msra/000000_depth.bin").write_bytes(content)
    put("frames/camera.json", CAMERA_JSON)
    return [put_picture(f"frames/{i:03}.png", (48, 64), np.uint16, i) for i in range(3)] + ["msra/000000_depth.bin"]


def make_stacks() -> list[str]:
    """Write stacks of each kind with all optional entries."""
    depth = np.random.default_rng(0).integers(0, 4000, (4, 48, 64)).astype(np.uint16)
    camera = np.array(CAMERA_JSON)
    put("camera.json", CAMERA_JSON)
    np.save("whole.npy", depth)
    np.save("float.npy", depth.astype(np.float32))
    np.savez("plain.npz", depth=depth, time=np.arange(4) / 30, fx=60.0, fy=60.0, u0=32.0, v0=24.0, unit_mm=0.125)
    np.savez_compressed("packed.npz", depth=depth, camera=camera)
    with h5py.File("stack.h5", "w") as file:
        file["depth"], file["time"] = depth, np.arange(4) / 30
        file.attrs["camera"] = CAMERA_JSON
    return ["whole.npy", "float.npy", "plain.npz", "packed.npz", "stack.h5"]


def read_recording(path: Path) -> Any:
    """Inspect a recording, then read all its frames; for a file of a folder, those of the folder."""
    from handpose.frames.inspection import inspect
    from handpose.frames.opening import open_recording

    with open_recording(path.parent if path.suffix in (".png", ".bin", ".yaml") else path) as recording:
        inspect(recording)
        return [(frame.time, frame.depth) for frame in recording]


# ---------------------------------------------------------------------------------------------- the table


def _hdf5(layout: str) -> Callable[[], list[str]]:
    return functools.partial(make_pair, layout)


def make_tracks() -> list[str]:
    """Write two hands over a few frames, in both layouts."""
    from handpose.output.tracks.json_file import JsonLinesWriter, JsonWriter
    from layers.hand import skeleton
    from tests.support.made_tracks import any_track, header_of

    header = header_of(skeleton.load())
    for path, kind in ((Path("a.json"), JsonWriter), (Path("b.jsonl"), JsonLinesWriter)):
        with kind(path, header) as writer:
            for frame in any_track(header, seed=1):
                writer.write(frame)
    return ["a.json", "b.jsonl"]


def read_tracks(path: Path) -> Any:
    """Read all frames of the tracks."""
    from handpose.output.tracks.json_file import read_track

    read_track(path)


READERS: tuple[Reader, ...] = (
    Reader("net", ("netlib/proto/prototxt.py",), make_nets, read_net),
    Reader("solver", ("netlib/proto/prototxt.py",), make_solver, read_solver),
    Reader("skeleton", ("netlib/proto/prototxt.py",), make_skeletons, read_skeleton),
    Reader("prior", ("netlib/proto/prototxt.py",), make_priors, read_prior),
    Reader("net to upgrade", ("tools/upgrade_net.py",), lambda: [*make_nets()[:2], *make_old_weights()], read_text_net),
    Reader("weights hdf5", ("netlib/snapshots/snapshot.py", "netlib/snapshots/hdf5_format.py"),
           functools.partial(make_weights, ".caffemodel.h5"), read_weights),
    Reader("weights binary", ("netlib/snapshots/snapshot.py",),
           functools.partial(make_weights, ".caffemodel"), read_weights),
    Reader("weights of caffe", ("netlib/snapshots/snapshot.py",), make_old_weights, read_any_weights),
    Reader("resume hdf5", ("netlib/snapshots/snapshot.py", "netlib/snapshots/hdf5_format.py"),
           _hdf5("HDF5"), read_pair, exact=True),
    Reader("resume binary", ("netlib/snapshots/snapshot.py",), _hdf5("BINARYPROTO"), read_pair, exact=True),
    Reader("resume older", ("netlib/snapshots/snapshot.py", "netlib/snapshots/hdf5_format.py"),
           make_old_state, read_pair),
    Reader("errors of a network", ("handpose/fit/network_errors.py",), make_fit, read_fit),
    Reader("packaged model", ("handpose/estimate/packaged.py",), make_card, read_packaged, exact=True),
    Reader("data hdf5", ("netlib/files/hdf5.py", "netlib/files/hdf5_check.py", "layers/data/hdf5_data.py"),
           make_hdf5, read_batches),
    Reader("data pictures", ("layers/data/image_data.py", "layers/data/images.py", "netlib/proto/binaryproto.py"),
           make_pictures, read_batches),
    Reader("data windows", ("layers/data/window_data.py", "layers/data/images.py"), make_windows, read_batches),
    Reader("data lmdb", ("layers/data/lmdb_file.py",), make_database, read_database),
    Reader("datum", (), make_datums, read_datum),
    Reader("mean image", ("netlib/proto/binaryproto.py",), make_mean, read_mean),
    Reader("run net", ("tools/common/net_images.py", "layers/data/images.py", "netlib/proto/binaryproto.py"),
           make_run_net, read_run_net),
    Reader("picture", ("netlib/caffe/io.py",), lambda: make_pictures()[:5], read_image),
    Reader("picture list", ("tools/convert_imageset.py", "layers/data/image_data.py"),
           lambda: [name for name in make_pictures() if name != "mean.binaryproto"], read_imageset),
    Reader("depth picture", ("handpose/frames/images.py",), make_depth, read_depth, exact=True),
    Reader("nyu annotation", ("handpose/datasets/nyu_files.py", "handpose/datasets/matlab_worker.py"), make_nyu,
           read_nyu),
    Reader("icvl labels", ("handpose/datasets/icvl_files.py",), make_icvl, read_icvl),
    Reader("centres", ("handpose/datasets/published_frames.py",), make_centers, read_centers),
    Reader("predictions", ("handpose/scoring/published_predictions.py", "netlib/files/hdf5.py"),
           make_predictions, read_predictions),
    Reader("log", ("tools/plot_log.py",), make_logs, read_log),
    Reader("examples", ("handpose/datasets/examples.py",), make_examples, read_examples),
    Reader("labels", ("netlib/files/hdf5.py", "handpose/datasets/labels.py"), make_labels, read_labels),
    Reader("companions", ("handpose/fit/joints/companions.py", "handpose/datasets/parts.py"),
           make_companions, read_companions),
    Reader("store of table 1", ("experiments/table1/store.py", "experiments/table1/speed.py"),
           make_store, read_store),
    Reader("principal components", ("experiments/table1/derived_nets.py",), make_components,
           read_components),
    Reader("video", ("handpose/frames/formats/ffmpeg.py", "handpose/frames/formats/video.py"),
           make_videos, read_recording),
    Reader("azure kinect", ("handpose/frames/formats/ffmpeg.py", "handpose/frames/formats/video.py"),
           make_azure, read_recording),
    Reader("records of a bag under other names", (), make_dice, read_mixed_bag),
    Reader("log of many names", (), make_dice, read_log_of_many_names),
    Reader("ros bag", ("handpose/frames/formats/ros_bag.py", "handpose/frames/formats/ros_limits.py"),
           make_bags, read_recording),
    Reader("camera.json", ("handpose/frames/camera_file.py",), make_camera_json, read_camera_json),
    Reader("depth folder", ("handpose/frames/formats/data_sets.py", "handpose/frames/images.py"),
           make_depth_folders, read_recording),
    Reader("depth stack", ("handpose/frames/formats/stack.py", "handpose/frames/formats/numpy_files.py"),
           make_stacks, read_recording),
    Reader("prepared data",
           ("handpose/datasets/parts.py", "handpose/datasets/preparation.py", "netlib/files/atomic.py"),
           make_parts, read_parts),
    Reader("track", ("handpose/output/tracks/json_file.py",), make_tracks, read_tracks),
)
