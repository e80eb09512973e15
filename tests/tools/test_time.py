"""tools/time.py: the lines of ``caffe time``, and the use of memory."""

import re

import pytest

from tests.conftest import ENGINES
from tests.support.nets import inputs, ip, loss, shared
from tests.support.running import run_tool


def test_lines_are_caffes(work):
    """The averages are those of whole passes; test_caffe.py compares the lines."""
    out = run_tool("time net.prototxt --iterations 3").out
    ms = {
        what: float(number)
        for what, number in re.findall(r"^(.+): ([\d.e-]+) ms\.$", out, re.MULTILINE)
    }
    mean = ms["Average Forward-Backward"]
    assert ms["Average Forward pass"] + ms["Average Backward pass"] == pytest.approx(mean, rel=1e-4)
    assert ms["Total Time"] == pytest.approx(3 * mean, rel=1e-4)


def test_a_deploy_net_is_timed_in_phase_test(tmp_path):
    """Unless --phase says otherwise; the batch and the time of an item are printed."""
    net = tmp_path / "deploy.prototxt"
    net.write_text(
        inputs(data=(5, 3, 4, 4)) + ip("fc", "data", "fc") + 'layer { name: "s" type: "Softmax" '
        'bottom: "fc" top: "s" }'
    )
    out = run_tool("time", net, "--iterations", "2").out
    assert "\nPhase TEST, batch 5\n" in out
    mean = float(re.search(r"Average Forward pass: ([\d.e-]+) ms", out)[1])
    item = float(re.search(r"Per item of the batch of 5: ([\d.e-]+) ms forward, ", out)[1])
    assert item == pytest.approx(mean / 5, 1e-3)
    assert (
        "\nPhase TRAIN, batch 5\n"
        in run_tool("time", net, "--iterations", "1", "--phase", "TRAIN").out
    )
    net.write_text(
        inputs(map=(1, 2, 4, 4), rois=(2, 5))
        + 'layer { name: "pool" type: "ROIPooling" bottom: "map" '
        'bottom: "rois" top: "pool" roi_pooling_param { pooled_h: 2 pooled_w: 2 } }'
    )
    # regions of the first item
    assert "Average Forward pass" in run_tool("time", net, "--iterations", "1").out
    net.write_text(shared() + loss("b"))
    assert "\nPhase TRAIN, batch 2\n" in run_tool("time", net, "--iterations", "1").out


@pytest.mark.parametrize("name", ENGINES)
def test_memory(work, monkeypatch, name):
    """Blobs are listed with their size, except those that the fast engine stores for a
    part of the batch.
    """
    monkeypatch.setenv("NETLIB_ENGINE", name)
    out = run_tool("time net.prototxt --memory").out
    assert re.search(r" 1\.00 MiB  blob depth 16x1x128x128$", out, re.MULTILINE)
    assert ("blob convL1 " in out) == (name == "plain")
    assert out.endswith("MiB  peak of the process\n")


def test_threads_are_those_of_the_engine(work, other_engine):
    """--threads applies to the engine of --engine and is restored after timing single layers."""
    done = run_tool("time net.prototxt --iterations 1 --engine fast --threads 3")
    assert other_engine.threads() == 3
    assert re.match(r"Engine fast; .*, 3 threads\n", done.out)
