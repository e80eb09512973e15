"""Layers that compute with several values: ArgMax, Axpy, Eltwise, Embed, Reduction and
Softmax, by hand.
"""

import numpy as np
import pytest

X = [[[3.0, 1], [4, 2]], [[0, -1], [-2, 0]]]  # two items; the second has equal values
A, B, C = [1.0, 2, -3], [4.0, 2, 0], [0.5, 2, 5]
R = [[1.0, -2, 3], [0, 4, -5]]
ROWS = [[[[1, 2]], [[3, 4]]]], [[[[5, 5]], [[6, 6]]]]

# type and options, bottoms, tops, dy, dx
BY_HAND = [
    # of the equal values of item 1, at 0 and 3, the last one
    ("ArgMax", [X], [[[[2]], [[3]]]], 0, []),
    # without ``axis`` the top has at least three axes
    ("ArgMax", [[1.0, 2]], [[[[0]], [[0]]]], 0, []),
    ("ArgMax", [np.zeros((2, 1, 2, 3))], [np.full((2, 1, 1, 1), 5)], 0, []),
    ("ArgMax argmax_param { top_k: 3 }", [X], [[[[2, 0, 3]], [[3, 0, 1]]]], 0, []),
    (
        "ArgMax argmax_param { top_k: 2 out_max_val: true }",
        [X],
        [[[[2, 0], [4, 3]], [[3, 0], [0, 0]]]],
        0,
        [],
    ),
    ("ArgMax argmax_param { axis: 1 }", [X], [[[[1, 1]], [[0, 1]]]], 0, []),
    ("ArgMax argmax_param { axis: -1 }", [X], [[[[0], [0]], [[0], [1]]]], 0, []),
    # not the indices
    ("ArgMax argmax_param { axis: 1 out_max_val: true }", [X], [[[[4, 2]], [[0, 0]]]], 0, []),
    (
        "ArgMax argmax_param { axis: 2 top_k: 2 }",
        [X],
        [[[[0, 1], [0, 1]], [[0, 1], [1, 0]]]],
        0,
        [],
    ),
    ("ArgMax argmax_param { axis: 0 }", [X], [[[[0, 0], [0, 0]]]], 0, []),
    *(
        (
            "Axpy",
            [np.reshape([2, 10], shape), *ROWS],
            [[[[[7, 9]], [[36, 46]]]]],
            [[[[1, 1]], [[0, 1]]]],
            [np.reshape([3, 4], shape), [[[[2, 2]], [[0, 10]]]], [[[[1, 1]], [[0, 1]]]]],
        )
        for shape in ((1, 2), (1, 2, 1, 1))
    ),
    ("Eltwise", [A, B, C], [[5.5, 6, 2]], [1, 1, 1], [[1, 1, 1]] * 3),
    (
        "Eltwise eltwise_param { coeff: 2 coeff: -2 coeff: 0.5 }",
        [A, B, C],
        [[-5.75, 1, -3.5]],
        [1, 1, 1],
        [[2] * 3, [-2] * 3, [0.5] * 3],
    ),
    (
        "Eltwise eltwise_param { operation: PROD }",
        [A, B, C],
        [[2, 8, 0]],
        [1, 1, 1],
        [[2, 4, 0], [0.5, 4, -15], [4, 4, 0]],
    ),
    # of equal values the second one
    (
        "Eltwise eltwise_param { operation: MAX }",
        [A, B, C],
        [[4, 2, 5]],
        [1, 1, 1],
        [[0, 0, 0], [1, 1, 0], [0, 0, 1]],
    ),
    # ignored
    ("Eltwise eltwise_param { operation: MAX coeff: -1 coeff: 5 }", [A, B], [[4, 2, 0]], 0, []),
    (
        "Eltwise eltwise_param { operation: PROD stable_prod_grad: false }",
        [A, B],
        [[4, 4, 0]],
        [1, 1, 1],
        [[4, 2, 0], [1, 2, np.nan]],
    ),  # without a warning, as in Caffe
    ("Reduction", [R], [1], 10, [[[10, 10, 10], [10, 10, 10]]]),
    (
        "Reduction reduction_param { operation: ASUM }",
        [R],
        [15],
        10,
        [[[10, -10, 10], [0, 10, -10]]],
    ),
    (
        "Reduction reduction_param { operation: SUMSQ coeff: 0.5 }",
        [R],
        [27.5],
        10,
        [[[10, -20, 30], [0, 40, -50]]],
    ),
    *(
        (
            f"Reduction reduction_param {{ operation: {mean} coeff: 3 }}",
            [R],
            [0.5],
            10,
            [[[5, 5, 5], [5, 5, 5]]],
        )
        for mean in ("MEAN", "4")
    ),  # the enum starts at 1 in caffe.proto
    ("Reduction reduction_param { axis: 1 }", [R], [[2, -1]], 0, []),
    ("Reduction reduction_param { operation: MEAN axis: -1 }", [R], [[2 / 3, -1 / 3]], 0, []),
    ("Reduction reduction_param { operation: SUMSQ axis: 1 }", [R], [[14, 41]], 0, []),
    ("Reduction reduction_param { operation: ASUM axis: 1 coeff: -1 }", [R], [[-6, -9]], 0, []),
    (
        "Reduction reduction_param { axis: 2 }",
        [np.ones((2, 3, 4, 5))],
        [np.full((2, 3), 20)],
        0,
        [],
    ),
    # y (dy - <y, dy>) with dy = (8, 0, 0): <y, dy> = 1
    (
        "Softmax",
        [[[0, np.log(2), np.log(5)]]],
        [[[1 / 8, 2 / 8, 5 / 8]]],
        [[8, 0, 0]],
        [[[7 / 8, -2 / 8, -5 / 8]]],
    ),
    ("Softmax", [[[1e4, 0, -1e4]]], [[[1, 0, 0]]], 0, []),
]


@pytest.mark.parametrize(("layer", "bottoms", "tops", "dy", "dx"), BY_HAND)
def test_by_hand(by_hand, layer, bottoms, tops, dy, dx):
    by_hand(layer, bottoms, tops, [dy], dx)


def test_embed_by_hand(by_hand):
    """Each index selects a vector; the gradients of a repeated vector are added."""
    by_hand(
        "Embed embed_param { num_output: 2 input_dim: 3 }",
        [[2, 0, 2]],
        [[[15, 26], [11, 22], [15, 26]]],
        [[[1, 2], [3, 4], [10, 20]]],
        [None],
        [[[3, 4], [0, 0], [11, 22]], [14, 26]],
        params=[[[1, 2], [3, 4], [5, 6]], [10, 20]],
    )
