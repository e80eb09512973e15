"""A random body can be used like a hand: drawn, trained on, and fitted to joints and to depth."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import netlib
from handpose.estimate.nets import hand_layer
from handpose.estimate.predictor import Predictor
from handpose.fit.body import CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.joints.fit_joints import fit_joints
from handpose.fit.observation import HandCrops, observe
from handpose.fit.settings import SearchSettings
from handpose.frames.cameras import KINECT2
from handpose.frames.crops import crop_pixels, restore_joints
from handpose.scoring.held_out import errors_by_joint, figures_of, predict_all
from handpose.synthetic import prior_file
from handpose.synthetic.files import DataSet
from handpose.synthetic.generator import Generator, Recipe, SyntheticCamera
from handpose.synthetic.recipes import recipe_of
from handpose.synthetic.surface_prior import SurfacePrior
from handpose.tracking.tracker import Tracker
from layers.hand.skeleton import Skeleton
from netlib.errors import DataError, NetlibError
from tests.support.random_bodies import write_body

SEEDS = (1, 2, 3)
HALF = 450.0  # mm

NET = """
layer {{
  name: "data" type: "HDF5Data" top: "depth" top: "joint"
  hdf5_data_param {{ source: "{folder}/train.txt" batch_size: 32 }}
}}
layer {{
  name: "small" type: "Pooling" bottom: "depth" top: "small"
  pooling_param {{ pool: AVE kernel_size: 8 stride: 8 }}
}}
layer {{
  name: "conv" type: "Convolution" bottom: "small" top: "conv"
  convolution_param {{ num_output: 4 kernel_size: 3 weight_filler {{ type: "xavier" }} }}
}}
layer {{ name: "relu" type: "ReLU" bottom: "conv" top: "conv" }}
layer {{
  name: "dof" type: "InnerProduct" bottom: "conv" top: "dof"
  inner_product_param {{ num_output: {dofs} weight_filler {{ type: "gaussian" std: 0.001 }} }}
}}
layer {{
  name: "model" type: "HandModel" bottom: "dof" top: "pred"
  hand_model_param {{ skeleton: "{skeleton}" }}
}}
layer {{ name: "joint_loss" type: "EuclideanLoss" bottom: "pred" bottom: "joint" top: "joint_loss" }}
layer {{
  name: "limit_loss" type: "PhysLimit" bottom: "dof" top: "limit_loss"
  phys_limit_param {{ skeleton: "{skeleton}" }}
}}
"""


def exact_recipe(prior: Path) -> Recipe:
    """A recipe for bodies with the size and surface in the file, and a camera without noise."""
    own = prior_file.load(prior).but(scale_std=0.0, center_jitter=0.0)
    return Recipe(own, SurfacePrior(thickness_std=0.0), (SyntheticCamera(KINECT2, None),))


def net_text(folder: Path, skeleton: Skeleton) -> str:
    """Prototxt of a net with few channels for a body in this folder."""
    return NET.format(
        folder=folder, skeleton=folder / "body.prototxt", dofs=len(skeleton.dof_names)
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_frames(here: Path, seed: int) -> None:
    """Every joint is inside the visible surface, nothing is detached from the body, and the
    limits are kept.
    """
    recipe = exact_recipe(write_body(here, seed))
    frames, skeleton = Generator(seed, "train", recipe).block(0), recipe.prior.body()
    assert frames.dof is not None
    assert (frames.dof >= skeleton.lower - 1e-6).all()
    assert (frames.dof <= skeleton.upper + 1e-6).all()
    radius = max(max(capsule.radius) for capsule in skeleton.param.flesh.capsule)  # type: ignore[union-attr]
    joints = frames.joint.reshape(len(frames), -1, 3).astype(float)
    assert np.abs(joints).max() < 1
    uvd = frames.center_uvd.astype(float)
    seen = KINECT2.project(restore_joints(joints, frames.center.astype(float), HALF))
    pixels = crop_pixels(seen, uvd, 2 * HALF, KINECT2, 128)
    columns, rows = np.rint(pixels).astype(int).clip(0, 127).transpose(2, 0, 1)
    surface = frames.depth[:, 0][np.arange(len(frames))[:, None], rows, columns]
    assert (surface < joints[..., 2]).all()  # the surface is in front of each joint
    assert (frames.depth.min(axis=(1, 2, 3)) > joints[..., 2].min(axis=1) - radius - 0.02).all()
    assert len({frame.tobytes() for frame in frames.depth}) == len(frames)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_net_learns_it(here: Path, seed: int) -> None:
    """The loss decreases with the model and the limits of this body, and the scores are those
    of its joints.
    """
    prior = write_body(here, seed)
    skeleton = prior_file.load(prior).body()
    data = DataSet(here, [(Generator(0, "train", recipe_of(prior)), 64)])
    data.write(1, lambda done: None)
    Path("net.prototxt").write_text(net_text(here, skeleton))
    Path("solver.prototxt").write_text(
        'net: "net.prototxt" type: "Adam" base_lr: 0.003 momentum: 0.9 momentum2: 0.999\n'
        'lr_policy: "fixed" max_iter: 60 display: 0 random_seed: 1 snapshot_after_train: false\n'
    )
    solver = netlib.get_solver("solver.prototxt")
    losses = []
    for _ in range(60):
        solver.step(1)
        losses.append(
            float(solver.net.blobs["joint_loss"].data + solver.net.blobs["limit_loss"].data)
        )
    assert np.mean(losses[-4:]) < 0.7 * np.mean(losses[:4])
    net = netlib.Net("net.prototxt", netlib.TEST)
    solver.net.save("net.caffemodel.h5")
    net.copy_from("net.caffemodel.h5", strict=True)
    found = predict_all(net)
    layer = hand_layer(net)
    assert layer is not None
    figures = figures_of(found, layer.skeleton)
    assert {"error_mm", "within_60_mm", "within_120_mm", "out_of_limits"} == set(figures)
    each = errors_by_joint(found, layer.skeleton)
    assert list(each) == skeleton.joint_names
    assert np.mean(list(each.values())) == pytest.approx(figures["error_mm"])
    assert 0 < figures["error_mm"] < 2 * HALF


@pytest.mark.parametrize("seed", SEEDS)
def test_fits_to_joints(here: Path, seed: int) -> None:
    """The fit finds poses within the limits that reproduce all joints in nearly all frames."""
    recipe = exact_recipe(write_body(here, seed))
    bodies = Generator(seed, "train", recipe).scene(0).bodies
    skeleton = recipe.prior.body()
    found = fit_joints(skeleton, bodies.joints[:24], starts=12)
    assert (found.inputs >= skeleton.lower - 1e-9).all()
    assert (found.inputs <= skeleton.upper + 1e-9).all()
    assert np.mean(found.residuals.max(axis=1) < 1e-3) > 0.9


@pytest.mark.parametrize("seed", SEEDS)
def test_fits_to_depth(here: Path, seed: int) -> None:
    """A fit that starts at a disturbed pose ends nearer to the true pose."""
    recipe = exact_recipe(write_body(here, seed))
    scene = Generator(seed, "train", recipe).scene(0)
    model, n = CapsuleModel(recipe.prior.body(), HALF), 16
    truth = scene.bodies.joints[:n] * HALF
    rng = np.random.default_rng(seed)
    start = scene.bodies.inputs[:n] + rng.normal(0, 0.12, scene.bodies.inputs[:n].shape)
    shift = rng.normal(0, 0.02, (n, 3))
    start[:, :3] = scene.bodies.inputs[:n, :3] + shift
    seen = observe(HandCrops(scene.depth[:n], scene.center_uvd[:n], KINECT2, 2 * HALF), 300, 3.0)
    fit = DepthFitter(model).fit(seen, [model.variables_of(start)], SearchSettings().fast)
    before = np.linalg.norm(model.joints(model.variables_of(start)) - truth, axis=2).mean(axis=1)
    after = np.linalg.norm(fit.joints - truth, axis=2).mean(axis=1)
    assert after.mean() < 0.6 * before.mean() and (after < before).mean() > 0.8


def test_features_for_hands_reject_other_bodies(here: Path) -> None:
    """Detection, mirroring and tracking raise a one-line error."""
    prior = write_body(here, 1)
    text = net_text(here, prior_file.load(prior).body())
    start, end = text.index("layer {"), text.index('layer {\n  name: "small"')
    given = (
        'layer { name: "in" type: "Input" top: "depth" input_param { shape { dim: 1 dim: 1 dim: '
        "128 dim: 128 } } }\n"
    )
    Path("net.prototxt").write_text(
        text[:start] + given + text[end : text.index('layer { name: "joint_loss"')]
    )
    net = netlib.Net("net.prototxt", netlib.TEST)
    with pytest.raises(
        NetlibError, match="skeleton 'random1' is not a hand, so there is no left one"
    ):
        Predictor(net, KINECT2, cube_mm=900, hand="left")
    with pytest.raises(
        NetlibError, match=r"'random1' is not a hand: .*; expected the edge of its cube in mm"
    ):
        Predictor(net, KINECT2)
    predictor = Predictor(net, KINECT2, cube_mm=900, hand="either", fit="fast")
    assert predictor.sides == ("right",)
    frame = np.full((424, 512), 2000, np.uint16)
    with pytest.raises(
        DataError, match="skeleton 'random1' is not a hand, and only hands are searched for"
    ):
        predictor.in_frame(frame)
    found = predictor.in_frame(frame, (250.0, 200.0, 2100.0))
    assert np.isfinite(found.joints).all() and tuple(found.center_uvd) == (250, 200, 2100)
    predictor.finder = object()  # type: ignore[assignment]
    with pytest.raises(
        NetlibError,
        match="'random1' is not a hand: it has no joint 'palm'; only hands are followed",
    ):
        Tracker(predictor)
