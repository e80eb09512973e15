"""HingeLoss."""


X = [[2, -3, 0.5], [0.5, 1, -1]]
LABELS = [0, 1]  # margins 0 0 1.5 and 1.5 0 0; a margin of exactly 0 has gradient 0
L2 = 'type: "HingeLoss" hinge_loss_param { norm: L2 }'


def test_by_hand(run):
    """The loss is the sum of the margins divided by N."""
    done = run('type: "HingeLoss"', X, LABELS)
    assert done.y == 1.5
    [dx, _] = done.backward(4, wanted=[True, False])
    assert dx.tolist() == [[0, 0, 2], [2, 0, 0]]


def test_squares_by_hand(run):
    """With L2 the loss is the sum of the squared margins divided by N."""
    done = run(L2, X, LABELS)
    assert done.y == 2.25
    [dx, _] = done.backward(4, wanted=[True, False])
    assert dx.tolist() == [[0, 0, 6], [6, 0, 0]]


def test_the_label_pushes_the_other_way(run):
    """A positive score of the label below 1 has a negative gradient."""
    done = run('type: "HingeLoss"', [[0.25]], [0])
    assert done.y == 0.75
    assert done.backward(1, wanted=[True, False])[0].tolist() == [[-1]]


def test_the_norm_is_an_enum_from_1(run):
    """In numbers L1 is 1 and L2 is 2, as in caffe.proto."""
    assert run('type: "HingeLoss" hinge_loss_param { norm: 2 }', X, LABELS).y == 2.25
