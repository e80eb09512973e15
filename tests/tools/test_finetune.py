"""tools/finetune.py: a classifier for other classes."""

from __future__ import annotations

import re
import shlex
import signal
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import netlib
from layers.data.image_data import read_list
from netlib.proto.binaryproto import write_blob
from tests.support.bad_input import whole_line
from tests.support.nets import inputs, ip
from tests.support.running import Done, run_tool
from tools import finetune
from tools.common import frozen_features
from tools.common.frozen_features import NotFrozenError

BODY = """layer { name: "conv" type: "Convolution" bottom: "data" top: "conv"
    convolution_param { num_output: 4 kernel_size: 3 weight_filler { type: "msra" } } }
layer { name: "bn" type: "BatchNorm" bottom: "conv" top: "conv" }
layer { name: "relu" type: "ReLU" bottom: "conv" top: "conv" }
layer { name: "pool" type: "Pooling" bottom: "conv" top: "pool" pooling_param { pool: AVE global_pooling: true } }
"""
SOFTMAX = 'layer { name: "prob" type: "Softmax" bottom: "fc" top: "prob" }'
NET = inputs(data=(2, 3, 8, 8)) + BODY + ip("fc", "pool", "fc", outputs=7) + SOFTMAX
COLOURS = {"blue sky": (220, 60, 40), "grass": (40, 200, 60), "Rose": (50, 40, 210)}
SORTED = ["Rose", "blue sky", "grass"]
NUMBERS = "--mean 104,117,123 --scale 0.02"


@pytest.fixture(autouse=True)
def work(here: Path, rng: np.random.Generator) -> None:
    """A folder with a net for seven classes, its weights, and ten pictures of each of
    three colours.
    """
    write_net(NET)
    for name, colour in COLOURS.items():
        folder = Path("pictures", name)
        folder.mkdir(parents=True)
        (folder / "about.txt").write_text("no picture")
        for i in range(10):
            picture = np.clip(colour + rng.normal(0, 20, (9 + i, 12, 3)), 0, 255)
            cv2.imwrite(str(folder / f"{i} a.png"), picture.astype(np.uint8))


def write_net(text: str) -> None:
    Path("net.prototxt").write_text(text)
    net = netlib.Net("net.prototxt", netlib.TEST, seed=1)
    if "bn" in net.params:
        for blob, value in zip(net.params["bn"], (0.1, 2.0, 1.0)):
            blob.data[...] = value
    net.save("net.caffemodel")


def tuned(options: str, status: int = 0) -> Done:
    numbers = "" if "--scale" in options else NUMBERS
    command = f"finetune net.prototxt net.caffemodel pictures {numbers} {options}"
    return run_tool(command, status=status)


def weights() -> Path:
    (path,) = Path("finetuned").glob("net_iter_*.caffemodel")
    return path


def changed() -> set[str]:
    """The names of the layers whose parameters are others than before."""
    old = netlib.Net("net.prototxt", "net.caffemodel", netlib.TEST)
    new = netlib.Net("finetuned/deploy.prototxt", str(weights()), netlib.TEST)
    return {
        name
        for name, blobs in new.params.items()
        if name not in old.params
        or any(
            not np.array_equal(one.data, other.data) for one, other in zip(blobs, old.params[name])
        )
    }


def test_new_classes() -> None:
    """The held-out pictures are classified; the printed command gives the same table."""
    lines = tuned("--iterations 300").out.splitlines()
    assert [line.rsplit(maxsplit=3)[0].strip() for line in lines[1:4]] == SORTED
    assert lines[4] == "accuracy 1.0000 (6 of 6)"
    assert Path("finetuned/labels.txt").read_text().splitlines() == SORTED
    start, _, command = lines[-1].partition("run_net.py ")
    assert start.startswith("the same again: ")
    assert not lines[5:-1]
    assert run_tool("run_net", *shlex.split(command)).out.splitlines() == lines[:5]
    assert changed() == {"fc_new"}  # bit for bit, the statistics of BatchNorm included


def test_held_out_pictures_are_not_trained_on() -> None:
    """The seed selects them, and every class has its share."""
    lists: list[list[Any]] = []
    for out, seed in (("a", 1), ("b", 1), ("c", 2)):
        tuned(f"--iterations 1 --out {out} --seed {seed} --held-out 0.3")
        train, test = (read_list(Path(out, f"{name}.txt"))[0] for name in ("train", "test"))
        assert len(train) == 21
        assert len(test) == 9
        assert not {*train} & {*test}
        assert sorted(label for _, label in test) == [0, 0, 0, 1, 1, 1, 2, 2, 2]
        lists.append(test)
    assert lists[0] == lists[1] != lists[2]


@pytest.mark.parametrize(("freeze", "layers"), [("none", {"conv", "fc_new"}), ("conv", {"fc_new"})])
def test_frozen_layers(freeze: str, layers: set[str]) -> None:
    """Bit for bit; BatchNorm keeps its statistics in any case."""
    tuned(f"--iterations 2 --freeze {freeze}")
    assert changed() == layers


@pytest.mark.parametrize(
    "options",
    [
        NUMBERS,
        "--mean 90 --scale 0.5 --rgb",
        "--mean-file mean.binaryproto --scale 1",
        "--mean-file mean.binaryproto --scale 0.1 --rgb",
    ],
)
def test_pictures_are_read_as_netlib_run_reads_them(options: str, rng: np.random.Generator) -> None:
    """The input of a test is that of the command ``run``, bit for bit; only in training
    it is mirrored.
    """
    mean = rng.uniform(80, 120, (1, 3, 10, 10)).astype(np.float32)
    write_blob(mean, "mean.binaryproto")
    tuned(f"--iterations 1 --batch 6 --mirror {options}")
    text = Path("finetuned/train.prototxt").read_text()
    assert (text.count("mirror: true"), text.count("mirror: false")) == (1, 1)
    net = netlib.Net("finetuned/train.prototxt", netlib.TEST)
    net.forward()
    files = "net.prototxt net.caffemodel finetuned/test.txt"
    run_tool(f"run_net {files} {options} --blob data --out data.npy")
    assert_array_equal(net.blobs["data"].data, np.load("data.npy"))


DEEP = BODY.replace("global_pooling: true", "kernel_size: 2 stride: 2") + (
    ip("fc6", "pool", "fc6", outputs=6)
    + 'layer { name: "drop" type: "Dropout" bottom: "fc6" top: "fc6" } '
    + ip("fc7", "fc6", "fc7", outputs=5)
)
NETS = {
    "a deep net": inputs(data=(2, 3, 8, 8)) + DEEP + ip("fc", "fc7", "fc", outputs=7) + SOFTMAX,
    "two branches": inputs(data=(2, 3, 8, 8))
    + BODY
    + ip("a", "pool", "a")
    + ip("b", "pool", "b")
    + 'layer { name: "sum" type: "Eltwise" bottom: "a" bottom: "b" top: "sum" } '
    + ip("fc", "sum", "fc", outputs=7)
    + SOFTMAX,
}


@pytest.mark.parametrize(
    ("net", "options", "first"),
    [
        ("a deep net", "", "drop"),
        ("a deep net", "--freeze conv", "fc6"),
        ("a deep net", "--freeze bn --rgb", "fc6"),
        ("two branches", "", "fc_new"),
        ("two branches", "--freeze a --batch 7", "b"),
    ],
)
def test_features_of_frozen_layers_are_computed_once(
    net: str, options: str, first: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The files and the tests are those of a training that computes all layers in each step,
    up to rounding.
    """
    write_net(NETS[net])
    done = tuned(f"--iterations 12 {options} --out fast")
    assert f"the layers before {first!r} are computed once for each picture" in done.err

    def refuse(*given: object) -> None:
        raise NotFrozenError("of the test")

    monkeypatch.setattr(finetune, "use_features", refuse)
    slow = tuned(f"--iterations 12 {options} --out slow")
    assert "all layers are computed in each step: of the test" in slow.err
    # but for the folder in the last line
    assert done.out.splitlines()[:-1] == slow.out.splitlines()[:-1]
    names = [{path.name for path in Path(out).iterdir()} for out in ("fast", "slow")]
    assert names[0] == names[1]
    nets = [
        netlib.Net(f"{out}/deploy.prototxt", f"{out}/net_iter_12.caffemodel", netlib.TEST)
        for out in ("fast", "slow")
    ]
    for one, other in zip(*(net.params.values() for net in nets)):
        for found, expected in zip(one, other):
            assert_allclose(found.data, expected.data, rtol=1e-4, atol=1e-6)
    logs = [
        re.findall(r"accuracy = ([\d.]+)", Path(out, "train.log").read_text())
        for out in ("fast", "slow")
    ]
    assert logs[0] == logs[1]
    assert len(logs[0]) > 10


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ("--mirror", "pictures are mirrored at random (--mirror)"),
        ("--freeze none", "no frozen layer with weights is before layer 'conv'"),
        (
            "--mean-file mean.binaryproto --scale 1",
            "pictures are cropped at random, as the mean image is",
        ),
    ],
)
def test_the_reason_for_computing_all_layers_in_each_step_is_given(
    options: str, reason: str
) -> None:
    write_blob(np.zeros((1, 3, 10, 10), np.float32), "mean.binaryproto")
    assert (
        f"all layers are computed in each step: {reason}" in tuned(f"--iterations 1 {options}").err
    )


def test_features_that_do_not_fit_into_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(frozen_features, "SHARE_OF_MEMORY", 0.0)
    assert "the features of 24 pictures would take 384 bytes" in tuned("--iterations 1").err


def test_a_line_for_each_test_and_the_log_in_its_file() -> None:
    done = tuned("--iterations 30")
    assert "Creating Layer" not in done.err
    assert "Creating Layer" in Path("finetuned/train.log").read_text()
    assert re.fullmatch(r"step 30 of 30: accuracy [01]\.\d\d", done.err.splitlines()[-1])


def test_a_training_that_was_stopped_is_continued(signal_at_start: Any) -> None:
    """The printed command gives the weights of a training that was not stopped."""
    tuned("--iterations 9 --out whole")
    signal_at_start(signal.SIGINT)
    line = tuned("--iterations 9", status=130).err.splitlines()[-1]
    start, _, command = line.partition("train.py ")
    assert start.startswith("continue: ")
    run_tool("train", *shlex.split(command))
    one, other = (
        netlib.Net(f"{out}/deploy.prototxt", f"{out}/net_iter_9.caffemodel", netlib.TEST)
        for out in ("whole", "finetuned")
    )
    assert_allclose(
        one.params["fc_new"][0].data, other.params["fc_new"][0].data, rtol=1e-4, atol=1e-6
    )


def test_the_solver_file_starts_from_the_given_weights() -> None:
    """Train with it alone gives what the command gave, with the frozen layers of the old net."""
    Path('a "net".caffemodel').write_bytes(Path("net.caffemodel").read_bytes())
    run_tool(
        "finetune",
        "net.prototxt",
        'a "net".caffemodel',
        "pictures",
        *NUMBERS.split(),
        "--iterations",
        "9",
    )
    once = netlib.Net("finetuned/deploy.prototxt", str(weights()), netlib.TEST)
    run_tool("train finetuned/solver.prototxt")
    again = netlib.Net("finetuned/deploy.prototxt", str(weights()), netlib.TEST)
    for name, blobs in once.params.items():
        for one, other in zip(blobs, again.params[name]):
            assert_allclose(one.data, other.data, rtol=1e-4, atol=1e-6)


def test_a_convolution_as_last_layer_and_a_second_run() -> None:
    """The head may be a convolution before a pooling; a fine-tuned net can be fine-tuned again."""
    body, _, pool = BODY.rpartition("layer {")
    write_net(
        inputs(data=(1, 3, 8, 8))
        + body
        + """layer { name: "last" type: "Convolution" bottom: "conv" top: "last"
        convolution_param { num_output: 7 kernel_size: 1 weight_filler { type: "msra" } } }
        layer {"""
        + pool.replace('"conv"', '"last"')
        + SOFTMAX.replace('"fc"', '"pool"')
    )
    assert "accuracy" in tuned("--iterations 1").out
    files = f"finetuned/deploy.prototxt {weights()} pictures"
    done = run_tool(f"finetune {files} {NUMBERS} --iterations 1 --out again")
    assert "layer 'last_new' becomes 'last_new_new'" in done.err


def bad(name: str) -> str:
    """Make the mistake of this name; returns options."""
    if name == "one class":
        for other in SORTED[:2]:
            Path("pictures", other).rename(f"{other} elsewhere")
    elif name == "no class":
        Path("pictures").rename("elsewhere")
        Path("pictures").mkdir()
    elif name == "an empty folder":
        Path("pictures/empty").mkdir()
    elif name == "a damaged picture":
        Path("pictures/Rose/3 a.png").write_bytes(b"no picture")
    elif name == "two outputs":
        write_net(NET + 'layer { name: "x" type: "Softmax" bottom: "conv" top: "x" }')
    elif name == "no classifier":
        write_net(inputs(data=(2, 3, 8, 8)) + BODY)
    elif name == "a sigmoid":
        write_net(NET.replace('"Softmax"', '"Sigmoid"'))
    elif name == "a map":
        write_net(
            inputs(data=(2, 3, 8, 8))
            + BODY.replace("global_pooling: true", "kernel_size: 2")
            + """layer {
            name: "map" type: "Convolution" bottom: "pool" top: "fc" convolution_param { num_output: 7 kernel_size: 1 }
            }"""
            + SOFTMAX
        )
    elif name == "an unknown layer":
        return "--freeze cone"
    elif name == "an earlier run":
        Path("finetuned").mkdir()
        Path("finetuned/solver.prototxt").touch()
    elif name == "a narrow net with a mean image":
        write_net(NET.replace("dim: 8 dim: 8", "dim: 8 dim: 9"))
        write_blob(np.zeros((1, 3, 10, 10), np.float32), "mean.binaryproto")
        return "--mean-file mean.binaryproto --scale 1"
    return ""


@pytest.mark.parametrize(
    ("name", "line"),
    {
        "one class": "pictures: one class, 'grass'; expected a folder of pictures for each of two or more classes",
        "no class": "pictures: no folder in it; expected a folder of pictures ...",
        "an empty folder": "pictures/empty: 0 pictures (.bmp, ...); expected at least two, one of them to test on",
        "a damaged picture": "pictures/Rose/3 a.png: ...",
        "two outputs": "net.prototxt: the net has the outputs prob, x; expected one, ...",
        "no classifier": "net.prototxt: the last layer with weights: 'bn' has the type BatchNorm; expected ...",
        "a sigmoid": "net.prototxt: layer 'prob' of type Sigmoid follows the last layer with weights; expected ...",
        "a map": (
            "net.prototxt: with 3 classes in layer 'map' the output 'prob' has shape (2, 3, 5, "
            "5); expected (N, 3)"
        ),
        "an unknown layer": "net.prototxt: there is no layer 'cone' before 'fc' (did you mean 'conv'?)",
        "an earlier run": "finetuned: has the files of an earlier run; delete it, or give another --out",
        "a narrow net with a mean image": (
            "net.prototxt: the input has 9 x 8 px; with --mean-file expected a square, ..."
        ),
    }.items(),
)
def test_invalid_pictures_and_nets_are_rejected(name: str, line: str) -> None:
    """In one line, before anything is trained."""
    assert re.fullmatch(whole_line(line), tuned(bad(name), status=1).err.strip())
    assert not list(Path().glob("finetuned/net_iter*"))
