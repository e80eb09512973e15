"""Scripts with modules named ``layers`` or ``fast`` of their own. Each test runs a new process."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from tests.support.running import ROOT, run_python

NET = f"caffe.Net({str(ROOT / 'prototxt' / 'nyu_deploy.prototxt')!r}, caffe.TEST)"


@pytest.fixture
def run(tmp_path: Path):
    """``run(code, files)`` returns the lines that a script prints that lies in a folder
    with these files.
    """

    def make(code: str, files: dict[str, str], *argv: str) -> list[str]:
        for name, content in files.items():
            (tmp_path / name).parent.mkdir(exist_ok=True)
            (tmp_path / name).write_text(content)
        (tmp_path / "script.py").write_text(code)
        return run_python(*argv, "script.py", cwd=tmp_path, PYTHONPATH=str(ROOT)).out.splitlines()

    return make


FILES = {
    "modules": {"layers.py": "class Stripe: pass\nfast = 1", "fast.py": "name = 'theirs'"},
    "packages": {
        "layers/__init__.py": "from layers.stripe import Stripe",
        "layers/stripe.py": "class Stripe: pass",
        "fast/__init__.py": "name = 'theirs'",
    },
    "folders": {"layers/stripe.py": "class Stripe: pass", "fast/name.py": ""},
}


@pytest.mark.parametrize(
    ("kind", "how"),
    [
        ("modules", "python -m netlib.caffe"),
        ("modules", "imported before"),
        ("packages", "python -m netlib.caffe"),
        ("packages", "install_as_caffe"),
        ("folders", "install_as_caffe"),
    ],
)
def test_a_scripts_own_modules_win(run, kind: str, how: str) -> None:
    """The script finds its own modules, also later and in other modules; nets are built
    and run by ours.
    """
    begin = {
        "python -m netlib.caffe": "",
        "install_as_caffe": "import netlib; netlib.install_as_caffe()\n",
        "imported before": "import layers, fast\nimport netlib; netlib.install_as_caffe()\n",
    }[how]
    inside = "layers.stripe" if kind == "folders" else "layers"
    code = f"{begin}import caffe\nfrom {inside} import Stripe\nimport other, fast\nnet = {NET}\n"
    code += "import sys\nprint(other.Stripe is Stripe, Stripe.__module__, net.engine.name, len(net.forward()))\n"
    code += "print('ours' if 'slices' in dir(fast) else 'theirs')\n"
    files = {**FILES[kind], "other.py": f"from {inside} import Stripe"}
    argv = ("-m", "netlib.caffe") if how == "python -m netlib.caffe" else ()
    stripe = "layers" if kind == "modules" else "layers.stripe"
    assert run(code, files, *argv) == [
        f"True {stripe} {os.environ.get('NETLIB_ENGINE', 'fast')} 1",
        "theirs",
    ]


def test_other_folders_of_a_clone(run) -> None:
    code = "import caffe, tools.inner, models, export\nprint(tools.inner.mine, models.mine, export.mine)"
    files = dict.fromkeys(["tools/inner.py", "models.py", "export/__init__.py"], "mine = 1")
    assert run(code, files, "-m", "netlib.caffe") == ["1 1 1"]


def test_ours_are_found_if_there_are_no_others(run) -> None:
    code = (
        "import netlib; netlib.install_as_caffe()\nfrom layers.vision.pooling import Pooling\nimport layers\n"
        "print(Pooling is layers.LAYER_TYPES['Pooling'], layers.__spec__.name, Pooling.__module__)"
    )
    assert run(code, {}) == ["True layers layers.vision.pooling"]


def test_importing_netlib_changes_nothing_else(run) -> None:
    code = (
        "import sys, numpy, scipy, cv2, h5py\nhooks, path = list(sys.meta_path), list(sys.path)\nimport netlib\n"
        "names = {name.partition('.')[0] for name in sys.modules}\n"
        "print(names & {'layers', 'fast', 'caffe', 'tools'}, sys.meta_path == hooks, sys.path == path)"
    )
    assert run(code, {}) == ["set() True True"]
