"""Embed."""


TABLE = [[1.0, 2], [3, 4], [5, 6]]


def text(options=""):
    return f'type: "Embed" embed_param {{ num_output: 2 input_dim: 3 weight_filler {{ type: "gaussian" }} {options} }}'


def test_by_hand(run):
    """Each index selects a vector; the gradients of a repeated vector are added."""
    done = run(text(), [2, 0, 2], params=[TABLE, [10, 20]])
    assert done.y.tolist() == [[15, 26], [11, 22], [15, 26]]
    done.backward([[1, 2], [3, 4], [10, 20]], wanted=[False])
    assert done.layer.blobs[0].diff.tolist() == [[3, 4], [0, 0], [11, 22]]
    assert done.layer.blobs[1].diff.tolist() == [14, 26]
