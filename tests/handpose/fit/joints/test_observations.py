"""handpose/fit/joints/observations.py: annotated frames of one person."""

import numpy as np
import pytest

from handpose.body.nyu import EVALUATION_JOINTS
from handpose.fit.joints.observations import read_observations
from handpose.synthetic.pose_prior import BodySampler
from layers.hand import skeleton
from layers.hand.bodies import kinematics_of
from netlib.errors import DataError
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5, write_joints

HAND = skeleton.load()


@pytest.fixture(scope="module")
def frames():
    return np.clip(kinematics_of(HAND).joints(BodySampler().draw(np.random.default_rng(0), 30).inputs) * 0.8, -1, 1)


def test_annotation_of_a_list(frames, tmp_path):
    """Rows of all files are read in order, with each frame's cube; joints on the cube's faces are NaN."""
    frames = frames.copy()
    frames[3, 10, 1] = 1
    write_joints(tmp_path / "a.h5", frames[:20], half_cube=np.full(20, 130.5))
    write_joints(tmp_path / "b.h5", frames[20:])
    (tmp_path / "list.txt").write_text("a.h5\nb.h5\n")
    found = read_observations(tmp_path / "list.txt", HAND, half_cube=125)
    assert found.joints == tuple(range(31)) and found.rows == 30 and found.unseen == 1
    assert found.half_cube.tolist() == [130.5] * 20 + [125] * 10
    assert np.isnan(found.targets[3, 10]).all() and np.isnan(found.targets).sum() == 3
    seen = ~np.isnan(found.targets)
    assert np.allclose(found.targets[seen], frames[seen], atol=1e-7)


def test_some_joints_and_some_frames(frames, tmp_path):
    """14 joints are taken of 31 or 14; a seed selects the same frames again; frames mostly clipped are omitted."""
    fourteen = frames[:, EVALUATION_JOINTS]
    for joints, rows in ((14, frames), (None, fourteen), (14, fourteen)):
        found = read_observations(write_joints(tmp_path / "a.h5", rows), HAND, joints)
        assert found.joints == EVALUATION_JOINTS and np.allclose(found.targets, fourteen, atol=1e-7)
    drawn = [read_observations(tmp_path / "a.h5", HAND, frames=22, seed=seed).targets for seed in (0, 0, 1)]
    assert len(drawn[0]) == 22 and np.array_equal(drawn[0], drawn[1]) and not np.array_equal(drawn[0], drawn[2])
    cut = frames.copy()
    cut[7, :20] = -1
    assert len(read_observations(write_joints(tmp_path / "a.h5", cut), HAND).targets) == 29
    icvl = skeleton.load(skeleton.NYU_HAND.with_name("icvl.prototxt"))
    assert read_observations(write_joints(tmp_path / "a.h5", frames[:, :16]), icvl).joints == tuple(range(16))


CUBE = "have half of their joints within the cube (-1 to 1), expected 20 or more"


@bad_inputs(DataError, {
    "none.txt": "...none.txt: the list of HDF5 files is empty",
    "empty.h5": "...empty.h5: no data set 'joint'; it has depth",
    "a.h5": "...a.h5: data set 'joint' has shape (30, 90), expected (N, 93) for 31 joints or (N, 42) for 14 joints",
    "b.h5": "...b.h5: data set 'joint' is infinite in frame 4 (1 such frames), expected half-cubes from the crop ...",
    "c.h5": f"...c.h5: 19 of 19 frames {CUBE}",
    "d.h5": f"...d.h5: 0 of 30 frames {CUBE}",
    "mixed.txt": "...mixed.txt: some files have 14 joints, others 31; expected as many in all",
    "fourteen.h5": "...fourteen.h5: has 14 joints of a skeleton of 31; 31 cannot be taken of them",
})
def test_files_that_cannot_be_used(frames, tmp_path, given, rejected):
    """Each unusable file raises an error with its reason."""
    infinite = frames.copy()
    infinite[4, 2, 1] = np.inf
    for name, joints in (("fourteen", frames[:, :14]), ("a", frames[:, 1:]), ("b", infinite), ("c", frames[:19]),
                         ("d", frames * 150)):
        write_joints(tmp_path / f"{name}.h5", joints)
    for name, text in (("none", ""), ("mixed", "c.h5\nfourteen.h5\n")):
        (tmp_path / f"{name}.txt").write_text(text)
    write_hdf5(tmp_path / "empty.h5", depth=np.zeros((3, 2)))
    with rejected:
        read_observations(tmp_path / given, HAND, *([31] if given == "fourteen.h5" else []))
