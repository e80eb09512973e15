"""The help of every command: its examples run, in their smallest form, and its defaults are
those of the code.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import re
import shlex
import shutil
from collections.abc import Callable, Iterator
from importlib.util import find_spec
from pathlib import Path
from unittest import mock

import numpy as np
import pytest

pytest.importorskip("sybil", reason="as tests/documents/test_blocks.py")

import netlib
from handpose.datasets import icvl_files, nyu_files
from netlib.files.paths import ROOT
from tests.documents import commands, given, workplace
from tests.support.bags import write_ros1
from tests.support.caffe_messages import datum, write_database
from tests.support.nyu_data_set import write_data_set
from tests.support.running import run_tool
from tests.tools.test_prepare_icvl import write_icvl
from tests.tools.test_run_net import DETECTOR, LABEL_MAP
from tests.tools.test_upgrade_net import V1
from tools import compute_image_mean, make_synthetic, train
from tools.common.commands import EXAMPLES, NET_TOOLS

COMMANDS = sorted(path.stem for path in (ROOT / "tools").glob("[a-z]*.py"))
SMALL = (  # replacements in an example; the last ones apply to one command each
    (r"(-max-iter|-train|-test|-iterations|-seconds) \d+", r"\1 1"),
    (r"_iter_\d+", "_iter_1"),
    (r" \.\.\.", " snapshots/nyu_iter_1.caffemodel.h5"),
    (r"(minute --out \S+)", r"\1 --seconds 0.1"),
    (r"(--body \S+)", r"\1 --test 1"),
    (r"(demo --out demo)", r"\1 --frames 1"),
    (r"(pictures/ --mean.*)", r"\1 --iterations 1"),
    (r"(relu)$", r"\1 --iterations 1"),
    (r"(draw_net.*)\.(png|svg)", r"\1.dot"),  # Graphviz need not be installed
    (r"\b(IJCAI16|ICCV15)_\w+", "nyu_test_groundtruth_label"),
)
PARSED = re.compile(r"mpiexec|--ranks|realsense")
# ends with status 1 until the reader has written the layer
UNSOLVED = "python tools/exercise.py relu --iterations 1"
NEEDS = {
    "draw_net": ("pydot",),
    "export_onnx": ("onnx", "onnxruntime"),
    "record": ("rosbags",),
    "track": ("av", "rosbags"),
}


def lists(folder: Path) -> None:
    """cat.jpg, list.txt with paths in pictures/, mean.binaryproto, train_lmdb, and a net with
    layers conv3 and fc7.
    """
    given.classifier(folder)
    text = (
        (folder / "deploy.prototxt")
        .read_text()
        .replace('"conv"', '"conv3"')
        .replace('"fc"', '"fc7"')
    )
    (folder / "deploy.prototxt").write_text(text)
    netlib.Net(folder / "deploy.prototxt", netlib.TEST, seed=1).save(folder / "net.caffemodel")
    shutil.copyfile(folder / "cat.png", folder / "cat.jpg")
    shutil.copyfile(folder / "labels.txt", folder / "synset_words.txt")
    for name in given.CLASSES:
        shutil.copyfile(folder / f"{name}.png", folder / "pictures" / f"{name}.png")
    assert compute_image_mean.main(["list.txt", "mean.binaryproto"]) == 0
    write_database(folder / "train_lmdb", [datum(np.zeros((3, 4, 4), np.uint8), 0)])


def detector(folder: Path) -> None:
    """ssd.prototxt, its weights, map.prototxt and street.jpg."""
    (folder / "ssd.prototxt").write_text(DETECTOR)
    (folder / "map.prototxt").write_text(LABEL_MAP)
    shutil.copyfile(folder / "cat.jpg", folder / "street.jpg")
    netlib.Net("ssd.prototxt", netlib.TEST, seed=1).save(folder / "ssd.caffemodel")


def trained(folder: Path) -> None:
    """data/nyu and snapshots/nyu_iter_1, with its log."""
    given.data(folder)
    assert (
        train.main(
            ["prototxt/nyu_solver.prototxt", "--max-iter", "1", "--log", "snapshots/train.log"]
        )
        == 0
    )
    solver = folder / "prototxt" / "nyu_solver.prototxt"
    solver.write_text(re.sub(r"max_iter: \d+", "max_iter: 2", solver.read_text()))


def person(folder: Path) -> None:
    """data/person and snapshots/person_iter_1."""
    body = ["--body", "prototxt/body/person_prior.prototxt"]
    assert make_synthetic.main([*body, "--train", "8", "--test", "16", "--workers", "1"]) == 0
    given.small_batches(folder)
    assert train.main(["prototxt/body/person_solver.prototxt", "--max-iter", "1"]) == 0


def recordings(folder: Path) -> None:
    """takes/wave, take.bag and frames/left_*.png."""
    argv = ["rest", "--camera", "sr305", "--seconds", "0.1", "--out"]
    run_tool("make_recording", *argv, "takes/wave")
    run_tool("make_recording", *argv, "frames")
    for path in (folder / "frames").glob("*.png"):
        path.rename(path.with_stem(f"left_{path.stem}"))
    write_ros1(folder / "take.bag", np.full((3, 48, 64), 900, np.uint16))


def demo(folder: Path) -> None:
    """frame.png and crop.png, and demo/frame_0.png, as of tools/demo.py."""
    given.frame(folder)
    run_tool("make_recording rest --camera nyu --seconds 0.1 --out demo")
    min((folder / "demo").glob("*.png")).rename(folder / "demo" / "frame_0.png")


def classifier(folder: Path) -> None:
    """train_val.prototxt and net_iter_1.caffemodel."""
    given.pictures(folder)
    assert (
        compute_image_mean.main(
            [
                "--root_folder",
                "pictures/",
                "--resize_width",
                "256",
                "--resize_height",
                "256",
                "list.txt",
                "mean.binaryproto",
            ]
        )
        == 0
    )
    (folder / "train_test.prototxt").rename(folder / "train_val.prototxt")
    (folder / "net_iter_1000.caffemodel").rename(folder / "net_iter_1.caffemodel")


def annotation(folder: Path) -> None:
    """nyu_test_groundtruth_label.txt; labels.txt and result.txt of HANDS 2017."""
    given.joints(folder)
    (folder / "joints.txt").rename(folder / "nyu_test_groundtruth_label.txt")
    joints = "\t".join(["400.0"] * 63)
    for name in ("labels.txt", "result.txt"):
        (folder / name).write_text(f"image_D00000001.png\t{joints}\n")


def training_nets(folder: Path) -> None:
    """train_val.prototxt, whose data have a size, and lenet_train_test.prototxt, whose
    data have none.
    """
    reader = 'layer { name: "d" type: "Data" top: "data" top: "label" %s data_param { source: "lmdb" batch_size: 9 } } '
    rest = """layer { name: "fc" type: "InnerProduct" bottom: "data" top: "fc" inner_product_param { num_output: 2 } }
        layer { name: "loss" type: "SoftmaxWithLoss" bottom: "fc" bottom: "label" top: "loss" }"""
    (folder / "train_val.prototxt").write_text(reader % "transform_param { crop_size: 8 }" + rest)
    (folder / "lenet_train_test.prototxt").write_text(reader % "" + rest)


def old(folder: Path) -> None:
    """Files in Caffe's format V1."""
    (folder / "lenet_v1.prototxt").write_text(V1)
    (folder / "old_solver.prototxt").write_text(
        'net: "net.prototxt" base_lr: 0.1 solver_type: ADAM'
    )
    assert run_tool("upgrade_net lenet_v1.prototxt new.prototxt").status == 0
    netlib.Net("new.prototxt", netlib.TEST).save(folder / "old.caffemodel")


def nyu(folder: Path) -> None:
    """NYU_ROOT."""
    write_data_set(folder / "NYU_ROOT", {"train": 2, "test": 2})


def crops(folder: Path) -> None:
    """real_crops/."""
    given.frame(folder)
    (folder / "real_crops").mkdir()
    shutil.copy(folder / "crop.png", folder / "real_crops")


GIVEN: dict[str, tuple[Callable[[Path], object], ...]] = {
    "caffe": (trained,),
    "compute_image_mean": (lists,),
    "deploy": (training_nets,),
    "draw_net": (lists,),
    "evaluate": (annotation,),
    "export_onnx": (trained, lists),
    "finetune": (lists,),
    "fit_pose": (annotation, given.data),
    "plot_log": (trained,),
    "predict": (demo,),
    "prepare_icvl": (lambda folder: write_icvl(folder / "ICVL_ROOT"),),
    "prepare_nyu": (nyu,),
    "record": (recordings,),
    "run_net": (lists, detector),
    "show_data": (given.data, person, crops),
    "test": (trained, person),
    "test_net": (classifier,),
    "time": (given.data,),
    "track": (recordings,),
    "train": (trained, given.nets),
    "upgrade_net": (old,),
}


def examples(name: str) -> Iterator[str]:
    """The commands in a docstring, without comments and pipes, and those in the
    list of commands.
    """
    for program, shown in EXAMPLES.items():
        for command, arguments in shown.items():
            if name == (NET_TOOLS.get(command) if program == "netlib" else command):
                yield f"python tools/{name}.py {arguments}"
    for line in commands.lines_of(importlib.import_module(f"tools.{name}").__doc__ or ""):
        if re.match(rf"(mpiexec .*)?python .*tools/{name}\.py", line):
            yield line.partition(" | ")[0]


def run(line: str) -> None:
    """Run an example in its smallest form."""
    for old_form, new_form in SMALL:
        line = re.sub(old_form, new_form, line)
    shutil.rmtree("finetuned", ignore_errors=True)
    words = []
    for word in shlex.split(line, posix=False):
        words += (
            [word.strip('"')]
            if word[0] == '"'
            else sorted(Path().glob(word))
            if "*" in word
            else [word]
        )
    run_tool(Path(words[1]).stem, *words[2:], status=int(line == UNSOLVED))


@pytest.mark.parametrize("name", COMMANDS)
def test_the_examples_of_the_help_run(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In a folder with the files that they name.

    Cameras and several processes are not there: these are parsed.
    """
    for package in NEEDS.get(name, ()):
        if find_spec(package) is None:
            pytest.skip(f"tools/{name}.py uses {package}: pip install -e '.[test]'")
    monkeypatch.setattr(nyu_files, "TRAIN_FRAMES", 2)
    monkeypatch.setattr(nyu_files, "TEST_FRAMES", 2)
    monkeypatch.setattr(icvl_files, "MIN_TRAIN_FRAMES", 20)
    monkeypatch.setattr(icvl_files, "TEST_SEQUENCE_FRAMES", (5, 7))
    folder = tmp_path / "project"
    workplace.furnish(folder)
    with workplace.at_work_in(folder):
        for make in GIVEN.get(name, ()):
            make(folder)
        shown = list(examples(name))
        assert shown
        for line in shown:
            if PARSED.search(line):
                assert list(commands.mistakes(line)) == []
            else:
                run(line)


def parser_of(name: str) -> argparse.ArgumentParser:
    """The parser of a command."""
    with mock.patch.object(
        argparse.ArgumentParser, "parse_args", autospec=True, side_effect=StopIteration
    ) as parse:
        with pytest.raises(StopIteration):
            importlib.import_module(f"tools.{name}").main([])
        return parse.call_args.args[0]


def values() -> set[str]:
    """What options accept by name, and their defaults."""
    actions = [action for name in COMMANDS for action in parser_of(name)._actions]
    return {str(value) for action in actions for value in [action.default, *(action.choices or ())]}


def test_defaults_are_read_from_the_code() -> None:
    """No text of a help states a default: it comes from an f-string or from argparse."""
    known = values()
    found = []
    for path in [*(ROOT / "tools").glob("*.py"), *(ROOT / "tools" / "common").glob("*.py")]:
        texts = [
            node.value
            for node in ast.walk(ast.parse(path.read_text()))
            if isinstance(node, ast.Constant)
        ]
        stated = re.findall(
            r"default[\w ]*: ([\w./-]*\w)",
            "\n".join(text for text in texts if isinstance(text, str)),
        )
        found += [
            f"{path.name}: {word}"
            for word in stated
            if word in known or re.fullmatch(r"[\d.]+", word)
        ]
    assert found == []
