"""The data of the networks of Table 1: NYU itself, or its setting with synthetic hands.

one_hand    train: one hand. test: the same hand, and a second, smaller one, in alternating blocks, like NYU
many_hands  the same poses of hands of many people: the cost of a model with fixed bones
nyu         NYU itself, prepared by tools/prepare_nyu.py. Its exact angles are unknown
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from handpose.body import nyu
from handpose.datasets import parts
from handpose.synthetic import recipes
from handpose.synthetic.files import DataSet
from handpose.synthetic.generator import Generator, Split
from netlib.errors import DataError
from netlib.files.hdf5 import read_list

SPLITS: tuple[Split, ...] = ("train", "test")
SEED = 1  # seed of the synthetic frames
NEAR = 1.0  # mm: a half-cube is that of a subject


@dataclass(frozen=True)
class Setting:
    """One data set.

    name      in the results store
    title     on the page
    folder    of the data; the fitted angles are in a folder next to it
    recipe    of ``handpose.synthetic.recipes``; None for existing data
    subjects  of the test frames, by the half of their cube in mm; None: unknown
    """

    name: str
    title: str
    folder: Path
    recipe: str | None
    subjects: Mapping[str, float | None]
    counts: Mapping[Split, int] = field(default_factory=dict)

    @property
    def angles(self) -> Path:
        """The folder of the fitted angles."""
        return self.folder.with_name(f"{self.folder.name}_angles")

    @property
    def has_exact_angles(self) -> bool:
        """True if the exact inputs of the hand model are known."""
        return self.recipe is not None

    @property
    def has_many_people(self) -> bool:
        """True if hands differ from frame to frame, and the rows have their bones."""
        return None in self.subjects.values()

    def list_of(self, split: Split, fitted: bool = False) -> Path:
        """The list of the files of a split; with the fitted angles as labels."""
        return (self.angles if fitted else self.folder) / f"{split}.txt"

    def files(self, split: Split) -> list[Path]:
        """The files of a split. Raises DataError."""
        return read_list(str(self.list_of(split)), None)

    def data_set(self) -> DataSet | None:
        """The data to be generated, or None if they cannot be. Raises DataError."""
        if self.recipe is None:
            return None
        recipe = recipes.recipe(self.recipe)
        return DataSet(self.folder, [(Generator(SEED, split, recipe), count) for split, count in self.counts.items()])


COUNTS: Mapping[Split, int] = {"train": nyu.TRAIN_FRAMES, "test": 4096}

NYUS: Mapping[str, float | None] = {"same hand": nyu.CUBE_MM / 2, "smaller hand": nyu.SECOND_CUBE_MM / 2}

ONE_HAND = Setting("one_hand", "one hand, as in NYU", Path("data/one_hand"), "one_hand", NYUS, COUNTS)
MANY_HANDS = Setting(
    "many_hands", "hands of many people", Path("data/many_hands"), "many_hands", {"many people": None}, COUNTS
)
REAL = Setting("nyu", "NYU", Path("data/nyu"), None, NYUS)
SETTINGS = {setting.name: setting for setting in (REAL, ONE_HAND, MANY_HANDS)}  # the nearest to the paper's first


def is_real_nyu(setting: Setting = REAL) -> bool:
    """True if the folder of NYU holds NYU itself, not synthetic hands."""
    try:
        first = setting.files("train")[0]
    except DataError:
        return False
    return (parts.attributes(first) or {}).get("made_from") == "NYU"
