"""Facts about the ICVL hand posture data set (Tang et al., 2014), and where its joints lie on the model.

More than 300,000 training frames (the recorded ones and copies turned in the image plane) and 702 + 894 test frames of
two sequences, 320 x 240, with 16 joints: the palm, and root, mid and tip of each finger from the thumb on.

ICVL shows the mirror image of NYU's hand; the skeleton ``prototxt/hand/icvl.prototxt`` is the mirrored one.
"""

from __future__ import annotations

TRAIN_FRAMES = 300_000  # at least
TEST_FRAMES = (702, 894)  # numbers of frames of the two test sequences

CUBE_MM = 250.0  # edge of the cube around the hand
CENTER_JOINT = 0  # the palm, at which crops are centred unless other centres are given

FINGERS = ("thumb", "index", "middle", "ring", "little")
JOINTS = ("palm", *(f"{finger}_{part}" for finger in FINGERS for part in ("root", "mid", "tip")))

# For each joint, the one or two joints of the model's 31 in whose middle it is. A "tip" of ICVL lies in the last
# phalanx: along NYU's fingers, scaled to ICVL's, it is the DIP point, and not the tip.
MODEL_JOINTS: dict[str, tuple[str, ...]] = {
    "palm": ("palm",),
    "thumb_root": ("thumb_pip",),
    "thumb_mid": ("thumb_dip",),
    "thumb_tip": ("thumb_tip",),
}
for _finger in FINGERS[1:]:
    MODEL_JOINTS[f"{_finger}_root"] = (f"{_finger}_base",)
    MODEL_JOINTS[f"{_finger}_mid"] = (f"{_finger}_pip_a", f"{_finger}_pip_b")
    MODEL_JOINTS[f"{_finger}_tip"] = (f"{_finger}_dip",)
