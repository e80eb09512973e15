"""The plan of the fast engine for the paper's network.

A lost optimization would make it slower, but not wrong.
"""

from pathlib import Path

import netlib
from fast.convolution import FastConvolution
from fast.division import SliceBlob
from fast.slices import SlicedStep
from netlib.proto import prototxt

TRAIN_TEST = Path(__file__).resolve().parents[2] / "prototxt" / "nyu_train_test.prototxt"
INPUT = """layer {
    name: "data" type: "Input" top: "depth" top: "joint"
    input_param { shape { dim: 512 dim: 1 dim: 128 dim: 128 } shape { dim: 512 dim: 93 } }
}"""

# In execution order: the ReLUs run after the poolings, on a sixteenth and a quarter of the values.
LAYERS_OF_A_SLICE = [
    ("convL1", "FastConvolution"),
    ("poolL1", "FastPooling"),
    ("ReLUconvL1", "FastReLU"),
    ("convL2", "FastConvolution"),
    ("poolL2", "FastPooling"),
    ("ReLUconvL2", "FastReLU"),
    ("convL3", "FastConvolution"),
    ("ReLUconvL3", "FastReLU"),
]
WHOLE_LAYERS = [
    ("data", "Input"),
    ("FC1", "FastInnerProduct"),
    ("ReLUFC1", "FastReLU"),
    ("DropoutFC1", "Dropout"),
    ("FC2", "FastInnerProduct"),
    ("ReLUFC2", "FastReLU"),
    ("DropoutFC2", "Dropout"),
    ("DoF", "FastInnerProduct"),
    ("DoF_DoF_0_split", "Split"),
    ("HandModel", "FastHandModel"),
    ("joint_loss", "EuclideanLoss"),
    ("limit_loss", "PhysLimit"),
]
TILES = {"convL1": 4, "poolL1": 2, "convL2": 2, "poolL2": 2}  # tiles of all unstored blobs
SPARSE = {"convL1"}  # stored only where the image is not background
# algorithms of the convolutions
WAYS = {"convL1": "WindowTiles", "convL2": "RowTiles", "convL3": "RowTiles"}
ITEMS_PER_SLICE = 32


def paper_network() -> netlib.Net:
    """The network in training, with a batch of 512 images from the caller."""
    text = TRAIN_TEST.read_text()
    first = text.index("# Rows of the HDF5 files")
    return netlib.Net(
        prototxt.parse(INPUT + text[text.index("# Features", first) :]), netlib.TRAIN, engine="fast"
    )


def test_the_plan_of_the_papers_network() -> None:
    """The convolutional layers run together, 32 images at a time; the blobs between them are
    unstored and tiled.
    """
    net = paper_network()
    [sliced] = [step for step in net.steps if isinstance(step, SlicedStep)]
    pieces = sliced.pieces()
    # in place
    blobs = {at.layer.name: at.top[0] for at in pieces[0] if not at.layer.name.startswith("ReLU")}
    whole = [step.at.layer for step in net.steps if step is not sliced]

    assert [(at.layer.name, type(at.layer).__name__) for at in pieces[0]] == LAYERS_OF_A_SLICE
    assert [(layer.name, type(layer).__name__) for layer in whole] == WHOLE_LAYERS
    convolutions = [at.layer for at in pieces[0] if isinstance(at.layer, FastConvolution)]
    assert {layer.name: type(layer.tiles).__name__ for layer in convolutions} == WAYS
    assert [piece[0].bottom[0].shape[0] for piece in pieces] == [ITEMS_PER_SLICE] * (
        512 // ITEMS_PER_SLICE
    )
    assert {name: blob.tile for name, blob in blobs.items() if isinstance(blob, SliceBlob)} == TILES
    assert {
        name for name, blob in blobs.items() if isinstance(blob, SliceBlob) and blob.may_be_sparse
    } == SPARSE
