"""``import caffe`` finds netlib.caffe after install_as_caffe or in a Python layer.

Each test runs a new process.
"""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.support.nets import inputs
from tests.support.running import ROOT, run_python


def run(code: str, folder: Path, *paths: Path) -> str:
    return run_python(
        "-c", code, cwd=folder, PYTHONPATH=os.pathsep.join(map(str, [ROOT, *paths]))
    ).out.strip()


SAME = "import caffe.proto.caffe_pb2 as a, netlib.caffe.proto.caffe_pb2 as b, caffe.io, netlib.caffe as c\n"


def test_install_as_caffe_serves_every_form_of_import(tmp_path: Path) -> None:
    """They return netlib's own modules, not copies."""
    code = "import netlib; netlib.install_as_caffe(); netlib.install_as_caffe()\n" + SAME
    code += "from caffe import layers as L, params as P, Net\nimport caffe\n"
    code += "assert caffe.proto.caffe_pb2 is caffe.io.caffe_pb2 is a and caffe._caffe.Net is Net\n"
    code += (
        "print(a is b, caffe.io is c.io, caffe is c, Net is c.Net, caffe.__name__, P.Pooling.AVE)\n"
    )
    code += "try: import caffe.nothing\nexcept ImportError as e: print(e)"
    assert run(code, tmp_path).split("\n") == [
        "True True True True netlib.caffe 1",
        "No module named 'caffe.nothing'",
    ]


def test_it_wins_over_what_else_is_called_caffe(tmp_path: Path) -> None:
    (tmp_path / "caffe").mkdir()
    (tmp_path / "caffe" / "__init__.py").write_text("mine = 1")
    code = "import caffe; assert caffe.mine; import netlib; netlib.install_as_caffe(); import caffe; print(caffe.Net)"
    assert "netlib.caffe.pycaffe.Net" in run(code, tmp_path)


def test_modules_that_a_fork_adds_to_the_package(tmp_path: Path) -> None:
    """Those of python/caffe of a fork are found on the path, and import netlib.caffe as caffe;
    ours come first.
    """
    for name, text in (
        ("__init__", "1 / 0"),
        ("io", "1 / 0"),
        ("model_libs", "import caffe; from caffe import layers"),
        ("sub/__init__", ""),
        ("sub/deep", "import caffe; phase = caffe.TEST"),
    ):
        path = tmp_path / "python" / "caffe" / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    code = "import sys, netlib; netlib.install_as_caffe(); sys.path.insert(0, 'python')\n"
    code += "import caffe, caffe.model_libs, caffe.sub.deep\n"
    code += "print(caffe.model_libs.caffe is caffe, caffe.sub.deep.phase, caffe.io.__name__)"
    assert run(code, tmp_path) == "True 1 netlib.caffe.io"


LAYER = """
import caffe

class Ten(caffe.Layer):
    def setup(self, bottom, top):
        self.numbers = list(xrange(2))
    def reshape(self, bottom, top):
        top[0].reshape(*bottom[0].data.shape)
    def forward(self, bottom, top):
        top[0].data[...] = 10 * bottom[0].data
    def backward(self, top, propagate_down, bottom):
        bottom[0].diff[...] = 10 * top[0].diff
"""
NET = """
layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 } } }
layer { name: "ten" type: "Python" bottom: "x" top: "y" python_param { module: "%s" layer: "Ten" } }
"""
FORWARD = (
    "import netlib; n = netlib.Net('net.prototxt', 1); n.blobs['x'].data[...] = 3; "
    "print(n.forward()['y'].tolist())"
)


@pytest.mark.parametrize("module", ["ten", "layers", "tools.ten"])
def test_a_python_layer_that_imports_caffe(tmp_path: Path, module: str) -> None:
    """A Python layer can import caffe and use Python 2's xrange, also in a module named like one of
    the project's.
    """
    path = tmp_path / (module.replace(".", "/") + ".py")
    path.parent.mkdir(exist_ok=True)
    path.write_text(LAYER)
    (tmp_path / "net.prototxt").write_text(NET % module)
    assert run(FORWARD, tmp_path) == "[30.0, 30.0]"


def test_an_installed_caffe_is_left_alone(tmp_path: Path) -> None:
    installed = tmp_path / "installed" / "caffe"
    installed.mkdir(parents=True)
    (installed / "__init__.py").write_text(
        "import netlib\nclass Layer(netlib.Layer):\n    theirs = True\n"
    )
    (tmp_path / "ten.py").write_text(LAYER)
    (tmp_path / "net.prototxt").write_text(NET % "ten")
    code = FORWARD + "; print(n.layers[1].theirs)"
    assert run(code, tmp_path, tmp_path / "installed").split("\n") == ["[30.0, 30.0]", "True"]


MISSING = "import sys; sys.modules['google.protobuf'] = None\n"  # as if protobuf were not installed


def test_without_protobuf(tmp_path: Path) -> None:
    """Without protobuf, Net, the solvers, Classifier and io work; caffe.proto and NetSpec
    name the package.
    """
    (tmp_path / "net.prototxt").write_text(
        'layer { name: "x" type: "Input" top: "x" input_param { shape { dim: 2 } } }'
    )
    code = MISSING + "import netlib; netlib.install_as_caffe(); import caffe\n"
    code += (
        "print(caffe.Net('net.prototxt', caffe.TEST).inputs, caffe.Classifier, caffe.SGDSolver, "
        "caffe.io.oversample)\n"
    )
    code += "for use in (lambda: caffe.NetSpec().to_proto(), lambda: __import__('caffe.proto.caffe_pb2'),\n"
    code += "            lambda: caffe.io.caffe_pb2, lambda: exec('from caffe.proto import caffe_pb2')):\n"
    code += "    try: use()\n"
    code += "    except ImportError as error: print(isinstance(error, netlib.NetlibError), error)\n"
    first, *others = run(code, tmp_path).splitlines()
    assert first.startswith("['x']")
    assert len(others) == 4
    for line in others:
        assert line.startswith(
            "True caffe.proto and NetSpec need the package protobuf: pip install 'protobuf>=4.25'"
        )


def test_a_script_runs_with_its_own_folder_and_arguments(tmp_path: Path) -> None:
    """``python -m netlib.caffe script.py argument`` runs the script with its own folder, arguments
    and ``__main__``.
    """
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "helper.py").write_text("x = 7")
    code = "import sys, caffe, helper\nif __name__ == '__main__': print(caffe.TEST, helper.x, sys.argv, sys.path[0])\n"
    code += "sys.exit(3)"
    (tmp_path / "scripts" / "script.py").write_text(code)
    for arguments, status, out in (
        (
            ["scripts/script.py", "a", "-b"],
            3,
            f"1 7 ['scripts/script.py', 'a', '-b'] {tmp_path}/scripts",
        ),
        (["none.py"], 1, ""),
        (["scripts"], 1, ""),
    ):
        done = run_python("-m", "netlib.caffe", *arguments, status=status, cwd=tmp_path)
        assert (done.out.strip(), done.err) == (
            out,
            f"{arguments[0]}: script not found\n" if status == 1 else "",
        )


SHOW = "import sys, caffe, helper; print(__name__, caffe.TEST, helper.x, sys.argv[1:], 'a' if 1 else 0)"


@pytest.mark.parametrize(
    ("arguments", "typed"),
    [
        (["-", "b", "-c"], SHOW),
        (["-c", SHOW, "b", "-c"], ""),
        (["-m", "show", "b", "-c"], ""),
        (["/dev/stdin", "b", "-c"], "import sys; sys.path[:0] = ['.']; " + SHOW),
    ],
)
def test_scripts_run_from_stdin_code_modules_and_pipes(
    tmp_path: Path, arguments: list[str], typed: str
) -> None:
    """With the working folder on the path, as Python runs them."""
    (tmp_path / "helper.py").write_text("x = 7")
    (tmp_path / "show.py").write_text(SHOW)
    done = run_python("-m", "netlib.caffe", *arguments, typed=typed, cwd=tmp_path)
    assert (done.out, done.err) == ("__main__ 1 7 ['b', '-c'] a\n", "")


def test_a_script_from_a_pipe_alone(tmp_path: Path) -> None:
    """Without an argument, as of Python; an error has its line."""
    assert (
        run_python("-m", "netlib.caffe", typed="import caffe\nprint(caffe.TRAIN)", cwd=tmp_path).out
        == "0\n"
    )
    done = run_python("-m", "netlib.caffe", "-", typed="a = 1\na / 0", cwd=tmp_path, status=1)
    assert 'File "<stdin>", line 2, in <module>' in done.err
    assert "ZeroDivisionError" in done.err
    assert "needs code" in run_python("-m", "netlib.caffe", "-c", cwd=tmp_path, status=2).err


@pytest.mark.parametrize(
    ("typed", "message"),
    [
        (
            "import caffe\nprint caffe.TEST",
            "Missing parentheses in call to 'print'. Did you mean print(...)? (<stdin>, "
            "line 2); it was written for Python 2: convert it to Python 3 (docs/caffe.md, Scripts for Python 2)\n",
        ),
        (
            "import cPickle",
            "No module named 'cPickle'; it was written for Python 2: cPickle is now pickle (docs/caffe.md, "
            "Scripts for Python 2)\n",
        ),
        ("import no_such_package", "...ModuleNotFoundError: No module named 'no_such_package'\n"),
    ],
)
def test_a_script_for_python_2(tmp_path: Path, typed: str, message: str) -> None:
    """One line with the advice; other errors of imports and syntax keep Python's message."""
    error = run_python("-m", "netlib.caffe", typed=typed, cwd=tmp_path, status=1).err
    assert error.endswith(message[3:]) if message.startswith("...") else error == message


@pytest.mark.parametrize(
    ("level", "lines", "inside"),
    [("1", 1, True), ("2", 0, True), ("2", 0, False), ("9", 0, False), ("x", 1, False)],
)
def test_a_quiet_script(tmp_path: Path, level: str, lines: int, inside: bool) -> None:
    """GLOG_minloglevel is obeyed, also if the script sets it before its import."""
    (tmp_path / "net.prototxt").write_text(inputs(x=(2,)))
    code = f"import os; os.environ['GLOG_minloglevel'] = '{level}'\n" if inside else ""
    code += "import caffe; caffe.Net('net.prototxt', caffe.TEST).save('w'); caffe.Net('net.prototxt', 'w', caffe.TEST)"
    environment = {} if inside else {"GLOG_minloglevel": level}
    done = run_python("-m", "netlib.caffe", "-", typed=code, cwd=tmp_path, **environment)
    assert len(done.err.splitlines()) == lines
