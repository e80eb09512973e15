"""The hand that is fitted by default: its skeleton, and the distribution of its poses with
exactly its bones.
"""

from __future__ import annotations

from handpose.synthetic import prior_file

EXACT = prior_file.load(prior_file.PEOPLE_PRIOR).but(
    scale_mean=1, scale_std=0, proportion=(), bone_std=0
)
SKELETON = EXACT.body()
