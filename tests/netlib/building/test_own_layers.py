"""User-defined Python layers, and invalid layer names and options: each error is one line
with its position.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import netlib
from netlib import caffe
from netlib.building import python_layer
from netlib.proto import prototxt
from tests.netlib.conftest import MakeModule
from tests.support.bad_input import bad_inputs
from tests.support.nets import inputs

pytestmark = pytest.mark.both_engines

SQUARE = """
import netlib
import numpy as np
from numpy.linalg import inv as inverse

class Square(netlib.Layer):
    def setup(self, bottom, top):
        self.factor = float(self.param_str or 1)

    def reshape(self, bottom, top):
        top[0].reshape(*bottom[0].shape)

    def forward(self, bottom, top):
        top[0].data[...] = self.factor * bottom[0].data ** 2

    def backward(self, top, propagate_down, bottom):
        if propagate_down[0]:
            bottom[0].diff[...] = 2 * self.factor * bottom[0].data * top[0].diff

class Broken(Square):
    def forward(self, bottom, top):
        1 / 0

class Failing(Square):
    def forward(self, bottom, top):
        self.fail = 1
        1 / 0

class Singular(Square):
    def backward(self, top, propagate_down, bottom):
        inverse(np.zeros((2, 2)))

class TooFew(Square):
    def reshape(self, bottom):
        pass

class Counting(Square):
    def __init__(self, layer_param):
        super().__init__(layer_param)
        self.passes = int(self.param_str or 0)

    def forward(self, bottom, top):
        super().forward(bottom, top)
        self.passes += 1

class Named(Square):
    def setup(self, bottom, top):
        self.name = "mine"

class Specified(Square):
    def setup(self, bottom, top):
        self.spec = {}

class Unprepared(Square):
    def __init__(self, *args):
        {}[args[0].name]

class Stranger:
    pass

class Gain(Square):
    def setup(self, bottom, top):
        super().setup(bottom, top)
        assert self.param_str_ == self.param_str  # its name in early 2015, which layers such as Fast R-CNN's read
        self.blobs.add_blob(1)
        self.blobs[0].data[...] = 1

    def forward(self, bottom, top):
        super().forward(bottom, top)
        top[0].data[...] = self.blobs[0].data * top[0].data + (self.phase == netlib.TEST)

    def backward(self, top, propagate_down, bottom):
        super().backward(top, propagate_down, bottom)
        self.blobs[0].diff[...] += (self.factor * bottom[0].data ** 2 * top[0].diff).sum()
"""


def text_with(layer: str) -> prototxt.Message:
    return prototxt.parse("force_backward: true " + inputs(x=(3,)) + layer, "f")


def net_with(layer: str) -> netlib.Net:
    return netlib.Net(text_with(layer), netlib.TRAIN)


def python(name: str, module: str = "squares", more: str = "") -> str:
    param = f'python_param {{ module: "{module}" layer: "{name}" {more} }}'
    return f'layer {{ name: "own" type: "Python" bottom: "x" top: "y" {param} }}'


@pytest.fixture
def squares(module: MakeModule) -> None:
    module("squares", SQUARE)


def test_a_python_layer(squares: None) -> None:
    """It has what Caffe's have: four methods, param_str, the phase and ``blobs.add_blob``."""
    net = net_with(python("Gain", more='param_str: "3"'))
    assert net.forward(x=np.array([1, 2, 3]))["y"].tolist() == [3, 12, 27]
    assert net.backward(y=np.ones(3))["x"].tolist() == [6, 12, 18]
    assert net.params["own"][0].diff.tolist() == [3 + 12 + 27]
    assert [p.label for p in net.learnable] == ["own/0"]
    assert netlib.Net(text_with(python("Gain")), netlib.TEST).forward()["y"].tolist() == [1, 1, 1]


def test_a_part_reads_what_a_caller_has_written_to_a_blob_with_other_readers(squares: None) -> None:
    net = net_with(python("Square") + 'layer { name: "abs" type: "AbsVal" bottom: "x" top: "z" }')
    for value in (2, 3):
        net.forward(x=np.zeros(3))
        net.blobs["x"].data[...] = value
        assert net.forward(start="own")["y"].tolist() == [value**2] * 3


def test_a_python_layer_may_derive_from_ours(module: MakeModule) -> None:
    module(
        "steeper",
        """
from layers.activation.tanh import TanH

class Steeper(TanH):
    def forward(self, bottom, top):
        super().forward(bottom, top)
        top[0].data[...] *= 2
""",
    )
    net = net_with(python("Steeper", "steeper"))
    assert np.allclose(net.forward(x=np.array([0, 1, -2]))["y"], 2 * np.tanh([0, 1, -2]))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("Broken", r"forward failed: ZeroDivisionError: division by zero \(squares.py:22\)"),
        # with an attribute of the name of a method of ours
        ("Failing", r"forward failed: ZeroDivisionError: division by zero \(squares.py:27\)"),
        # raised in a file of NumPy's
        ("Singular", r"backward failed: LinAlgError: Singular matrix \(squares.py:31\)"),
        (
            "TooFew",
            r".* failed: TypeError: .*reshape\(\) takes 2 positional arguments but 3 were given.*",
        ),
    ],
)
def test_a_python_layer_that_fails(squares: None, name: str, message: str) -> None:
    """The error names the layer, its method, the exception, and the innermost line of the
    user's own file.
    """
    with pytest.raises(netlib.LayerError, match=rf"layer 'own': {message}$"):
        net = net_with(python(name))
        net.forward(x=np.ones(3))
        net.backward(y=np.ones(3))


@pytest.mark.parametrize(("cls", "attribute"), [("Named", "name"), ("Specified", "spec")])
def test_a_python_layer_that_replaces_an_attribute_of_the_net(
    squares: None, cls: str, attribute: str
) -> None:
    """The error comes when the net is built, not when a snapshot lacks the layer."""
    with pytest.raises(
        netlib.LayerError, match=f"'own': its class sets the attribute '{attribute}'"
    ):
        net_with(python(cls))


BESIDE = "it must lie in the working directory or on PYTHONPATH"


@bad_inputs(
    netlib.PrototxtError,
    {
        "class": (
            python("Absent"),
            "f:1:187: error: layer 'own': ...squares.py has no class 'Absent'",
        ),
        "no layer": (
            python("Stranger"),
            "f:1:187: error: layer 'own': squares.Stranger is not a subclass of ...",
        ),
        "module": (
            python("Square", module="missing"),
            f"f:1:169: error: layer 'own': cannot import 'missing' (ModuleNotFoundError: ...); {BESIDE}",
        ),
        "no Python": (
            ("def", python("Square", module="old")),
            "f:1:169: error: layer 'own': cannot import 'old' (SyntaxError: ... (old.py, line 1))",
        ),
        **{
            f"Python 2: {line}": (
                (line, python("Square", module="old")),
                (
                    "f:1:169: error: layer 'own': cannot import 'old' (...); it was written for "
                    f"Python 2: {advice} (docs/...)"
                ),
            )
            for line, advice in {
                **dict.fromkeys(
                    (
                        "print 'x'",
                        "print 'x', 3",
                        "exec 'x'",
                        "try: pass\nexcept E, e: pass",
                        "m = 0777",
                        "n = 10L",
                        "if 1 <> 2: pass",
                        "x = `1`",
                        "raise E, 'x'",
                        "if 1:\n        x = 1\n\ty = 1",
                    ),
                    "convert it to Python 3",
                ),
                "import cPickle": "cPickle is now pickle",
                "from StringIO import StringIO": "StringIO is now io",
            }.items()
        },
        "no package": (
            ("import easydict.nowhere", python("Square", module="old")),
            "f:1:169: error: layer 'own': cannot import 'old' "
            "(ModuleNotFoundError: ...); install the package that has 'easydict', or put it on PYTHONPATH",
        ),
        **{
            repr(name): (
                python("Square", name),
                f"f:1:169: error: layer 'own': cannot import '{name}' (...)...",
            )
            for name in ("", ".", ".squares", "squares.", "a..b", "../squares", "sys.path")
        },
        "null": (
            python("Square", "\\000"),
            r"f:1:169: error: layer 'own': cannot import '\x00' (...)...",
        ),
        "sys": (python("Square", "sys"), "f:1:183: error: layer 'own': sys has no class 'Square'"),
        "ours": (
            python("Absent", "layers"),
            "f:1:186: error: layer 'own': layers.Absent was looked for in this project's own package "
            "(...__init__.py); expected a module 'layers' with it in the working directory or on PYTHONPATH",
        ),
        "no class": (
            python("").replace('layer: ""', ""),
            "f:1:...: error: missing required field 'layer' in python_param",
        ),
    },
)
def test_python_layers_that_cannot_be_imported_are_rejected(
    squares: None, module: MakeModule, given: str | tuple[str, str], rejected: Any
) -> None:
    content, text = given if isinstance(given, tuple) else ("", given)
    module("old", content)
    with rejected:
        net_with(text)


REFUSED = (
    r"^f:1:\d+: error: layer 'own' is of type 'Python', which executes code of the net's author"
)


OTHER_PHASE = python("Square").replace('name: "own"', 'name: "own" include { phase: TEST }')


@pytest.mark.parametrize("make", [netlib.Net, caffe.Net])
def test_a_net_without_python_layers(squares: None, make: type[netlib.Net]) -> None:
    """``python_layers=False`` rejects a net with a Python layer before any layer is built;
    other nets load.
    """
    for text, phase in ((python("Square"), netlib.TRAIN), (OTHER_PHASE, netlib.TEST)):
        with pytest.raises(netlib.PrototxtError, match=REFUSED):
            make(text_with(text), phase, python_layers=False)
    assert "squares" not in sys.modules
    assert make(text_with(OTHER_PHASE), netlib.TRAIN, python_layers=False).inputs == ["x"]
    assert make(text_with(python("Square")), netlib.TRAIN).outputs == ["y"]


@pytest.mark.parametrize("make", [netlib.get_solver, caffe.get_solver, caffe.SGDSolver])
def test_a_solver_without_python_layers(squares: None, make: Callable[..., object]) -> None:
    Path("f").write_text(str(text_with(python("Square"))).replace("\n", " "))
    Path("solver.prototxt").write_text('net: "f" base_lr: 0.1 lr_policy: "fixed"')
    with pytest.raises(netlib.PrototxtError, match=REFUSED):
        make("solver.prototxt", python_layers=False)
    assert "squares" not in sys.modules
    make("solver.prototxt")


def test_a_process_without_python_layers(squares: None) -> None:
    """Within ``allowed(False)`` no inner setting or argument allows Python layers; the setting is
    then restored.
    """
    with (
        python_layer.allowed(False),
        python_layer.allowed(True),
        pytest.raises(netlib.PrototxtError, match=REFUSED),
    ):
        netlib.Net(text_with(python("Square")), netlib.TRAIN, python_layers=True)
    with pytest.raises(KeyError), python_layer.allowed(False):
        raise KeyError
    netlib.Net(text_with(python("Square")), netlib.TRAIN)


@pytest.mark.parametrize("name", ["", "/", ".", "a//b", "/a", "a/", "a/0", "\\000"])
def test_a_name_that_hdf5_cannot_hold(name: str, here: Path) -> None:
    """Any layer name works in the binary format; HDF5 rejects an invalid name if the layer
    has parameters.
    """
    options = "inner_product_param { num_output: 1 axis: 0 }"
    layer = f'layer {{ name: "{name}" type: "%s" bottom: "x" top: "y" {options} }}'
    net = net_with(layer % "InnerProduct")
    net.save("w.caffemodel")
    net.copy_from("w.caffemodel")
    with pytest.raises(
        netlib.WeightsError,
        match=r"^layer '.*': .*HDF5.*; expected another name, or snapshot_format",
    ):
        net.save("w.caffemodel.h5")
    net_with(layer % "ReLU").save("w.caffemodel.h5")


def test_attributes_of_a_layer_may_have_names_of_ours(module: MakeModule, here: Path) -> None:
    """In Caffe, a layer has the attributes param_str and phase only."""
    module(
        "named",
        SQUARE
        + """
class Named(Square):
    def setup(self, bottom, top):
        super().setup(bottom, top)
        self.rng = np.random.RandomState(0)
        self.state, self.restore, self.loss_weight = "even", True, 2
""",
    )
    layer = python("Named", "named").replace('bottom: "x"', 'bottom: "p"')
    parameter = (
        'layer { name: "p" type: "Parameter" top: "p" parameter_param { shape { dim: 2 } } }'
    )
    loss = 'layer { name: "l" type: "Reduction" bottom: "y" top: "l" loss_weight: 1 }'
    text = f"base_lr: 0.1 lr_policy: 'fixed' net_param {{ {parameter} {layer} {loss} }}"
    (here / "solver.prototxt").write_text(text)
    solver = netlib.get_solver("solver.prototxt")
    solver.net.params["p"][0].data[...] = 1
    solver.step(1)
    assert [name for _, _, name in solver.net.losses] == ["l"]
    solver.restore(solver.snapshot())
    assert np.allclose(solver.net.params["p"][0].data, 1 - 0.1 * 2)


def test_a_layer_with_its_own_init(squares: None) -> None:
    """``__init__`` gets one argument, as in pycaffe, and the base class is complete before.

    Errors name the layer.
    """
    net = net_with(python("Counting", more='param_str: "3"'))
    net.forward(x=np.ones(3))
    assert net.layer_dict["own"].passes == 4
    assert (net.blobs["y"].data == 3).all()
    with pytest.raises(netlib.LayerError, match=r"layer 'own': __init__ failed: KeyError: 'own'"):
        net_with(python("Unprepared"))


TYPO = SQUARE.replace("def backward(", "def backwards(")
ABSENT = SQUARE[: SQUARE.index("    def backward(")]
TRAINED = """
class Gain(netlib.Layer):
    def setup(self, bottom, top):
        self.blobs.add_blob(1)

    def reshape(self, bottom, top):
        top[0].reshape(*bottom[0].shape)

    def forward(self, bottom, top):
        top[0].data[...] = self.blobs[0].data * bottom[0].data
"""
IP = 'layer { name: "ip" type: "InnerProduct" bottom: "x" top: "x1" inner_product_param { num_output: 1 } }'
LOSS = 'layer { name: "sum" type: "Reduction" bottom: "y" top: "loss" loss_weight: 1 }'


def trained_net(name: str, phase: int, below: str = IP, more: str = "") -> netlib.Net:
    own = python(name, "lacking").replace("type:", f"{more} type:")
    own = own.replace('bottom: "x"', 'bottom: "x1"') if below else own
    return netlib.Net(prototxt.parse(inputs(x=(2, 3)) + below + "\n" + own + LOSS, "f"), phase)


@pytest.mark.parametrize(
    ("code", "name", "below", "advice"),
    [
        (TYPO, "Square", IP, "rename its method 'backwards'"),
        (ABSENT, "Square", IP, "define it, or set propagate_down: false for each bottom"),
        (ABSENT + TRAINED, "Gain", "", "define it, or set propagate_down: false for each bottom"),
    ],
    ids=["a typo", "no method", "a parameter of its own"],
)
def test_a_layer_without_backward_cannot_be_trained(
    module: MakeModule, code: str, name: str, below: str, advice: str
) -> None:
    module("lacking", code)
    with pytest.raises(netlib.LayerError) as error:
        trained_net(name, netlib.TRAIN, below)
    assert str(error.value) == (
        f"f:2:7: error: layer 'own': class lacking.{name} defines no backward, so nothing before this layer would be "
        f"trained, and none of its own parameters; {advice}"
    )
    net = trained_net(name, netlib.TEST, below)
    net.forward(x=np.ones((2, 3)))
    with pytest.raises(netlib.LayerError, match="defines no backward"):
        net.backward()


def test_a_layer_without_backward_where_no_gradient_passes(module: MakeModule) -> None:
    module("lacking", ABSENT)
    for below, more in (("", ""), (IP, "propagate_down: false")):
        net = trained_net("Square", netlib.TRAIN, below, more)
        net.forward(x=np.ones((2, 3)))
        net.backward()


UNWRITTEN = (
    ABSENT
    + """
    def backward(self, top, propagate_down, bottom):
        %s
"""
)


@pytest.mark.parametrize(
    ("body", "gradient", "warning"),
    [
        ("pass", [0, 0, 0], "the diff"),
        ("bottom[0].diff[1:] = top[0].diff[1:]", [0, 5, 6], "1 of 3 values of the diff"),
        ("bottom[0].diff[...] += top[0].diff", [4, 5, 6], ""),
        ("bottom[0].diff[...] = 0 * top[0].diff", [0, 0, 0], ""),
    ],
    ids=["nothing", "a part", "adds", "zeros"],
)
def test_a_diff_that_backward_does_not_write_is_zero_and_reported_once(
    module: MakeModule,
    caplog: pytest.LogCaptureFixture,
    body: str,
    gradient: list[float],
    warning: str,
) -> None:
    module("unwritten", UNWRITTEN % body)
    net = net_with(python("Square", "unwritten"))
    for number in range(3):
        net.forward(x=np.ones(3))
        found = net.backward(y=np.array([4, 5, 6]))["x"]
        assert number or found.tolist() == gradient
    assert caplog.messages == (
        [
            f"f:1:104: layer 'own': backward of Square does not write {warning} of bottom 'x'; what is not written is "
            "0, as in Caffe: write every element, or set propagate_down: false"
        ]
        if warning
        else []
    )


IN_PLACE = """
import netlib

class Square(netlib.Layer):
    def reshape(self, bottom, top):
        pass

    def forward(self, bottom, top):
        self.x = bottom[0].data.copy()
        top[0].data[...] = self.x ** 2

    def backward(self, top, propagate_down, bottom):
        bottom[0].diff[...] = 2 * self.x * top[0].diff
"""


def test_backward_of_a_layer_in_place_reads_the_diff_that_it_overwrites(module: MakeModule) -> None:
    module("in_place_squares", IN_PLACE)
    own = python("Square", "in_place_squares").replace('"x"', '"y"')
    net = net_with('layer { name: "p" type: "Power" bottom: "x" top: "y" }' + own)
    for _ in range(2):
        net.forward(x=np.array([1, 2, 3]))
        assert net.backward(y=np.array([4, 5, 6]))["x"].tolist() == [8, 20, 36]
