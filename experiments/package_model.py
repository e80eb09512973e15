"""Package weights as a small file for fits: rounded, compressed, and with the measured errors
of the network.

    python -m experiments package_model snapshots/synthetic_iter_80000.caffemodel.h5 \\
        --model models/synthetic_hand/deploy.prototxt \\
        --out models/synthetic_hand/synthetic_hand.caffemodel.h5

Measured on training frames of a recipe (listed by tools/make_synthetic.py --help) that the network
was not trained on: the errors of its angles, which determine further starts of a fit and its prior,
and the distribution of the angles, natural poses for the fit. Weights of a net without a hand model
are only rounded and compressed. Caffe can read the file.
"""

from __future__ import annotations

import argparse
import hashlib
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from experiments.fit import Figures, measure, scenes_of
from handpose.estimate.nets import hand_layer, refuse_other_bodies, skeleton_to_fit
from handpose.estimate.packaged import net_content
from handpose.fit.body import CapsuleModel
from handpose.fit.depth_fit import DepthFitter
from handpose.fit.network_errors import GROUP, NetworkErrors, Poses, arrays_of, covariance
from handpose.synthetic import recipes
from handpose.synthetic.generator import Generator
from netlib.files import hdf5
from netlib.net import Net
from netlib.training.trained import trained
from tools.common import outputs
from tools.common.arguments import count, seed, whole
from tools.common.console import say
from tools.common.progress import ProgressBar

# options of h5py, which Caffe's HDF5 library can read, too
COMPRESSED: dict[str, Any] = {"compression": "gzip", "compression_opts": 9, "shuffle": True}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options."""
    parser.add_argument("snapshot", metavar="SNAPSHOT", help="weights, *.caffemodel.h5")
    parser.add_argument(
        "--model", metavar="NET", required=True, help="deploy prototxt of their net"
    )
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="file to write")
    parser.add_argument(
        "--bits",
        type=whole(0, 23),
        default=10,
        metavar="N",
        help="bits of each mantissa, at most 23 (default: %(default)s)",
    )
    parser.add_argument(
        "--recipe", choices=recipes.NAMES, default="people", help="default: %(default)s"
    )
    parser.add_argument(
        "--frames",
        type=count,
        default=8192,
        metavar="N",
        help="rounded up to a multiple of 64 (default: %(default)s)",
    )
    parser.add_argument(
        "--without-poses",
        action="store_true",
        help="leave out natural poses: fits are drawn to the network's poses only",
    )
    parser.add_argument(
        "--seed",
        type=seed,
        default=1000,
        metavar="N",
        help="seed of the frames, unlike that of the training (default: %(default)s)",
    )


def run(args: argparse.Namespace) -> None:
    """Measure the errors and write the file. Raises NetlibError."""
    outputs.check_place(args.out, [args.snapshot, args.model])
    net = trained(args.model, args.snapshot)
    if hand_layer(net) is None:
        _round(net, args.bits)
        write_model(net, None, args.out)
    else:
        _measure(net, args)
    content = args.out.read_bytes()
    megabytes = len(content) / 1e6
    sha256 = hashlib.sha256(content).hexdigest()
    net_sha256 = hashlib.sha256(net_content(Path(args.model))).hexdigest()
    say(f"wrote {args.out}: {megabytes:.2f} MB, sha256: {sha256}, net_sha256: {net_sha256}")


def _round(net: Net, bits: int) -> None:
    """Round the weights of a net in place, to ``bits`` bits of each mantissa."""
    for blobs in net.params.values():
        for blob in blobs:
            blob.data[...] = rounded(blob.data, bits)


def _measure(net: Net, args: argparse.Namespace) -> None:
    """Round the weights, measure the errors of the network, and write the file.

    Raises NetlibError, also for another body than a hand.
    """
    skeleton = skeleton_to_fit(net)
    refuse_other_bodies(skeleton, "errors are measured on frames of hands")
    generator = Generator(args.seed, "train", recipes.recipe(args.recipe))

    def fitter(unit_mm: float) -> DepthFitter:
        return DepthFitter(CapsuleModel(skeleton, unit_mm))

    with ProgressBar(2 * args.frames) as progress:

        def measured() -> Figures:
            scenes = scenes_of(generator, args.frames)
            return measure(net, fitter, scenes, (), progress=progress)

        exact = measured()
        _round(net, args.bits)
        found = measured()
    poses = None if args.without_poses else Poses.of(found.poses)
    write_model(net, NetworkErrors(covariance(found.limbs), poses), args.out)
    before, after = exact.network.mean(), found.network.mean()
    say(
        f"{len(found.network)} frames of the recipe {args.recipe}: network {before:.2f} mm, "
        f"with {args.bits} bits {after:.2f} mm"
    )


def rounded(values: NDArray[np.float32], bits: int) -> NDArray[np.float32]:
    """The values with ``bits`` of the 23 bits of a mantissa, rounded to nearest, ties to even."""
    mantissa, exponent = np.frexp(values.astype(np.float64))  # mantissas from 0.5 to 1
    whole = np.rint(np.ldexp(mantissa, bits + 1))
    return np.asarray(np.ldexp(whole, exponent - bits - 1), np.float32)


def write_model(net: Net, errors: NetworkErrors | None, path: Path) -> None:
    """Write the net's weights in Caffe's HDF5 format (float32), shuffled and compressed, with the
    network's errors.
    """
    with hdf5.created(path) as file:
        for layer, blobs in net.params.items():
            for i, blob in enumerate(blobs):
                values = np.asarray(blob.data, np.float32)
                file.create_dataset(f"data/{layer}/{i}", data=values, **COMPRESSED)
        for name, values in arrays_of(errors).items() if errors else ():
            file.create_dataset(f"{GROUP}/{name}", data=values)
