"""Files that documents assume a reader to have: camera frames, a crop, trained weights, joints, a data set, a log."""

from __future__ import annotations

import functools
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

import netlib
from handpose.body.nyu import CUBE_MM, EVALUATION_JOINTS
from handpose.frames import crops
from handpose.frames.cameras import KINECT2, NYU
from handpose.frames.recording import DepthFrame
from handpose.frames.writing import RecordingWriter
from handpose.sequences.recordings import SyntheticRecording
from handpose.synthetic import prior_file
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton as skeletons
from layers.hand.bodies import kinematics_of
from netlib.caffe import blob_from_images
from tools import make_synthetic

ROOT = Path(__file__).resolve().parents[2]
Names = dict[str, object]
CameraInfo = Callable[[Path], Names]
SECONDS = 0.1  # of the hand in front of the camera


@functools.cache
def _recording() -> tuple[SyntheticRecording, tuple[DepthFrame, ...]]:
    recording = SyntheticRecording("moving", KINECT2, seconds=SECONDS, seed=1)
    return recording, tuple(recording)


def frames(folder: Path) -> Names:
    """frames/: a Kinect v2's frames of a moving hand, with camera.json."""
    recording, seen = _recording()
    with RecordingWriter(folder / "frames", recording.camera, recording.unit_mm, recording.rate) as writer:
        for frame in seen:
            writer.write(frame)
    return {}


def frame(folder: Path) -> Names:
    """frame.png, the first of the frames; ``depth``, its depth in mm."""
    depth = np.rint(_recording()[1][0].depth).astype(np.uint16)
    cv2.imwrite(str(folder / "frame.png"), depth)
    return {"depth": depth}


def crop(folder: Path) -> Names:
    """crop.png, the hand in that frame, and ``crop``, the same as a net's input."""
    recording, seen = _recording()
    (hand,) = recording.truth(0).hands
    cut = crops.crop(seen[0].depth, hand.center_uvd, CUBE_MM, KINECT2)
    cv2.imwrite(str(folder / "crop.png"), np.rint((cut + 1) * 127.5).astype(np.uint8))
    return {"crop": cut}


def weights(folder: Path) -> Names:
    """snapshots/nyu_iter_1000.caffemodel.h5: the packaged weights, for the same network."""
    (folder / "snapshots").mkdir(exist_ok=True)
    packaged = ROOT / "models" / "paper_hand" / "paper_hand.caffemodel.h5"
    shutil.copyfile(packaged, folder / "snapshots" / "nyu_iter_1000.caffemodel.h5")
    return {}


def log(folder: Path) -> Names:
    """train.log: a log of this network's training by real Caffe."""
    shutil.copyfile(ROOT / "tests" / "caffe" / "logs" / "deepmodel_train.log", folder / "train.log")
    return {}


def data(folder: Path) -> Names:
    """data/nyu: a few synthetic frames, and the nets of prototxt/ with small batches."""
    out = folder / "data" / "nyu"
    assert make_synthetic.main(["--out", str(out), "--train", "16", "--test", "16", "--workers", "1"]) == 0
    small_batches(folder)
    return {}


def small_batches(folder: Path) -> None:
    """Write the nets of prototxt/ with 8 frames in a batch, and solvers that test on 2 batches."""
    for path in (folder / "prototxt").rglob("*.prototxt"):
        text = path.read_text(encoding="utf-8")
        text = re.sub(r"\bbatch_size: \d+", "batch_size: 8", re.sub(r"\btest_iter: \d+", "test_iter: 2", text))
        path.write_text(text, encoding="utf-8")


def _joints_mm(count: int) -> NDArray[np.float64]:
    """Return (count, 31, 3): hands of the packaged size around the crop's centre."""
    hands = BodySampler(prior_file.load().but(scale_std=0, bone_std=0)).draw(np.random.default_rng(2), count)
    return kinematics_of(skeletons.load()).joints(hands.inputs) * CUBE_MM / 2


def joints(folder: Path) -> Names:
    """joints.txt: NYU's 14 joints of a few hands, as u v d."""
    uvd = NYU.project(_joints_mm(3)[:, EVALUATION_JOINTS] + (20, -30, 800))
    np.savetxt(folder / "joints.txt", uvd.reshape(len(uvd), -1), fmt="%.3f")
    return {}


NET = """
layer { name: "in" type: "DummyData" top: "data" top: "label" dummy_data_param { shape { dim: 3 dim: 2 } } }
layer { name: "fc" type: "InnerProduct" bottom: "data" top: "fc" inner_product_param { num_output: 2 } }
layer { name: "loss" type: "EuclideanLoss" bottom: "fc" bottom: "label" top: "loss" }
"""
DEPLOY = """
layer { name: "in" type: "Input" top: "data" input_param { shape { dim: 1 dim: 2 } } }
layer { name: "fc" type: "InnerProduct" bottom: "data" top: "fc" inner_product_param { num_output: 2 } }
"""
OF_PICTURES = """
layer {
  name: "data" type: "ImageData" top: "data" top: "label"
  image_data_param { source: "list.txt" root_folder: "pictures/" new_height: 256 new_width: 256 batch_size: 2 }
  transform_param { mean_file: "mean.binaryproto" }
}
layer { name: "fc6" type: "InnerProduct" bottom: "data" top: "fc6" inner_product_param { num_output: 2 } }
layer { name: "fc7" type: "InnerProduct" bottom: "fc6" top: "fc7" inner_product_param { num_output: 2 } }
layer { name: "loss" type: "SoftmaxWithLoss" bottom: "fc7" bottom: "label" top: "loss" }
"""
SOLVER = 'net: "{}" base_lr: 0.001 lr_policy: "fixed" max_iter: 3 snapshot_prefix: "net"'


def nets(folder: Path) -> Names:
    """net.prototxt, solver.prototxt, deploy.prototxt and the weights net.caffemodel of a net with one layer."""
    (folder / "net.prototxt").write_text(NET, encoding="utf-8")
    (folder / "deploy.prototxt").write_text(DEPLOY, encoding="utf-8")
    (folder / "solver.prototxt").write_text(SOLVER.format("net.prototxt"), encoding="utf-8")
    netlib.Net(folder / "deploy.prototxt", netlib.TEST).save(folder / "net.caffemodel")
    return {}


def pictures(folder: Path) -> Names:
    """pictures/, list.txt, train_test.prototxt, deploy.prototxt and solver.prototxt for them, and weights."""
    rng = np.random.default_rng(0)
    (folder / "pictures").mkdir()
    for n in range(4):
        cv2.imwrite(str(folder / "pictures" / f"{n}.png"), rng.integers(0, 256, (8, 8, 3), dtype=np.uint8))
    (folder / "list.txt").write_text("".join(f"{n}.png {n % 2}\n" for n in range(4)), encoding="utf-8")
    (folder / "train_test.prototxt").write_text(OF_PICTURES, encoding="utf-8")
    (folder / "solver.prototxt").write_text(SOLVER.format("train_test.prototxt"), encoding="utf-8")
    layers = OF_PICTURES[OF_PICTURES.index("layer", 7) : OF_PICTURES.rindex("layer")]
    shape = 'input: "data" input_shape { dim: 1 dim: 3 dim: 256 dim: 256 }\n'
    (folder / "deploy.prototxt").write_text(shape + layers, encoding="utf-8")
    netlib.Net(folder / "deploy.prototxt", netlib.TEST).save(folder / "net_iter_1000.caffemodel")
    return {}


CLASSES = ("bird", "cat", "dog")
DEPLOY_OF_PICTURES = """
layer { name: "data" type: "Input" top: "data" input_param { shape { dim: 1 dim: 3 dim: 32 dim: 32 } } }
layer {
  name: "conv" type: "Convolution" bottom: "data" top: "conv"
  convolution_param { num_output: 4 kernel_size: 5 stride: 2 weight_filler { type: "xavier" } }
}
layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
layer { name: "pool" type: "Pooling" bottom: "conv" top: "pool" pooling_param { pool: MAX kernel_size: 3 stride: 2 } }
layer { name: "fc" type: "InnerProduct" bottom: "pool" top: "fc" inner_product_param { num_output: 3 } }
layer { name: "prob" type: "Softmax" bottom: "fc" top: "prob" }
"""


def classifier(folder: Path) -> Names:
    """cat.png, dog.png, labels.txt; deploy.prototxt and net.caffemodel, which know them; list.txt for training."""
    rng, images = np.random.default_rng(0), []
    for name in CLASSES:
        images.append(np.full((32, 32, 3), rng.integers(0, 256, 3), np.uint8))
        cv2.imwrite(str(folder / f"{name}.png"), images[-1])
    (folder / "labels.txt").write_text("".join(f"{name}\n" for name in CLASSES), encoding="utf-8")
    (folder / "list.txt").write_text("".join(f"{name}.png {n}\n" for n, name in enumerate(CLASSES)), encoding="utf-8")
    (folder / "deploy.prototxt").write_text(DEPLOY_OF_PICTURES, encoding="utf-8")
    net = netlib.Net(folder / "deploy.prototxt", netlib.TEST, seed=1)
    pool = net.forward(["pool"], data=blob_from_images(images, 1.0, (32, 32), (104, 117, 123)))["pool"]
    net.params["fc"][0].data[...] = 2 * np.linalg.pinv(pool.reshape(len(CLASSES), -1)).T
    net.save(folder / "net.caffemodel")
    return {}


BY_DOCUMENT: dict[str, tuple[CameraInfo, ...]] = {
    "README.md": (frames, frame, weights, data),
    "docs/caffe.md": (nets,),
    "docs/caffe_nets.md": (classifier,),
    "docs/caffe_tools.md": (pictures,),
    "docs/camera.md": (frames,),
    "docs/data.md": (frame,),
    "docs/fit.md": (frames, frame),
    "docs/onnx.md": (crop,),
    "docs/reliability.md": (nets,),
    "docs/usage.md": (frames, frame, crop, weights, log, data, joints),
    "models/synthetic_hand/readme.md": (frame,),
}
NEEDS = {  # packages that commands of a document need; a Python block that imports a package is not listed
    "docs/caffe_nets.md": ("onnx", "onnxruntime"),
    "docs/camera.md": ("av", "matplotlib"),
    "docs/onnx.md": ("onnx", "onnxruntime"),
    "docs/usage.md": ("matplotlib",),
}
