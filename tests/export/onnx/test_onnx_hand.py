"""export/onnx/hand.py: the hand model, for any body."""

from pathlib import Path

import numpy as np
import pytest

from export.onnx.hand import steps_of
from export.onnx.net import load as load_net
from export.onnx.net import onnx_image
from layers.hand.kinematics import Kinematics
from layers.hand.skeleton import Skeleton, load
from layers.hand.skeleton_file import SkeletonParameter
from netlib.proto import prototxt, schema
from tests.support.onnx_nets import run_onnx


def test_steps_of_the_hand():
    """26 free motions follow a fixed one: six of the palm, then four of each finger, side by side."""
    steps, last, _ = steps_of(load(), load().bones)
    assert [sum(step.depth == d for step in steps) for d in range(11)] == [1] * 7 + [5] * 4
    assert last[load().joint_names.index("palm")] == 6
    assert max(last) == 26


def test_another_body(files, rng):
    """A body may have two roots, children before parents in the file, a turn about -z, and a joint without a DoF."""
    body = """
        name: "two" dof { name: "a" initial: 0.3 } dof { name: "b" fixed: true initial: 0.5 } dof { name: "c" }
        joint { name: "tip" parent: "arm" rotate { axis: NEG_Z dof: "c" } bone { axis: NEG_X length: 0.5 } }
        joint { name: "arm" translate { axis: NEG_Y dof: "a" } rotate { axis: X dof: "b" } bone { axis: Z length: 2 } }
        joint { name: "post" rotate { axis: Y dof: "b" } bone { axis: X length: 1 } }
        joint { name: "ring" parent: "tip" rotate { axis: Y dof: "a" } }
    """
    layer = 'layer {{ name: "h" type: "HandModel" bottom: "x0" top: "y" hand_model_param {{ skeleton: "{}" }} }}'
    Path("body.prototxt").write_text(body)
    net = load_net(*files(layer.format("body.prototxt"), (1, 3)))
    x = rng.normal(size=(4, 3)).astype(np.float32)
    skeleton = Skeleton(schema.read(prototxt.parse(body, "body"), SkeletonParameter, "skeleton"))
    found = run_onnx(onnx_image(net, cube_mm=900), x0=x)["y"].reshape(4, 4, 3)
    np.testing.assert_allclose(found, Kinematics(skeleton).joints(x), atol=1e-6)


@pytest.mark.parametrize("sizes", [1, 4])
def test_another_body_of_each_item(files, rng, sizes):
    """The size of each item's body is an input: bones after fixed turns, a fixed slide, a DoF that slides and turns."""
    Path("body.prototxt").write_text("""
        dof { name: "a" initial: 0.3 } dof { name: "b" fixed: true initial: 0.5 }
        dof { name: "c" fixed: true initial: -0.7 } dof { name: "d" }
        joint { name: "tip" parent: "arm" translate { axis: X dof: "c" } rotate { axis: NEG_Z dof: "d" }
                bone { axis: NEG_X length: 0.5 } }
        joint { name: "arm" translate { axis: NEG_Y dof: "a" } rotate { axis: X dof: "b" }
                bone { axis: Z length: 2 } }
        joint { name: "post" rotate { axis: Y dof: "b" } bone { axis: X length: 1 } }
        joint { name: "ring" parent: "tip" translate { axis: Z dof: "d" } rotate { axis: Y dof: "a" } }
    """)
    layer = 'layer { name: "h" type: "HandModel" bottom: "x0" bottom: "x1" top: "y" %s }'
    net = load_net(*files(layer % 'hand_model_param { skeleton: "body.prototxt" }', (1, 4), (1, sizes)))
    x = {"x0": rng.normal(size=(3, 4)).astype(np.float32), "x1": rng.normal(size=(3, sizes)).astype(np.float32)}
    found = run_onnx(onnx_image(net, cube_mm=900), **x)["y"]
    np.testing.assert_allclose(found, net.forward(**x)["y"], atol=2e-6)
