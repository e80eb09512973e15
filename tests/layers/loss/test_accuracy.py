"""Accuracy."""

import numpy as np
import pytest

SCORES = [[3, 2, 1], [1, 3, 2], [2, 1, 3], [3, 1, 2]]


def test_the_best_score_wins(run):
    """Accuracy is the fraction of labels that have the highest score."""
    assert run('type: "Accuracy"', SCORES, [0, 1, 0, 2]).y == 0.5


def test_top_k(run):
    """With top_k 2 a label counts if it has one of the two highest scores."""
    text = 'type: "Accuracy" accuracy_param { top_k: 2 }'
    assert run(text, SCORES, [0, 2, 1, 2]).y == 0.75


def test_nobody_is_among_the_best_none(run):
    """top_k 0 is allowed, as in Caffe, and gives 0."""
    ys = run('type: "Accuracy" accuracy_param { top_k: 0 }', SCORES, [0, 1, 0, 2], tops=2).ys
    assert ys[0] == 0
    assert not ys[1].any()


@pytest.mark.parametrize("shape", [(4,), (4, 1), (1, 4), (2, 2), (1, 4, 1, 1)])
def test_only_the_number_of_labels_counts(run, shape):
    """Only the number of labels must match, not their shape, as in Caffe."""
    assert run('type: "Accuracy"', SCORES, np.reshape([0, 1, 0, 2], shape)).y == 0.5


def test_ties_count_against_the_label(run):
    """A label whose score is tied with others does not count as correct."""
    assert run('type: "Accuracy"', np.zeros((2, 3)), [0, 1]).y == 0


def test_per_class(run):
    """The second top has the accuracy of each class, and 0 for a class without items."""
    ys = run('type: "Accuracy"', SCORES, [0, 0, 2, 0], tops=2).ys
    assert ys[0] == 0.75
    assert ys[1].tolist() == [2 / 3, 0, 1]


def test_ignored_labels_do_not_count(run):
    assert run('type: "Accuracy" accuracy_param { ignore_label: 255 }', SCORES, [0, 255, 255, 1]).y == 0.5
    assert run('type: "Accuracy" accuracy_param { ignore_label: 9 }', SCORES, [9, 9, 9, 9]).y == 0


def test_classes_on_another_axis(run, rng):
    """With axis -1 the classes are on the last axis."""
    scores = rng.normal(size=(2, 4, 3))
    labels = scores.argmax(axis=2)
    labels[0, 0] = (labels[0, 0] + 1) % 3
    assert run('type: "Accuracy" accuracy_param { axis: -1 }', scores, labels).y == 7 / 8
