#!/usr/bin/env python3
"""Create a skeleton file for one person's hand from annotated frames: bones, fixed directions, initial pose and limits.

    python tools/calibrate_hand.py data/me/train.txt --out prototxt/hand/me.prototxt

ANNOTATIONS is an HDF5 file, or a list (.txt) of such files as for HDF5Data, with the data set joint (rows of 31 x 3
half-cubes from the crop centre, or of NYU's 14 evaluation joints) and optionally half_cube (mm). All frames must show
the same person. Joints outside the cube are ignored.

Bones and fixed directions that the frames do not determine stay close to those of the template, scaled to the size of
the hand; the report lists them. "+-" is the standard deviation. Limits are percentiles of the angles in the frames, so
the frames should show the full range of motion.
To use the file, set skeleton: "FILE" in the hand_model_param and the phys_limit_param of a net.

    python tools/calibrate_hand.py --from-depth frames/*.png --camera kinect2 --out prototxt/hand/me.prototxt

needs no annotation: it detects the hand in each depth frame, fits the packaged hand to it, and estimates the one size
and thickness that explain all frames best. About 20 frames of an open, moving hand are enough.
"""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import tools

tools.begin(__name__)

import numpy as np

from handpose import load_predictor
from handpose.body.nyu import CUBE_MM
from handpose.body.sides import SOUGHT_SIDES, is_mirrored
from handpose.estimate.person import hand_of
from handpose.fit.joints import calibration_report
from handpose.fit.joints.calibration import calibrate
from handpose.fit.joints.calibration_problem import MIN_FRAMES
from handpose.fit.joints.observations import read_observations
from handpose.fit.size_calibration import GRID, sized
from handpose.frames.images import read_frame
from layers.hand import skeleton as skeletons
from netlib import files
from netlib.files.paths import command
from tools.common import outputs
from tools.common.arguments import count, parser_of, positive, real, reject_given, seed
from tools.common.console import DONE, duration, guarded, say
from tools.common.hand_arguments import half_cube
from tools.common.outputs import check_skeleton, write_skeleton
from tools.common.progress import ProgressBar
from tools.common.sources import ABOUT_FRAMES, add_camera_options, frames_camera

OF_ANNOTATIONS, OF_DEPTH = ("template", "frames", "joints", "half_cube", "percentile", "seed"), (*ABOUT_FRAMES, "hand")
UNSURE = 0.03  # standard deviation of a size
LARGE_MM = 4.0  # mean distance; careful annotation of one person leaves 3 mm (NYU's two test subjects)


def main(argv: list[str] | None = None) -> int:
    """Run the tool; returns the exit status."""
    parser = parser_of(__doc__, nets=True)
    parser.add_argument("annotations", metavar="ANNOTATIONS", nargs="+",
                        help="an HDF5 file, or a list of them (.txt); depth frames with --from-depth")
    parser.add_argument("--from-depth", action="store_true",
                        help="estimate only size and thickness, from depth frames without annotation")
    add_camera_options(parser, "camera of the depth frames")
    parser.add_argument("--hand", choices=SOUGHT_SIDES, default="either",
                        help="hand in the depth frames (default: %(default)s, the one in most of them)")
    parser.add_argument("--out", metavar="FILE", type=Path, required=True, help="the skeleton file to write")
    parser.add_argument("--template", metavar="SKELETON", help="a skeleton file to start from (default: the NYU hand)")
    parser.add_argument("--frames", type=count, default=2000, metavar="N",
                        help="use N random frames (default: %(default)s; more give little improvement)")
    parser.add_argument(
        "--joints", type=positive, choices=(31, 14), help="number of NYU's joints to use (default: all available)"
    )
    parser.add_argument("--half-cube", type=half_cube, metavar="MM",
                        help="unit of the skeleton, and of frames without half_cube (default: "
                             f"the most frequent one, else {CUBE_MM / 2:g})")
    parser.add_argument("--percentile", type=real(0, 50), default=0.5, metavar="P",
                        help="limits are the P-th and (100 - P)-th percentiles (default: %(default)s)")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="seed of the random choices (default: 0)")
    parser.add_argument("--force", action="store_true", help="replace FILE if it exists")
    args = parser.parse_args(argv)
    if args.frames < MIN_FRAMES:
        parser.error(f"--frames must be at least {MIN_FRAMES}, found {args.frames}")
    if not 0 <= args.percentile < 50:
        parser.error(f"--percentile must be at least 0 and less than 50, found {args.percentile:g}")
    if args.from_depth != (args.camera is not None):
        parser.error("--from-depth and --camera must be given together")
    if args.from_depth:
        reject_given(parser, args, OF_ANNOTATIONS, "applies only to annotated frames")
    else:
        reject_given(parser, args, OF_DEPTH, "applies only with --from-depth")
    if not args.from_depth and len(args.annotations) > 1:
        parser.error(f"{len(args.annotations)} ANNOTATIONS; expected one file, or a list of files")
    return guarded(run_on_depth if args.from_depth else run, args)


def run(args: argparse.Namespace) -> int:
    """Calibrate from annotated frames. Raises NetlibError."""
    check_skeleton(args.out, args.force, args.annotations)
    template = skeletons.load(args.template) if args.template else skeletons.load()
    (annotations,) = args.annotations
    with files.noted() as read:
        frames = read_observations(
            annotations, template, args.joints, args.frames, args.seed, args.half_cube or CUBE_MM / 2
        )
    outputs.refuse_inputs(args.out, read)
    cubes, counts = np.unique(frames.half_cube, return_counts=True)
    unit = args.half_cube or float(cubes[counts.argmax()])
    begun = time.perf_counter()
    with ProgressBar(len(frames.targets)) as progress:
        found = calibrate(template, frames.targets * (frames.half_cube / unit)[:, None, None], frames.joints,
                          percentile=args.percentile, seed=args.seed, progress=progress)
    comment = calibration_report.comment(template, frames, found, unit, source=Path(annotations).name,
                                         percentile=args.percentile)
    write_skeleton(args.out, found.skeleton, comment)
    print(calibration_report.report(template, frames, found, unit))
    say(f"wrote {args.out} in {duration(time.perf_counter() - begun)}")
    after = float(np.nanmean(found.after)) * unit
    if after > LARGE_MM:
        say(f"warning: the mean distance of the joints to the hand is still {after:.1f} mm; check that all frames show "
            "one person, with joints in this order", file=sys.stderr)
    return DONE


def run_on_depth(args: argparse.Namespace) -> int:
    """Estimate size and thickness from depth frames. Raises NetlibError."""
    check_skeleton(args.out, args.force, args.annotations)
    begun = time.perf_counter()
    given, camera = frames_camera(args)
    predictor = load_predictor(camera, hand=args.hand)
    frames = [(image, read_frame(image, given)) for image in args.annotations]
    with ProgressBar((1 + len(GRID)) * len(frames)) as progress:
        hand, size = hand_of(predictor, frames, progress)
    words = (f"A {hand} hand of {size.size:.3f} +- {size.deviation:.3f} times the size of {predictor.skeleton.name}, "
             f"with {size.thickness:.2f} times its thickness, from {len(frames)} depth frames.")
    mirrored = " The file describes its mirror image, a right hand." if is_mirrored(hand) else ""
    write_skeleton(args.out, sized(predictor.skeleton, size), words + mirrored)
    say(words)
    say(f"wrote {args.out} in {duration(time.perf_counter() - begun)}")
    if size.at_the_edge:
        print(f"warning: this is at the end of the range tried, {GRID[0]:.2f} to {GRID[-1]:.2f}: the hand may be "
              "outside it; check camera and unit of the frames", file=sys.stderr)
    if size.deviation > UNSURE:
        print("warning: the two halves of the frames give different sizes; check that all frames show one person, and "
              f"that the hand is found in each ({command('predict')} draws it)", file=sys.stderr)
    return DONE


if __name__ == "__main__":
    sys.exit(main())
