"""export/onnx/hand.py: the hand model, for any body."""

from pathlib import Path

import numpy as np
import pytest

from export.onnx.hand import steps_of
from export.onnx.net import load as load_net
from export.onnx.net import onnx_image
from layers.hand.skeleton import load
from tests.support.onnx_nets import check_older, run_onnx


def test_steps_of_the_hand():
    """26 free motions follow a fixed one: six of the palm, then four of each
    finger, side by side.
    """
    steps, last, _ = steps_of(load(), load().bones)
    assert [sum(step.depth == d for step in steps) for d in range(11)] == [1] * 7 + [5] * 4
    assert last[load().joint_names.index("palm")] == 6
    assert max(last) == 26


@pytest.mark.parametrize("sizes", [0, 1, 4])
def test_another_body(files, rng, sizes):
    """Two roots, children before parents in the file, bones after fixed turns, a fixed slide, a DoF
    that slides and turns, a joint without a DoF; the size of each item's body may be an input.
    """
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
    shapes = [(1, 4), (1, sizes)] if sizes else [(1, 4)]
    bottoms = " ".join(f'bottom: "x{i}"' for i in range(len(shapes)))
    body = 'hand_model_param { skeleton: "body.prototxt" }'
    net = load_net(
        *files(f'layer {{ name: "h" type: "HandModel" {bottoms} top: "y" {body} }}', *shapes)
    )
    x = {
        f"x{i}": rng.normal(size=(3, *shape[1:])).astype(np.float32)
        for i, shape in enumerate(shapes)
    }
    found = run_onnx(onnx_image(net, cube_mm=900), **x)["y"]
    np.testing.assert_allclose(found, net.forward(**x)["y"], atol=2e-6)
    check_older(net, 900)


def test_a_cube_of_unknown_size_is_left_out_of_the_metadata(files, onnx):
    net = load_net(*files('layer { name: "h" type: "HandModel" bottom: "x0" top: "y" }', (1, 47)))
    kept = [
        {entry.key for entry in onnx.load_from_string(image).metadata_props}
        for image in (onnx_image(net), onnx_image(net, cube_mm=300))
    ]
    assert kept[1] - kept[0] == {"cube_mm"}
