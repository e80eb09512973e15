"""The figures of the book are drawn from the actual nets."""

from __future__ import annotations

import numpy as np

import netlib
from docs.making.figures import chain, graph, pictures
from netlib.proto import prototxt

NET = """
force_backward: true
layer { name: "in" type: "Input" top: "x" input_param { shape { dim: 2 dim: 3 dim: 6 dim: 5 } } }
layer { name: "c" type: "Convolution" bottom: "x" top: "c" convolution_param { num_output: 4 kernel_size: 3 } }
layer { name: "r" type: "ReLU" bottom: "c" top: "c" }
layer { name: "p" type: "Pooling" bottom: "c" top: "p" pooling_param { kernel_size: 2 stride: 2 } }
layer { name: "ip" type: "InnerProduct" bottom: "p" top: "ip" inner_product_param { num_output: 7 } loss_weight: 1 }
layer { name: "s" type: "Sigmoid" bottom: "p" top: "s" }
"""


def net() -> netlib.Net:
    """A picture of three channels, four maps of 4 x 3, pooled to 2 x 2."""
    return netlib.Net(prototxt.parse(NET), netlib.TRAIN)


def test_stages_count_what_a_layer_costs_for_one_picture() -> None:
    """A stage counts parameters, including biases, and one multiplication per weight and output value."""
    found = {stage.blob: stage for stage in pictures.stages(net())}
    assert list(found) == ["x", "c", "p", "p_p_0_split_0", "ip", "s"]
    assert (found["c"].shape, found["c"].parameters, found["c"].multiplications) == ((4, 4, 3), 112, 48 * 27)
    assert (found["p"].shape, found["p"].parameters, found["p"].multiplications) == ((4, 2, 2), 0, 0)
    assert (found["ip"].shape, found["ip"].parameters, found["ip"].multiplications) == ((7,), 119, 7 * 16)


def test_rows_hold_every_layer_once() -> None:
    """Each layer is drawn once: in-place layers beside their predecessor, consumers of a copy in the next column."""
    rows = graph.rows_of(net())
    assert [(row.at.layer.name, row.column, [at.layer.name for at in row.in_place]) for row in rows] == [
        ("in", 0, []), ("c", 0, ["r"]), ("p", 0, []), ("p_p_0_split", 0, []), ("ip", 0, []), ("s", 1, []),
    ]


def test_the_graph_is_of_the_papers_training_net() -> None:
    """The graph has all layers of the file in the phase TRAIN, and the batch size of its data layer."""
    drawn = graph.train_test()
    assert [layer.type for layer in drawn.layers].count("InnerProduct") == 3
    assert drawn.blobs["depth"].shape == (512, 1, 128, 128)
    assert [blob.shape for blob, _, _ in drawn.losses] == [(), ()]


def test_a_difference_has_a_best_step() -> None:
    """Central differences in float64 are best near 1e-5; float32 and one-sided ones never reach six digits."""
    best = chain.error(np.float64, 1e-5, "central")
    assert best < 1e-9
    assert all(chain.error(np.float64, h, "central") > 10 * best for h in (1e-12, 1e-9, 1e-3, 1e-1))
    assert min(chain.error(np.float32, h, "central") for h in np.logspace(-7, 0, 50)) > 1e-6
    assert chain.error(np.float64, 1e-5, "one-sided") > 1e-6
