"""tools/deploy.py: the deploy net of a training net, and the commands that ask for one."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

import netlib
from netlib.net import Net
from tests.support.caffe_messages import write_blob
from tests.support.nets import inputs
from tests.support.running import refusal, run_tool
from tests.support.tables import records_of

IMAGE_DATA = """
layer {{ name: "reader" type: "ImageData" top: "data" top: "label" include {{ phase: {phase} }}
        transform_param {{ scale: 0.5 mirror: {mirror} mean_value: 3 mean_value: 5 mean_value: 7.25 }}
        image_data_param {{ source: "{phase}.txt" batch_size: 2 new_height: 8 new_width: 10 }} }}
"""
READERS = IMAGE_DATA.format(phase="TRAIN", mirror="true") + IMAGE_DATA.format(
    phase="TEST", mirror="false"
)


def of_database(size: str = "crop_size: 8") -> str:
    """A reader of a database that is not here."""
    return f"""layer {{ name: "d" type: "Data" top: "data" top: "label" transform_param {{ {size} }}
                       data_param {{ source: "not_here" backend: LMDB batch_size: 9 }} }} """


def fc(name: str, bottom: str, more: str = "") -> str:
    return f'''layer {{ name: "{name}" type: "InnerProduct" bottom: "{bottom}" top: "{name}" {more}
                       inner_product_param {{ num_output: 4 weight_filler {{ type: "xavier" }} }} }} '''


def end(kind: str, *bottoms: str, more: str = "", name: str = "") -> str:
    read = " ".join(f'bottom: "{bottom}"' for bottom in bottoms)
    name = name or f"{kind}_{bottoms[0]}"
    return f'layer {{ name: "{name}" type: "{kind}" {read} top: "{name}" {more} }} '


def silence(bottom: str) -> str:
    return f'layer {{ name: "s" type: "Silence" bottom: "{bottom}" }} '


ENDS = end("SoftmaxWithLoss", "fc", "label") + end(
    "Accuracy", "fc", "label", more="include { phase: TEST }"
)
TRAINING = f'name: "small" {READERS} {fc("fc", "data")} {ENDS}'


@pytest.fixture(autouse=True)
def work(here: Path) -> None:
    """A folder with two pictures and the list of each phase."""
    for number in range(2):
        picture = np.random.default_rng(number).integers(0, 256, (8, 10, 3), np.uint8)
        cv2.imwrite(f"{number}.png", picture)
    for phase in ("TRAIN", "TEST"):
        Path(f"{phase}.txt").write_text("0.png 1\n1.png 3\n")


def deploy(text: str, *options: str) -> Net:
    """The deploy net of a training net."""
    Path("train_val.prototxt").write_text(text)
    run_tool("deploy train_val.prototxt deploy.prototxt", *options)
    return Net("deploy.prototxt", netlib.TEST)


def layers_of(net: Net) -> list[tuple[str, str]]:
    return [(layer.name, layer.type) for layer in net.layers if layer.type != "Split"]


def test_a_classifier() -> None:
    """Data becomes an input of one picture, the loss a Softmax; the weights of the
    training net fit.
    """
    net = deploy(TRAINING)
    assert layers_of(net) == [("data", "Input"), ("fc", "InnerProduct"), ("prob", "Softmax")]
    assert net.blobs["data"].shape == (1, 3, 8, 10)
    assert net.outputs == ["prob"]
    assert net.name == "small"
    assert "include" not in Path("deploy.prototxt").read_text()
    trained = Net("train_val.prototxt", netlib.TEST, seed=1)
    scores = trained.forward(["data", "fc"])
    net.copy_from(trained)
    prob = net.forward(data=scores["data"][:1])["prob"]
    e = np.exp(scores["fc"][:1])
    assert_allclose(prob, e / e.sum(), rtol=1e-5)


def test_the_command_in_the_comments_repeats_the_transformation() -> None:
    deploy(TRAINING)
    trained = Net("train_val.prototxt", netlib.TEST, seed=1)
    trained.save("net.caffemodel")
    comments = [line for line in Path("deploy.prototxt").read_text().splitlines() if line[0] == "#"]
    (line,) = [line for line in comments if "Run it: " in line]
    words = shlex.split(line.partition("run_net.py")[2])
    words = [{"WEIGHTS": "net.caffemodel", "IMAGE": "0.png"}.get(word, word) for word in words]
    run_tool("run_net", *words, "--blob", "data", "--out", "data.npy")
    assert_allclose(np.load("data.npy"), trained.forward(["data"])["data"][:1], rtol=1e-6)


V1 = """
layers { name: "d" type: DATA top: "data" top: "label" data_param { source: "x" batch_size: 1 crop_size: 8 } }
layers { name: "fc" type: INNER_PRODUCT bottom: "data" top: "fc" inner_product_param { num_output: 4 } }
layers { name: "l" type: SOFTMAX_LOSS bottom: "fc" bottom: "label" top: "l" }
"""


TEXTS = {
    "DATA": of_database(),
    "LABELMAP DATA": of_database().replace("Data", "LabelmapData"),
    "DATA OF A STAGE": of_database().replace("data_param", "include { stage: 'val' } data_param"),
    "INPUTS": inputs(x=(2, 3), t=(2,)),
    "READERS": READERS,
    "ENDS": ENDS,
    "SILENT K": silence("k"),
    "V1": V1,
}
LAYER = re.compile(r"(?:(\w+)=)?(\w+) ([\w,]+) ?(.*)")


def text_of(field: str) -> str:
    """The text of a field of training_nets.txt."""
    if field in TEXTS:
        return TEXTS[field]
    match = LAYER.fullmatch(field)
    assert match, field
    name, kind, bottoms, more = match.groups("")
    if kind == "fc":
        return fc(name, bottoms, more)
    return end(kind, *bottoms.split(","), more=more, name=name)


KINDS = dict(records_of(Path(__file__).with_name("training_nets.txt")))


@pytest.mark.parametrize("kind", KINDS)
def test_kinds_of_training_nets(kind: str) -> None:
    net = deploy("".join(map(text_of, KINDS[kind]["training"])))
    assert [" ".join(name for name, _ in layers_of(net))] == KINDS[kind]["deploy"]


def test_statistics_of_the_training_are_used() -> None:
    """A BatchNorm and a BN by the statistics of the batch, as in training nets, get those
    of the training.
    """
    options = "batch_norm_param { use_global_stats: false eps: 0.01 }"
    net = deploy(
        of_database() + end("BatchNorm", "data", name="b", more=options)
        + end("BN", "b", name="c", more="bn_param { bn_mode: LEARN }") + fc("fc", "c") + ENDS
    )  # fmt: skip
    assert net.layer_dict["b"].uses_sums
    assert net.layer_dict["b"].param.eps == pytest.approx(0.01)
    assert net.layer_dict["c"].param.bn_mode == "INFERENCE"


@pytest.mark.parametrize("value", ["false", "False", "f", "0"])
def test_all_forms_of_false_mean_the_statistics_of_the_batch(value: str) -> None:
    """As in Caffe, whose text format accepts them."""
    options = f"batch_norm_param {{ use_global_stats: {value} }}"
    net = deploy(of_database() + end("BatchNorm", "data", name="b", more=options)
                 + fc("fc", "b") + ENDS)  # fmt: skip
    assert net.layer_dict["b"].uses_sums


@pytest.mark.parametrize("mode", ["", "bn_mode: LEARN", "bn_mode: 0", "bn_mode: INFERENCE"])
def test_a_bn_of_segnet_infers(mode: str) -> None:
    """Its training nets rarely name the mode, which is LEARN by default."""
    options = f"bn_param {{ scale_filler {{ value: 1 }} {mode} }}"
    net = deploy(of_database() + end("BN", "data", name="c", more=options)
                 + fc("fc", "c") + ENDS)  # fmt: skip
    assert net.layer_dict["c"].param.bn_mode == "INFERENCE"


def test_a_bn_of_pspnet_has_no_mode() -> None:
    options = "bn_param { slope_filler { value: 1 } }"
    net = deploy(of_database() + end("BN", "data", name="c", more=options)
                 + fc("fc", "c") + ENDS)  # fmt: skip
    assert net.layer_dict["c"].averages and not net.layer_dict["c"].of_batch


SSD = """
layer {{ name: "d" type: "AnnotatedData" top: "data" top: "label"
        transform_param {{ mean_value: 104 resize_param {{ prob: 1 height: 8 width: 10 }} }} }}
layer {{ name: "loc" type: "InnerProduct" bottom: "data" top: "loc" inner_product_param {{ num_output: 320 }} }}
layer {{ name: "conf" type: "InnerProduct" bottom: "data" top: "conf" inner_product_param {{ num_output: 240 }} }}
layer {{ name: "prior" type: "PriorBox" bottom: "data" bottom: "data" top: "prior" prior_box_param {{ min_size: 3 }} }}
layer {{ name: "l" type: "MultiBoxLoss" bottom: "loc" bottom: "conf" bottom: "prior" bottom: "label" top: "l"
        multibox_loss_param {{ num_classes: 3 code_type: CENTER_SIZE }} }}
"""


def test_the_loss_of_ssd_becomes_detections() -> None:
    net = deploy(SSD.format())
    assert net.blobs["data"].shape == (1, 3, 8, 10)
    assert net.outputs == ["detection_out"]
    assert net.blobs["detection_out"].shape == (1, 1, 1, 7)
    assert net.layer_dict["detection_out"].param.code_type == "CENTER_SIZE"


@pytest.mark.parametrize(
    ("size", "shape"),
    [
        ("crop_size: 7", (1, 3, 7, 7)),
        ("crop_size: 7 force_gray: true", (1, 1, 7, 7)),
        ("crop_size: 7 force_gray: t", (1, 1, 7, 7)),
        ("crop_size: 7 force_gray: 1", (1, 1, 7, 7)),
        ("crop_size: 7 force_gray: 0", (1, 3, 7, 7)),
        ("crop_size: 7 mean_value: 1", (1, 3, 7, 7)),
        ('mean_file: "mean.binaryproto"', (1, 1, 5, 6)),
        ('crop_size: 4 mean_file: "mean.binaryproto"', (1, 1, 4, 4)),
    ],
)
def test_the_shape_of_a_missing_database_follows_from_its_transformation(
    size: str, shape: tuple[int, ...]
) -> None:
    write_blob(Path("mean.binaryproto"), np.zeros((1, 1, 5, 6), np.float32))
    assert deploy(of_database(size) + fc("fc", "data") + ENDS).blobs["data"].shape == shape


def test_an_unknown_shape_must_be_given() -> None:
    Path("t.prototxt").write_text(of_database("scale: 2") + fc("fc", "data") + ENDS)
    line = refusal("deploy t.prototxt d.prototxt")
    assert line.startswith("t.prototxt:1:7: the shape of 'data' is not in the prototxt")
    found = re.search(r"--shape (\S+)$", line)
    assert found
    run_tool("deploy t.prototxt d.prototxt --shape", found[1])
    assert Net("d.prototxt", netlib.TEST).blobs["data"].shape == (1, 3, 224, 224)
    assert "no input 'dat' (did you mean 'data'?)" in refusal(
        "deploy t.prototxt e.prototxt --shape dat=1,2"
    )


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (inputs(x=(1, 3)) + fc("fc", "x"), "this is a deploy net already"),
        (fc("fc", "x") + end("SoftmaxWithLoss", "fc", "label"), "no layer reads data"),
        (of_database() + silence("label"), "tells what the net predicts"),
    ],
)
def test_unsuitable_nets_are_rejected(text: str, message: str) -> None:
    Path("t.prototxt").write_text(text)
    assert message in refusal("deploy t.prototxt d.prototxt")


def test_layers_of_other_programs_are_kept() -> None:
    """The net is written, though it cannot be built here, and the comments say so."""
    Path("t.prototxt").write_text(
        of_database() + end("HSwish", "data", name="h") + fc("fc", "h") + ENDS
    )
    assert (
        "Not built here, because of layers of other programs: 'h' (HSwish)"
        in run_tool("deploy t.prototxt d.prototxt").out
    )
    assert "prob" in Path("d.prototxt").read_text()


def obey(line: str) -> None:
    """Run the command for a deploy net that a message names."""
    found = re.search(r"python tools/deploy\.py (\S+) (\S+)", line)
    assert found, line
    run_tool("deploy", found[1], found[2])


@pytest.mark.parametrize(
    ("tool", "words"),
    [
        ("run_net", "net.caffemodel 0.png --mean 3,5,7.25 --scale 0.5"),
        ("export_onnx", "net.caffemodel net.onnx --check"),
        ("time", "--iterations 1"),
    ],
)
def test_commands_name_the_one_that_writes_a_deploy_net(tool: str, words: str) -> None:
    """After it has run, the same command with its output succeeds."""
    if tool == "export_onnx":
        pytest.importorskip("onnxruntime")
    Path("t.prototxt").write_text(TRAINING)
    Net("t.prototxt", netlib.TEST).save("net.caffemodel")
    for phase in ("TRAIN", "TEST"):
        Path(f"{phase}.txt").unlink()
    line = refusal(tool, "t.prototxt", *words.split())
    Path("t.prototxt").write_text(
        TRAINING.replace("new_height: 8 new_width: 10", "new_height: 8  new_width: 10")
    )
    obey(line)
    run_tool(tool, "deploy.prototxt", *words.split())


@pytest.mark.parametrize("tool", ["run_net", "time", "draw_net"])
def test_a_reader_of_a_fork(tool: str) -> None:
    """The command is named though the layer type is unknown."""
    pytest.importorskip("pydot")
    Path("t.prototxt").write_text(
        of_database().replace("Data", "LabelmapData") + fc("fc", "data") + ENDS
    )
    words = {"run_net": ["w", "0.png"], "time": [], "draw_net": ["a.dot"]}[tool]
    obey(run_tool(tool, "t.prototxt", *words, status=None).err)


def test_data_of_phase_train_only() -> None:
    text = IMAGE_DATA.format(phase="TRAIN", mirror="true") + fc("fc", "data") + ENDS
    Path("t.prototxt").write_text(text)
    obey(refusal("run_net t.prototxt net.caffemodel 0.png"))


def test_finetune_names_it_too() -> None:
    Path("t.prototxt").write_text(TRAINING)
    line = refusal("finetune t.prototxt w pictures --mean 1 --scale 1")
    assert "this is a training net: layer 'reader' of type ImageData reads the data" in line
    obey(line)


def test_a_training_net_whose_data_are_here_is_timed_as_before() -> None:
    Path("t.prototxt").write_text(TRAINING)
    assert "Phase TRAIN" in run_tool("time t.prototxt --iterations 1").out
