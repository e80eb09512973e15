"""experiments/table1/page.py and speed.py; its pictures are in the tests of tools/table1.py"""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from experiments.table1 import page as table1_page
from experiments.table1 import speed, store
from experiments.table1.networks import LAMBDAS
from experiments.table1.recipes import ADAM, PAPER
from experiments.table1.settings import MANY_HANDS, ONE_HAND, REAL, SETTINGS
from netlib.errors import DataError
from tests.support.made_store import entry, trained

RESULTS = Path(__file__).resolve().parents[3] / "docs" / "results"


def test_the_page_that_is_there_is_that_of_the_store_that_is_there() -> None:
    """The page in docs/ equals the one generated from the stored results; to update it, run tools/table1.py --page."""
    entries = {name: store.read_all(RESULTS / "table1", name) for name in SETTINGS}
    page = table1_page.page_of(entries, speed.read(RESULTS / "table1" / speed.WHERE))
    assert (RESULTS / "table1.md").read_text(encoding="utf-8") == page
    for picture in re.findall(r"!\[.*\]\((.*)\)", page):
        assert (RESULTS / picture).is_file(), picture


def test_tables_findings_and_pictures() -> None:
    """Each setting and recipe has a table with means, spreads, convergence and the paper's figures."""
    entries = {"one_hand": [*trained(), *trained(recipe=ADAM, seeds=(1,))], "many_hands": [*trained(MANY_HANDS)]}
    page = table1_page.page_of(entries, speed.Speed(812.4, 4000.0, 64, "fast", 2, "a machine, 2 cores"))
    titles = ["one hand, as in NYU: our recipe", "one hand, as in NYU: the paper's solver",
              "hands of many people: the paper's solver", "Speed"]
    assert re.findall(r"^## (.*)$", page, re.MULTILINE) == titles
    assert ("| ours | 17.93 ± 0.01 | 16.93 ± 0.01 | 18.93 ± 0.01 | 12.20 ± 0.00° | 11.20 ± 0.00° | 0.9% ± 0.0% | "
            "50.0% ± 0.0% | 6,000 | converged | 16.9 mm | 12.2° |") in page
    assert "| DeepPrior's bottleneck | 19.02 | 18.02 | 20.02 | 22.00° | 21.00° | – |" in page
    assert page.count("| ours is better on joints than direct joint | **confirmed** |") == 1
    assert page.count("| **undecided**: one seed | +0.30 mm | +0.30 mm |") == 1
    assert "| ours, predicted angles with the person's bones | 13.93 ± 0.01 |" in page
    assert "| ours minus direct joint, hands of many people | -0.30 ± 0.00 |" in page
    assert "| here, one frame at a time | 812 |" in page and "| paper, on a GPU | 125 |" in page
    assert len(re.findall(r"!\[", page)) == 6 and "lambda" not in page
    left = ("one hand, as in NYU, our recipe: 6 of 12; hands of many people, our recipe: 8 of 8; "
            "one hand, as in NYU, the weight of PhysLimit: 6 of 8.")
    assert f"**Missing training runs:** {left}" in page


def test_nothing_and_nyu() -> None:
    """Without entries the page says so; NYU has no exact angles, so no finding uses them."""
    page = table1_page.page_of({})
    assert "one hand, as in NYU, our recipe: 12 of 12; one hand, as in NYU, the paper's solver: 10 of 10; hands" in page
    assert "not measured yet" in page
    real = table1_page.page_of({"nyu": list(trained(REAL))})
    assert "## NYU: the paper's solver" in real and "by the exact angles" not in real


def test_nyu_comes_first() -> None:
    """With NYU's entries, NYU comes first, is drawn and counted, and is compared with many people."""
    entries = {where.name: list(trained(where)) for where in (ONE_HAND, MANY_HANDS, REAL)}
    entries["nyu"] += [entry(n.name, 18, 6000, setting=REAL) for n in LAMBDAS if n.limit]
    page = table1_page.page_of(entries)
    titles = re.findall(r"^## (.*)$", page, re.MULTILINE)
    assert [title.split(":")[0] for title in titles] == ["NYU", "NYU", ONE_HAND.title, MANY_HANDS.title, "Speed"]
    assert page.count("![") == 4 and page.count("NYU, the paper's solver](table1_") == 3
    assert "Missing training runs:** NYU, our recipe: 10 of 10; hands of many people" in page
    assert "| ours minus direct joint, NYU | " in page


def test_the_weights_of_physlimit() -> None:
    """Each weight has one row, of the same length, with L2 after L1."""
    entries = [*trained(), *(entry(n.name, 18, 6000) for n in LAMBDAS if n.limit), entry("ours_l2_1", 30, 4000)]
    page = table1_page.page_of({"one_hand": entries})
    rows = re.findall(r"^\| ([\d.]+) \| (–|L[12]) \| ([\d.]+) \|", page, re.MULTILINE)
    assert [(weight, norm) for weight, norm, _ in rows] == [
        ("0", "–"), ("0.01", "L1"), ("0.1", "L1"), ("1", "L1"), ("10", "L1"), ("0.1", "L2"), ("1", "L2"), ("10", "L2"),
    ]
    assert rows[6][2] == "19.00" and f"Ours with {PAPER.title}, 6,000 iterations" in page
    assert ONE_HAND.title in page and "(table1_lambda_paper.png)" in page


def test_speed_is_measured_and_kept(tmp_path: Path) -> None:
    """The speed is stored with the machine; a damaged file raises an error."""
    found = speed.measure(rounds=1)
    assert found.single > 0 and found.batched > 0 and re.search(r", \d+ cores?$", found.machine)
    path = tmp_path / "new" / speed.WHERE
    assert speed.read(path) is None
    speed.write(path, found)
    assert speed.read(path) == found
    path.write_text("{}")
    with pytest.raises(DataError, match="there is no 'single'"):
        speed.read(path)
