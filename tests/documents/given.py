"""Files that documents assume a reader to have: camera frames, a crop, trained weights, joints, a
data set, nets.
"""

from __future__ import annotations

import functools
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np

import netlib
from handpose.body.nyu import CUBE_MM, EVALUATION_JOINTS
from handpose.frames import crops
from handpose.frames.cameras import KINECT2, NYU
from handpose.frames.writing import RecordingWriter
from handpose.sequences.recordings import SyntheticRecording
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from tests.support.nets import inputs, ip
from tests.support.running import ROOT
from tools import make_synthetic

Names = dict[str, object] | None


@functools.cache
def recording() -> SyntheticRecording:
    """A Kinect v2's recording of a moving hand, of a tenth of a second."""
    return SyntheticRecording("moving", KINECT2, seconds=0.1, seed=1)


def frames(folder: Path) -> None:
    """frames/: the recording, with camera.json."""
    with RecordingWriter(
        folder / "frames", KINECT2, recording().unit_mm, recording().rate
    ) as writer:
        for frame in recording():
            writer.write(frame)


def frame(folder: Path) -> Names:
    """frame.png and ``depth``, its depth in mm; crop.png, the hand in it, and ``crop``, the same as
    a net's input.
    """
    depth = next(iter(recording())).depth
    cut = crops.crop(depth, recording().truth(0).hands[0].pose.center_uvd, CUBE_MM, KINECT2)
    cv2.imwrite(str(folder / "frame.png"), np.rint(depth).astype(np.uint16))
    cv2.imwrite(str(folder / "crop.png"), np.rint((cut + 1) * 127.5).astype(np.uint8))
    return {"depth": np.rint(depth).astype(np.uint16), "crop": cut}


def training(folder: Path) -> None:
    """snapshots/nyu_iter_1000.caffemodel.h5, the packaged weights; train.log, of the same network,
    by real Caffe.
    """
    (folder / "snapshots").mkdir()
    packaged = ROOT / "models" / "paper_hand" / "paper_hand.caffemodel.h5"
    shutil.copyfile(packaged, folder / "snapshots" / "nyu_iter_1000.caffemodel.h5")
    shutil.copyfile(ROOT / "tests" / "caffe" / "logs" / "deepmodel_train.log", folder / "train.log")


def data(folder: Path) -> None:
    """data/nyu: a few synthetic frames, and the nets of prototxt/ with small batches."""
    out = folder / "data" / "nyu"
    assert (
        make_synthetic.main(["--out", str(out), "--train", "16", "--test", "16", "--workers", "1"])
        == 0
    )
    small_batches(folder)


def small_batches(folder: Path) -> None:
    """Write the nets of prototxt/ with 8 frames in a batch, and solvers that test on 2 batches."""
    for path in (folder / "prototxt").rglob("*.prototxt"):
        text = path.read_text(encoding="utf-8")
        text = re.sub(
            r"\bbatch_size: \d+", "batch_size: 8", re.sub(r"\btest_iter: \d+", "test_iter: 2", text)
        )
        path.write_text(text, encoding="utf-8")


def joints(folder: Path) -> None:
    """joints.txt: NYU's 14 joints of a few hands, as u v d."""
    hands = BodySampler(prior_file.load().but(scale_std=0, bone_std=0)).draw(
        np.random.default_rng(2), 3
    )
    # around the crop's centre
    joints_mm = kinematics_of(skeletons.load()).joints(hands.inputs) * CUBE_MM / 2
    uvd = NYU.project(joints_mm[:, EVALUATION_JOINTS] + (20, -30, 800))
    np.savetxt(folder / "joints.txt", uvd.reshape(len(uvd), -1), fmt="%.3f")


SOLVER = 'net: "{}" base_lr: 0.001 lr_policy: "fixed" max_iter: 3 snapshot_prefix: "net"'


def nets(folder: Path) -> None:
    """net.prototxt, solver.prototxt, deploy.prototxt and the weights net.caffemodel of a net
    with one layer.
    """
    dummy = 'layer { name: "in" type: "DummyData" top: "data" top: "label"'
    dummy += " dummy_data_param { shape { dim: 3 dim: 2 } } }\n"
    loss = 'layer { name: "loss" type: "EuclideanLoss" bottom: "fc" bottom: "label" top: "loss" }\n'
    fc = ip("fc", "data", "fc", outputs=2)
    (folder / "net.prototxt").write_text(dummy + fc + loss, encoding="utf-8")
    (folder / "deploy.prototxt").write_text(inputs(data=(1, 2)) + fc, encoding="utf-8")
    (folder / "solver.prototxt").write_text(SOLVER.format("net.prototxt"), encoding="utf-8")
    netlib.Net(folder / "deploy.prototxt", netlib.TEST).save(folder / "net.caffemodel")


PICTURES = """layer {
  name: "data" type: "ImageData" top: "data" top: "label"
  image_data_param { source: "list.txt" root_folder: "pictures/" new_height: 256 new_width: 256 batch_size: 2 }
  transform_param { mean_file: "mean.binaryproto" }
}
"""
LOSS = 'layer { name: "loss" type: "SoftmaxWithLoss" bottom: "fc7" bottom: "label" top: "loss" }\n'


def pictures(folder: Path) -> None:
    """pictures/, list.txt, train_test.prototxt, deploy.prototxt and solver.prototxt for
    them, and weights.
    """
    rng = np.random.default_rng(0)
    (folder / "pictures").mkdir()
    for n in range(4):
        picture = rng.integers(0, 256, (8, 8, 3), dtype=np.uint8)
        cv2.imwrite(str(folder / "pictures" / f"{n}.png"), picture)
    (folder / "list.txt").write_text(
        "".join(f"{n}.png {n % 2}\n" for n in range(4)), encoding="utf-8"
    )
    layers = ip("fc6", "data", "fc6") + ip("fc7", "fc6", "fc7", outputs=2)
    (folder / "train_test.prototxt").write_text(PICTURES + layers + LOSS, encoding="utf-8")
    (folder / "solver.prototxt").write_text(SOLVER.format("train_test.prototxt"), encoding="utf-8")
    (folder / "deploy.prototxt").write_text(
        inputs(data=(1, 3, 256, 256)) + layers, encoding="utf-8"
    )
    netlib.Net(folder / "deploy.prototxt", netlib.TEST).save(folder / "net_iter_1000.caffemodel")


CLASSES = ("bird", "cat", "dog")
CLASSIFIER = (
    inputs(data=(1, 3, 32, 32))
    + """
layer {
  name: "conv" type: "Convolution" bottom: "data" top: "conv"
  convolution_param { num_output: 4 kernel_size: 5 stride: 2 weight_filler { type: "xavier" } }
}
layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
layer { name: "pool" type: "Pooling" bottom: "conv" top: "pool" pooling_param { pool: MAX kernel_size: 3 stride: 2 } }
"""
)
DATABASE = """
layer {{ name: "d" type: "Data" top: "data" top: "label" transform_param {{ {} }}
        data_param {{ source: "not_here" batch_size: 9 backend: LMDB }} }}
"""


def classifier(folder: Path) -> None:
    """cat.png, dog.png, labels.txt; deploy.prototxt and net.caffemodel, which know them; list.txt
    and pictures/; two training nets.
    """
    rng, images = np.random.default_rng(0), []
    for name in CLASSES:
        images.append(np.full((32, 32, 3), rng.integers(0, 256, 3), np.uint8))
        cv2.imwrite(str(folder / f"{name}.png"), images[-1])
        (folder / "pictures" / name).mkdir(parents=True)
        for n in range(10):
            noisy = images[-1] + rng.normal(0, 20, images[-1].shape)
            picture = np.clip(noisy, 0, 255).astype(np.uint8)
            cv2.imwrite(str(folder / "pictures" / name / f"{n}.png"), picture)
    (folder / "labels.txt").write_text("".join(f"{name}\n" for name in CLASSES), encoding="utf-8")
    (folder / "list.txt").write_text(
        "".join(f"{name}.png {n}\n" for n, name in enumerate(CLASSES)), encoding="utf-8"
    )
    softmax = 'layer { name: "prob" type: "Softmax" bottom: "fc" top: "prob" }\n'
    (folder / "deploy.prototxt").write_text(
        CLASSIFIER + ip("fc", "pool", "fc") + softmax, encoding="utf-8"
    )
    for name, size in (
        ("train_val.prototxt", "crop_size: 224"),
        ("lenet_train_test.prototxt", "scale: 0.00390625"),
    ):
        text = DATABASE.format(size) + ip("fc", "data", "fc") + LOSS.replace("fc7", "fc")
        (folder / name).write_text(text, encoding="utf-8")
    net = netlib.Net(folder / "deploy.prototxt", netlib.TEST, seed=1)
    pool = net.forward(
        ["pool"], data=cv2.dnn.blobFromImages(images, 1.0, (32, 32), (104, 117, 123))
    )["pool"]
    net.params["fc"][0].data[...] = (
        np.linalg.pinv(pool.reshape(3, -1)) @ [[2, 0, 0], [0.1, 2, 0], [0.1, 0, 2]]
    ).T
    net.save(folder / "net.caffemodel")


BY_DOCUMENT: dict[str, tuple[Callable[[Path], Names], ...]] = {
    "README.md": (frames, frame, training, data),
    "docs/caffe.md": (nets,),
    "docs/caffe_nets.md": (classifier,),
    "docs/caffe_tools.md": (pictures,),
    "docs/data.md": (frame,),
    "docs/fit.md": (frames, frame),
    "docs/onnx.md": (frame,),
    "docs/reliability.md": (nets,),
    "docs/usage.md": (frames, frame, training, data, joints),
    "models/synthetic_hand/readme.md": (frame,),
}
# Packages that commands of a document need, and packages of extras that its Python blocks import.
NEEDS = {
    "docs/caffe_nets.md": ("onnx", "onnxruntime"),
    "docs/camera.md": ("av", "matplotlib"),
    "docs/onnx.md": ("onnx", "onnxruntime"),
    "docs/usage.md": ("matplotlib",),
}
OPTIONAL = ("av", "matplotlib", "onnx", "onnxruntime", "pydot", "rosbags", "torch", "tqdm")
