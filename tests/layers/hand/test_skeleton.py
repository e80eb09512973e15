"""Skeleton: reading, writing and changing skeleton files, and invalid files."""

from pathlib import Path

import numpy as np

import netlib
from layers.hand.skeleton import load, load_for
from layers.hand.skeleton_file import text_of
from tests.support.bad_input import bad_inputs, in_table

HAND = load()


def test_a_skeleton_has_the_values_of_its_file(skeleton, arm_text):
    body = skeleton(arm_text)
    assert body.name == "arm"
    assert body.dof_names == ["x", "y", "shoulder", "elbow"]
    assert body.joint_names == ["hand", "elbow", "base"]
    assert body.parents.tolist() == [1, 2, -1]
    assert body.bones.tolist() == [1, 2, 0]
    assert body.initial.tolist() == [0, 0.5, 0.25, 0]
    assert body.lower.tolist() == [-np.inf, -np.inf, -1, 0]
    assert not body.fixed.any()


def test_parents_come_first_and_motions_know_their_rows(skeleton, arm_text):
    """Parents come first, in any order of the file; fixed motions have no row in a Jacobian."""
    body = skeleton(arm_text.replace("initial: 0.25", "initial: 0.25 fixed: true"))
    assert body.order == [2, 1, 0]
    assert [[(m.kind, m.axis, m.dof, m.row) for m in own] for own in body.motions] == [
        [("rotate", 2, 3, 0)],
        [("rotate", 2, 2, -1)],
        [("translate", 0, 0, 1), ("translate", 1, 1, 2)],
    ]
    assert body.driven.tolist() == [3, 0, 1]
    assert body.turns.tolist() == [True, False, False]
    assert body.moves.tolist() == [[True, False, False], [True, True, True], [True, True, True]]


def test_the_hand_has_26_free_dofs_of_47_and_31_joints():
    assert (len(HAND.dof_names), int((~HAND.fixed).sum()), len(HAND.joint_names)) == (47, 26, 31)
    assert HAND.fixed.nonzero()[0].tolist() == [*range(6, 15), *range(19, 31)]
    assert np.count_nonzero(HAND.parents < 0) == 1


def test_a_written_skeleton_reads_back_the_same(tmp_path):
    path = tmp_path / "again.prototxt"
    path.write_text(text_of(HAND.param, "again", "A comment\nof two lines."))
    back = load(path)
    assert back.name == "again"
    assert back.param.joint == HAND.param.joint
    assert back.param.dof == HAND.param.dof
    assert text_of(back.param, "again", "A comment\nof two lines.") == path.read_text()


def test_a_scaled_hand():
    """Bones and initial translations are scaled; angles and limits are not."""
    larger = HAND.scaled(2)
    assert np.allclose(larger.bones, 2 * HAND.bones)
    assert np.allclose(larger.initial[:3], 2 * HAND.initial[:3])
    assert np.array_equal(larger.initial[3:], HAND.initial[3:])
    assert np.array_equal(larger.upper, HAND.upper)


def test_slides_can_be_freed(skeleton, arm_text):
    """with_free_slides frees only fixed translations and changes nothing else."""
    text = arm_text.replace("initial: 0.5", "initial: 0.5 fixed: true").replace(
        "initial: 0.25", "initial: 0.25 fixed: true"
    )
    table = skeleton(text)
    freed = table.with_free_slides()
    assert table.fixed.tolist() == [False, True, True, False]
    assert table.slides.tolist() == [True, True, False, False]
    assert freed.fixed.tolist() == [False, False, True, False]
    assert np.array_equal(freed.initial, table.initial)
    assert np.array_equal(freed.bones, table.bones)


@bad_inputs(
    netlib.PrototxtError,
    in_table(Path(__file__).with_name("skeleton_mistakes.txt"), "...skeleton0.prototxt:"),
)
def test_mistakes_in_a_skeleton_file(skeleton, arm_text, given, rejected):
    assert given[0] in arm_text
    with rejected:
        skeleton(arm_text.replace(*given))


@bad_inputs(
    netlib.PrototxtError,
    {
        **dict.fromkeys(
            ("", 'name: "empty"', 'dof { name: "x" }'),
            "...skeleton0.prototxt:1:1: error: this file has no joints; expected a skeleton",
        ),
        "no file": (
            None,
            netlib.NetlibError,
            "...gone.prototxt: cannot read the prototxt: No such file or directory",
        ),
    },
)
def test_files_without_a_skeleton_are_rejected(skeleton, tmp_path, given, rejected):
    with rejected:
        load(tmp_path / "gone.prototxt") if given is None else skeleton(given)


def test_the_same_relative_name_in_another_folder(tmp_path, monkeypatch, arm_text):
    """A relative name is resolved again after the working directory has changed."""
    for folder, length in (("a", 1), ("b", 3)):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "arm.prototxt").write_text(
            arm_text.replace("length: 1 ", f"length: {length} ")
        )
        monkeypatch.chdir(tmp_path / folder)
        assert load_for("arm.prototxt", None).bones[0] == length
