"""docs/making/pages.py: the pages of the book compute the same as netlib, and are operated
as by a reader.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from docs.making import pages
from tests.support.chromium_tabs import browser, visit

__all__ = ["browser", "visit"]  # fixtures
Visit = Callable[..., Any]
PageOf = Callable[[str], Path]


@pytest.fixture
def page_of(tmp_path: Path) -> PageOf:
    """``page_of("windows")``: the path of a page."""

    def path(name: str) -> Path:
        (tmp_path / f"{name}.html").write_text(pages.book_page(name), encoding="utf-8")
        return tmp_path / f"{name}.html"

    return path


@pytest.mark.parametrize("name", pages.BOOK)
def test_a_page_fits_a_phone_and_names_its_controls(
    visit: Visit, page_of: PageOf, name: str
) -> None:
    """No page is wider than a phone's window, and every control has a name."""
    tab = visit(page_of(name), viewport={"width": 360, "height": 740})
    assert tab.evaluate("document.documentElement.scrollWidth") <= 360
    unnamed = "(all) => all.filter((one) => !one.labels?.length && !one.ariaLabel && !one.textContent).length"
    assert tab.locator("input, select, button:not(:disabled)").evaluate_all(unnamed) == 0


@pytest.mark.parametrize("number", range(len(pages.LAYERS)), ids=list(pages.LAYERS))
def test_windows_are_those_of_the_layer(visit: Visit, page_of: PageOf, number: int) -> None:
    """For random numbers, some of them equal, the page and the layer compute the same y,
    dx, dw and db.
    """
    tab, rng = visit(page_of("windows")), np.random.default_rng(number)
    entry, (kind, options) = pages.windows()["layers"][number], list(pages.LAYERS.values())[number]
    picture = rng.integers(-3, 4, (6, 6))
    kernel = rng.integers(-3, 4, (3, 3))
    bias = int(rng.integers(-3, 4))
    layer, pad = pages.SmallLayer(kind, options, picture, kernel, bias), entry["pad"]
    dy = rng.integers(-3, 4, layer.y.shape)
    dx = layer.backward(dy)
    changed = {**entry, "x": np.pad(picture, pad).ravel().tolist(), "dy": dy.ravel().tolist()}
    if kind == "Convolution":
        changed |= {"w": kernel.ravel().tolist(), "b": [bias]}
    found = tab.evaluate("(layer) => page.slide(layer)", changed)
    assert_allclose(found["y"], layer.y.ravel())
    side = 6 + 2 * pad
    inside = slice(pad, side - pad)
    assert_allclose(np.reshape(found["dx"], (side, side))[inside, inside], dx)
    for name, blob in zip(("dw", "db"), layer.net.params.get("y", ())):
        assert_allclose(found[name], blob.diff.ravel())


def test_windows_in_use(visit: Visit, page_of: PageOf) -> None:
    """An output highlights its window; an edited number changes what depends on it."""
    tab = visit(page_of("windows"))
    tab.locator("#y button").nth(5).hover()
    assert tab.locator("#x .marked").count() == 9
    assert tab.locator("#formula b").inner_text().endswith("= −7")
    tab.locator("#b button").click()
    tab.locator("#value").fill("10")
    assert tab.locator("#y button").first.inner_text() == "−11"  # -21 without the bias
    tab.evaluate("page.step(16)")  # the first dy, which is 1: the kernel is stamped once
    assert [tab.locator("#dx button").nth(i).inner_text() for i in (0, 1, 2, 6)] == [
        "1",
        "0",
        "−1",
        "2",
    ]


def test_the_small_net_is_that_of_the_chapter(visit: Visit, page_of: PageOf) -> None:
    """For random numbers the page and netlib compute the same loss, values and gradients."""
    tab, rng = visit(page_of("small_net")), np.random.default_rng(0)
    for _ in range(5):
        net, data = pages.new_small_net(), pages.small_net()
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
            assert_allclose(found["values"][name], blob.data.ravel(), atol=1e-12)
            assert_allclose(found["diffs"][name], blob.diff.ravel(), atol=1e-12)
        for at, step in zip(net.connections, found["steps"]):
            for blob, diff in zip(at.layer.blobs, step["dparams"]):
                assert_allclose(diff, blob.diff, atol=1e-12)


def test_the_small_net_in_use(visit: Visit, page_of: PageOf) -> None:
    """Steps show the numbers of chapter 5, and an update lowers the loss."""
    tab = visit(page_of("small_net"))
    tab.locator("#step").fill("14")
    assert (
        "dh0 + dh1 + dh2 = [0.25, 0.5] + [0, 0] + [1.5, 0] = [1.75, 0.5]"
        in tab.locator("#step-text").inner_text()
    )
    tab.get_by_role("button", name="Update").click()
    assert float(tab.locator("#loss").inner_text().split("= ")[-1]) < 2.375
