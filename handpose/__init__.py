"""Hand pose from depth images: data sets, synthetic frames, predictors, fits, trackers and their scores.

facts, data, importers, sources (cameras and recordings), surface, joint_formats, synthetic, sequences,
joint_fit, depth_fit, prediction, gestures, tracking, track_files, live, scoring, drawing, experiments.
setup.cfg has the order of their imports.
"""

import sys

from handpose.moved import OldNames

sys.meta_path.insert(0, OldNames())

__version__ = "0.1.0"  # of the package: setup.cfg and 'handpose --version' read it here
