"""handpose/depth_fit/silhouette.py"""

from __future__ import annotations

import numpy as np

from handpose.depth_fit.body import CapsuleModel
from handpose.depth_fit.observation import observe
from handpose.depth_fit.residuals import belonging, cones_of
from handpose.depth_fit.silhouette import sphere_residuals, spheres_of
from handpose.facts.cameras import NYU
from tests.handpose.depth_fit.conftest import Scene, written_out


def test_spheres_are_on_the_skeletons_own_capsules(model: CapsuleModel) -> None:
    """Not on the forearm, whose end nobody knows."""
    capsule, place = spheres_of(model)
    assert not model.surface.limbs[capsule].any() and len(capsule) == (~model.surface.limbs).sum()
    assert (place == 1).all()


def test_nothing_sticks_out_of_its_own_picture(model: CapsuleModel, scene: Scene) -> None:
    """At the true pose hardly a sphere is where nothing was seen; a hand moved aside is."""
    spheres = spheres_of(model)
    still = sphere_residuals(cones_of(model, model.posed(scene.truth)), scene.seen, spheres, 3.0).value
    assert (still > 2).mean() < 0.02
    aside = scene.truth.copy()
    aside[:, 0] += 0.2  # 30 mm
    moved = sphere_residuals(cones_of(model, model.posed(aside)), scene.seen, spheres, 3.0).value
    assert (moved[:, 0] > 2).mean() > 0.2
    near = scene.truth.copy()
    near[:, 2] -= 0.2
    assert (
        sphere_residuals(cones_of(model, model.posed(near)), scene.seen, spheres, 3.0).value[:, 1] > 10
    ).mean() > 0.4


def test_how_they_change(model: CapsuleModel, scene: Scene) -> None:
    """The interpolated outline has an exact slope: residuals that stay active change as direction and swelling say."""
    spheres = spheres_of(model)
    x = scene.truth.copy()
    x[:, 0] += 0.1
    posed = model.posed(x)
    r = sphere_residuals(cones_of(model, posed), scene.seen, spheres, 3.0)
    J = written_out(model, posed, r)[:, 0]
    for v in range(0, model.variables, 3):
        d = np.zeros(model.variables)
        d[v] = 1e-3
        both = [
            sphere_residuals(cones_of(model, model.posed(x + sign * d)), scene.seen, spheres, 3.0).value.astype(float)
            for sign in (1, -1)
        ]
        active = (both[0][:, 0] > 0) & (both[1][:, 0] > 0) & (r.value[:, 0] > 0)
        off = np.abs((both[0] - both[1])[:, 0] / 2e-3 - J[..., v])[active]
        assert active.sum() > 25 and np.percentile(off, 80) < 4  # mm per radian, where no pixel's border is crossed


def test_a_sphere_before_a_plate() -> None:
    """By hand: a plate 30 mm behind the centre, a hand at the centre: before it by the depth and its radius."""
    from layers.hand import skeleton

    model = CapsuleModel(skeleton.load(), 150.0)
    crop = np.full((1, 128, 128), 0.2, np.float32)
    seen = observe(crop, [[320, 240, 700]], NYU, 300.0)
    x = np.zeros((1, model.variables))
    posed, spheres = model.posed(x), spheres_of(model)
    found = sphere_residuals(cones_of(model, posed), seen, spheres, 3.0)
    c, radius = cones_of(model, posed).of(belonging(found.capsule, len(model.start))).at(found.place)
    expected = np.maximum(30 - (c[:, 2] - radius) - 3, 0)
    shown = (np.abs(c[:, :2]) < 120).all(axis=1)
    np.testing.assert_allclose(found.value[:, 1][shown], expected[shown], atol=1e-3)
    assert (found.value[:, 0] == 0).all()  # the plate fills the picture
