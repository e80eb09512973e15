"""docs/making/pages: the pages on windows and the small net, operated as by a reader."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from docs.making import hand_picture, pages
from docs.making.pages import PAGES, small_net, windows
from tests.support.chromium_tabs import browser, visit

__all__ = ["browser", "visit"]  # fixtures
Visit = Callable[..., Any]
PageOf = Callable[[str], Path]
PHONE = {"viewport": {"width": 360, "height": 740}}
LARGEST = 250_000  # bytes of a page


@pytest.fixture(scope="module")
def page_of(tmp_path_factory: pytest.TempPathFactory) -> PageOf:
    """``page_of("windows")``: the path of a page."""
    folder = tmp_path_factory.mktemp("pages")
    made = {one.path.stem: one for one in pages.made()}

    def path(name: str) -> Path:
        replace(made[name], path=folder / made[name].path.name).update()
        return folder / made[name].path.name

    return path


@pytest.mark.parametrize("name", PAGES)
def test_a_page_fits_a_phone_and_names_its_controls(visit: Visit, page_of: PageOf, name: str) -> None:
    """No page is wider than a phone's window, and every control has a name."""
    tab = visit(page_of(name), **PHONE)
    assert tab.evaluate("document.documentElement.scrollWidth") <= 360
    unnamed = "(all) => all.filter((one) => !one.labels?.length && !one.ariaLabel && !one.textContent).length"
    assert tab.locator("input, select, button:not(:disabled)").evaluate_all(unnamed) == 0
    assert page_of(name).stat().st_size < LARGEST


def test_the_picture_of_the_hand(browser: Any, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """``python -m docs.making.hand_picture`` makes the picture from the page, in its declared size and not empty."""
    monkeypatch.setattr("docs.making.chromium.chromium", lambda: contextlib.nullcontext(browser))
    monkeypatch.setattr(hand_picture, "PICTURE", tmp_path / "hand.png")
    monkeypatch.setattr("docs.making.chromium.ROOT", tmp_path)
    assert hand_picture.main() == 0
    image = cv2.imread(str(tmp_path / "hand.png"))
    assert image.shape == (hand_picture.SIZE["height"], hand_picture.SIZE["width"], 3)
    assert len(np.unique(image.reshape(-1, 3), axis=0)) > 1000


# ---------------------------------------------------------------------------------------------- windows


@pytest.mark.parametrize("number", range(len(windows.LAYERS)), ids=list(windows.LAYERS))
def test_the_page_computes_what_the_layer_does(visit: Visit, page_of: PageOf, number: int) -> None:
    """For random numbers, some of them equal, the page and the layer compute the same y, dx, dw and db."""
    tab, rng = visit(page_of("windows")), np.random.default_rng(number)
    entry, (kind, options) = windows.data()["layers"][number], list(windows.LAYERS.values())[number]
    picture, kernel, bias = rng.integers(-3, 4, (6, 6)), rng.integers(-3, 4, (3, 3)), int(rng.integers(-3, 4))
    layer, pad = windows.Layer(kind, options, picture, kernel, bias), entry["pad"]
    dy = rng.integers(-3, 4, layer.y.shape)
    dx = layer.backward(dy)
    changed = {**entry, "x": np.pad(picture, pad).ravel().tolist(), "dy": dy.ravel().tolist()}
    if kind == "Convolution":
        changed |= {"w": kernel.ravel().tolist(), "b": [bias]}
    found = tab.evaluate("(layer) => page.slide(layer)", changed)
    np.testing.assert_allclose(found["y"], layer.y.ravel())
    side = 6 + 2 * pad
    np.testing.assert_allclose(np.reshape(found["dx"], (side, side))[pad : side - pad, pad : side - pad], dx)
    for name, blob in zip(("dw", "db"), layer.net.params.get("y", ())):
        np.testing.assert_allclose(found[name], blob.diff.ravel())


def test_windows_in_use(visit: Visit, page_of: PageOf) -> None:
    """An output highlights its window, an input its consumers; arrow keys move between values and skip padding."""
    tab = visit(page_of("windows"))
    tab.locator("#y button").nth(5).hover()
    assert tab.locator("#x .marked").count() == 9 and tab.locator("#w .marked").count() == 9
    assert tab.locator("#formula b").inner_text().endswith("= −7")
    tab.locator("#dx button").first.focus()
    assert tab.locator("#y .marked").count() == 1
    tab.keyboard.press("ArrowRight")
    assert tab.locator("#y .marked").count() == 2
    assert tab.locator("#formula").inner_text().startswith("dx[0, 1] = ")
    tab.get_by_label("Layer").select_option(label="max pooling 3 × 3, stride 2 (windows overlap)")
    tab.locator("#x button").nth(14).click()
    assert tab.locator("#y .marked").count() == 4 and tab.locator("#y .winner").count() == 4
    assert tab.locator("#formula b").inner_text() == "dx[2, 2] = 1 · 1 + 1 · 2 + 1 · (−1) + 1 · 1 = 3"
    tab.get_by_label("Layer").select_option(label="convolution 3 × 3, pad 1")
    assert tab.locator("#x .padding").count() == 64 - 36
    tab.locator("#x button").nth(9).focus()
    tab.keyboard.press("ArrowUp")
    assert tab.locator("#formula").inner_text().startswith("dx[0, 0] = ")


def test_numbers_are_changed_and_played(visit: Visit, page_of: PageOf) -> None:
    """An edited number changes all that depends on it, a weight shows dw as a sum, and Play stamps one dy at a time."""
    tab = visit(page_of("windows"), alone=True)
    tab.locator("#b button").click()
    tab.locator("#value").fill("10")
    assert tab.locator("#y button").first.inner_text() == "−11"  # -21 without the bias
    assert tab.locator("#formula b").inner_text().startswith("db = ")
    tab.locator("#dw button").nth(4).click()
    assert tab.locator("#edited").inner_text() == "w[1, 1] =" and tab.locator("#y .marked").count() == 16
    assert tab.locator("#formula b").inner_text().endswith(" = 37")
    tab.get_by_role("button", name="One more").click()
    assert tab.locator("#w button").nth(4).inner_text() == "1" and tab.locator("#value").input_value() == "1"
    tab.evaluate("page.step(3)")
    assert tab.locator("#y .chosen").count() == 1 and set(tab.locator("#dx button").all_inner_texts()) == {"0"}
    tab.evaluate("page.step(16)")  # the first dy, which is 1: the kernel is stamped once
    stamped = [tab.locator("#dx button").nth(i).inner_text() for i in (0, 1, 2, 6, 7, 8)]
    assert stamped == ["1", "0", "−1", "2", "1", "−2"] and tab.locator("#db button").inner_text() == "1"
    tab.clock.install()  # time passes only as said
    tab.get_by_role("button", name="Play").click()
    tab.clock.run_for(20 * 700)
    assert tab.locator("#play").inner_text() == "■ Stop" and tab.locator("#dy .chosen").count() == 1
    tab.clock.run_for(12 * 700)
    assert tab.locator("#play").inner_text() == "▶ Play" and tab.locator("#db button").inner_text() == "3"
    tab.get_by_role("button", name="Reset").click()
    assert tab.locator("#y button").first.inner_text() == "−21"


# ---------------------------------------------------------------------------------------------- the small net


def test_the_passes_are_those_of_the_net(visit: Visit, page_of: PageOf) -> None:
    """For random numbers the page and netlib compute the same loss, values and gradients."""
    tab, rng = visit(page_of("small_net")), np.random.default_rng(0)
    for _ in range(5):
        net, data = small_net.net(), small_net.data()
        for name in data["inputs"]:
            net.blobs[name].data[...] = rng.normal()
            data["inputs"][name] = net.blobs[name].data.ravel().tolist()
        for at, layer in zip(net.connections, data["layers"]):
            for blob in at.layer.blobs:
                blob.data[...] = rng.normal(size=blob.shape)
            layer["params"] = [blob.data.tolist() for blob in at.layer.blobs]
        found = tab.evaluate("(net) => page.pass(net)", data)
        assert found["loss"] == pytest.approx(net.run_forward(), abs=1e-12)
        net.run_backward()
        for name, blob in net.blobs.items():
            np.testing.assert_allclose(found["values"][name], blob.data.ravel(), atol=1e-12)
            np.testing.assert_allclose(found["diffs"][name], blob.diff.ravel(), atol=1e-12)
        for at, step in zip(net.connections, found["steps"]):
            for blob, diff in zip(at.layer.blobs, step["dparams"]):
                np.testing.assert_allclose(diff, blob.diff, atol=1e-12)


def test_the_small_net_in_use(visit: Visit, page_of: PageOf) -> None:
    """Steps show the numbers of chapter 5, an edited weight repeats the pass, and an update lowers the loss."""
    tab = visit(page_of("small_net"))
    for _ in range(3):
        tab.get_by_role("button", name="Step").click()
    assert tab.locator("#step-text").inner_text() == "Forward, second: h = a wᵀ + b: 1 · 3 + 0 = 3; (−1) · 3 + 1 = −2"
    assert tab.locator("#graph .runs").count() == 1
    tab.locator("#step").fill("14")
    assert "dh0 + dh1 + dh2 = [0.25, 0.5] + [0, 0] + [1.5, 0] = [1.75, 0.5]" in tab.locator("#step-text").inner_text()
    tab.locator("#step").press("ArrowRight")
    assert tab.locator("#step-text").inner_text().startswith("Backward, relu: dh = [1.75, 0.5] becomes [1.75, 0]")
    assert tab.locator("#loss").inner_text() == "L = 1 · 0.125 + 0.25 · 9 = 2.375"
    tab.locator('[data-name="out w[0, 0]"]').fill("1")
    assert tab.locator("#loss").inner_text() == "L = 1 · 2 + 0.25 · 9 = 4.25"
    tab.get_by_role("button", name="Reset").click()
    tab.get_by_role("button", name="Update").click()
    assert float(tab.locator("#loss").inner_text().split("= ")[-1]) < 2.375
    assert tab.locator('[data-name="second w[0, 0]"]').input_value() == "0.895"
