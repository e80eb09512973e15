"""The packaged weights, and the cards that describe models.

A model is a folder, as in Caffe's model zoo. Its ``readme.md`` begins with front matter, lines
``key: value`` between two lines ``---``: name, caffemodel (the weights file), license, sha256
(its checksum), net_sha256 (the checksum of ``deploy.prototxt``, the net, with Unix line ends). The
weights are rounded and compressed; the file also has the network's errors.
"""

from __future__ import annotations

import functools
import hashlib
from dataclasses import dataclass
from pathlib import Path

from handpose.body.sides import SoughtSide
from handpose.estimate.finder import Finder
from handpose.estimate.hand import MIN_CONFIDENCE
from handpose.estimate.nets import best_fit, cube_of, hand_layer
from handpose.estimate.predictor import Predictor, check_options
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.settings import FinderSettings, Fit, FitSettings
from handpose.frames.cameras import NYU, Camera
from netlib import files
from netlib.errors import NetlibError, WeightsError
from netlib.files import Content
from netlib.files.paths import ROOT, find
from netlib.snapshots import snapshot
from netlib.training.trained import trained

SYNTHETIC_HAND = ROOT / "models" / "synthetic_hand"
PAPER_HAND = ROOT / "models" / "paper_hand"  # the paper's network, for the book
HAND_FINDER = ROOT / "models" / "hand_finder"
KEYS = ("name", "caffemodel", "license", "sha256", "net_sha256")


@dataclass(frozen=True)
class Card:
    """The front matter of a model's readme.md."""

    name: str
    weights: Path
    license: str
    sha256: str
    net: Path
    net_sha256: str


def read_card(folder: Path) -> Card:
    """The card of a model's folder. Raises NetlibError."""
    path = folder / "readme.md"
    lines = files.read_text(path, "the model's card", NetlibError).splitlines()
    if lines[:1] != ["---"] or "---" not in lines[1:]:
        raise NetlibError(
            f"{path}: no front matter; expected lines 'key: value' between two lines '---'"
        )
    said = dict(line.split(":", 1) for line in lines[1 : lines.index("---", 1)] if ":" in line)
    values = {key.strip(): value.strip() for key, value in said.items()}
    missing = [key for key in KEYS if not values.get(key)]
    if missing:
        raise NetlibError(
            f"{path}: no {missing[0]!r} in the front matter; expected {', '.join(KEYS)}"
        )
    return Card(
        values["name"],
        folder / values["caffemodel"],
        values["license"],
        values["sha256"],
        folder / "deploy.prototxt",
        values["net_sha256"],
    )


def checked_content(card: Card) -> Content:
    """The content of the weights file, after verifying its checksum. Raises WeightsError."""
    content = snapshot.read_content(card.weights)
    _check(card.weights, content.data, card.sha256)
    return content


def checked_net(card: Card) -> Path:
    """The path of the net, after verifying its checksum, so that no modified net runs.

    Raises WeightsError.
    """
    _check(card.net, net_content(card.net), card.net_sha256)
    return card.net


def net_content(path: Path) -> bytes:
    """The content of a net's file for which net_sha256 is computed. Raises WeightsError."""
    return files.read_bytes(path, "the net", WeightsError).replace(b"\r\n", b"\n")


def _check(path: Path, content: bytes, expected: str) -> None:
    found = hashlib.sha256(content).hexdigest()
    if found != expected:
        raise WeightsError(
            f"{path}: SHA-256 {found[:12]}..., the card says {expected[:12]}...; the file is damaged or "
            "of another version: get it again"
        )


def load_finder(
    folder: Path = HAND_FINDER,
    *,
    engine: str | None = None,
    settings: FinderSettings = FinderSettings(),
) -> Finder:
    """The packaged finder. Raises NetlibError."""
    card = read_card(folder)
    return Finder(trained(checked_net(card), checked_content(card), engine), settings)


def load_predictor(
    camera: Camera = NYU,
    *,
    cube_mm: float | None = None,
    hand: SoughtSide = "either",
    refine: int = 3,
    fit: Fit = "accurate",
    folder: Path = SYNTHETIC_HAND,
    engine: str | None = None,
    min_confidence: float = MIN_CONFIDENCE,
    seed: int = 0,
    settings: FitSettings = FitSettings(),
) -> Predictor:
    """A predictor with a packaged model; for the options see ``Predictor`` and ``DepthFitter``.

    Raises NetlibError.
    """
    check_options(cube_mm=cube_mm, hand=hand, refine=refine, fit=fit, min_confidence=min_confidence)
    card = read_card(folder)
    return predictor_of(
        checked_net(card),
        checked_content(card),
        camera,
        cube_mm=cube_mm,
        hand=hand,
        refine=refine,
        fit=fit,
        engine=engine,
        min_confidence=min_confidence,
        seed=seed,
        settings=settings,
    )


def predictor_of(
    model: str | Path,
    weights: str | Path | Content,
    camera: Camera,
    *,
    cube_mm: float | None = None,
    hand: SoughtSide | None = None,
    refine: int = 3,
    fit: Fit | None = None,
    engine: str | None = None,
    min_confidence: float = MIN_CONFIDENCE,
    seed: int = 0,
    settings: FitSettings = FitSettings(),
) -> Predictor:
    """A predictor with any net and its weights. Raises NetlibError.

    fit   default: the one that suits the net (``nets.best_fit``)
    hand  default: "either" with a fit, otherwise "right"
    """
    check_options(
        cube_mm=cube_mm,
        hand=hand or "right",
        refine=refine,
        fit=fit or "no",
        min_confidence=min_confidence,
    )  # before reading the weights
    content = (
        weights if isinstance(weights, Content) else snapshot.read_content(find(str(weights), None))
    )
    net = trained(model, content, engine)
    fit = fit or best_fit(net)
    hand = hand or ("right" if fit == "no" else "either")
    layer = hand_layer(net)
    fitter = None
    if fit != "no" and layer is not None:
        half = cube_of(layer.skeleton, cube_mm) / 2
        fitter = DepthFitter.of_file(layer.skeleton, content, half, seed, settings)
    return Predictor(
        net,
        camera,
        cube_mm=cube_mm,
        hand=hand,
        refine=refine,
        fit=fit,
        fitter=fitter,
        finder=functools.partial(load_finder, engine=engine, settings=settings.finder),
        min_confidence=min_confidence,
        settings=settings,
    )
