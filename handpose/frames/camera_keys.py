"""The keys of a camera.json, their ranges, and their names in the files of other programs."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any, TypeGuard

from handpose.frames.cameras import MIN_FOCAL_PX, MIN_RANGE_MM
from netlib.errors import did_you_mean

BROWN = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6")  # in OpenCV's order
RANGES = {  # exclusive lower and inclusive upper bounds
    "fx": (MIN_FOCAL_PX, 1e6),
    "fy": (MIN_FOCAL_PX, 1e6),
    "u0": (-1e6, 1e6),
    "v0": (-1e6, 1e6),
    "unit_mm": (1e-6, 1e4),
    "rate": (1e-6, 1e4),
    "width": (0, 1 << 14),
    "height": (0, 1 << 14),
    "min_range_mm": (-1e-6, 1e4),  # 0: every reading counts
} | dict.fromkeys(BROWN, (-1e300, 1e300))
INTRINSICS, SIZE = ("fx", "fy", "u0", "v0"), ("width", "height")
CAMERA = (*SIZE, *INTRINSICS, "name", "min_range_mm")  # the keys of a camera
DEFAULTS: dict[str, Any] = {"width": 0, "height": 0, "name": "own", "min_range_mm": MIN_RANGE_MM}
LENS = ("distortion", "model", *BROWN)
FIELDS = ("unit_mm", "rate", "time_unit")  # those that are fields of CameraInfo
KNOWN = (*RANGES, "name", "distortion", "model", "coefficients", "time_unit")
ROWS = {"focal": ("fx", "fy"), "middle": ("u0", "v0"), "size": SIZE}  # keys of two values
AXES = ("x", "y")  # keys of the two in an object
# Each line: a key and its other names, in lower case, letters and digits only.
KEY_NAMES = """\
unit_mm unitmm
min_range_mm minrangemm
time_unit timeunit
fx flx focalx focallengthx fxdepth depthfx
fy fly focaly focallengthy fydepth depthfy
u0 cx ppx principalpointx mxdepth cxdepth depthcx centerx
v0 cy ppy principalpointy mydepth cydepth depthcy centery
focal focallength focallengths
middle principalpoint opticalcenter princpt
width imagewidth imgwidth w depthwidth mdepthwidth resolutionwidth resolutionx framewidth
height imageheight imgheight h depthheight mdepthheight resolutionheight resolutiony frameheight
size resolution imagesize imgsize framesize imageresolution
matrix k intrinsics intrinsic intrinsicmatrix cameramatrix cameraintrinsics cameraintrinsic
matrix depthintrinsics depthintrinsic cammat camk camerak depthk kdepth mtx intrinsicsmatrix
matrix intrinsicparameters kmatrix depthintrinsicmatrix depthcameramatrix camintrinsics
matrix camintrinsic mcalibrationdepthintrinsic intrinsicdepth intrinsicsdepth calibrationmatrix
matrix cameraintrinsicmatrix cameraintrinsicsmatrix
rate fps framerate
depthscale scale depthunits pngdepthscale depthmapfactor depthfactor factor mdepthshift
depthscale depthunit depthmapscale depthscalefactor depthscalingfactor depthtometers
distortion coefficients coeffs d dist distcoeff distcoeffs distcoefs distcoef distortioncoefficients
distortion distortioncoeffs distortioncoeff distortionparameters distortionparams depthdistortion
model distortionmodel distortiontype distorsion
name cameraname
k1
k2
p1 tangentialdistortioncoefficientx
p2 tangentialdistortioncoefficienty
k3
k4
k5
k6
"""
ALIASES = {
    alias: key
    for key, *aliases in map(str.split, KEY_NAMES.splitlines())
    for alias in (key, *aliases)
}
# What is in the texts that are not read, and what to do.
NOT_READ = {
    r"(?m)^\d+ [A-Z_]+(?: [\d.e+-]+){5,}$": (
        "COLMAP's cameras; give --camera FX,FY,U0,V0 with the numbers after its width and height, of "
        "models such as SIMPLE_PINHOLE with FX twice"
    ),
    '"CalibrationInformation"': (
        "the raw calibration of an Azure Kinect, in parts of the sensor's size; give --camera azure, or "
        "the intrinsics of the depth mode from its SDK"
    ),
    '"camera_angle_x"': "a field of view; give --fov with camera_angle_x in degrees",
}
# Ranks of cameras by their kind; UNNAMED, if no name tells it.
DEPTH, INFRARED, UNNAMED, COLOUR = range(4)
KINDS = {DEPTH: "depth", INFRARED: "infra|(?<![a-z])ir(?![a-z])", COLOUR: "colou?r|rgb"}
MAX_NUMBER = 1e300
# A depth scale below the first is in metres, one from the second on in values per metre.
IN_METRES, PER_METRE = 0.01, 100.0
UNIT_WORDS = {1.0: "mm millimeters millimetres", 10.0: "cm", 1000.0: "m meters metres"}
UNITS_MM = {word: mm for mm, words in UNIT_WORDS.items() for word in words.split()}
AMBIGUOUS = ("scale", "factor")  # names of a depth scale only with numbers of these two kinds


def key_of(name: str, value: Any = None) -> str:
    """The key of a camera.json or of ``KEY_NAMES`` that a name means; the name if it is unknown.

    An object of a width and a height alone is a size under any name. The plain scale of a NeRF is
    that of its scene.
    """
    if isinstance(value, dict) and {key_of(one) for one in value} == {*SIZE}:
        return "size"
    letters = re.sub(r"[\W_]", "", name.rpartition(".")[2]).lower()
    if letters in AMBIGUOUS and is_number(value) and IN_METRES <= value < PER_METRE:
        return name
    return ALIASES.get(letters, name)


def is_known(name: str) -> bool:
    """True for a name that is read in an object with a camera."""
    return key_of(name) in ALIASES.values()


def unknown_key(key: str, known: Collection[str] = KNOWN) -> str:
    """What is wrong with an unknown key."""
    return f"unknown key {key!r}{did_you_mean(key, known)}; known: {', '.join(known)}"


def has_camera(values: Mapping[str, Any]) -> bool:
    """True for a focal length, or for numbers in the place of a matrix."""
    for name, value in values.items():
        key = key_of(name)
        if key == "fx" or (key in ("matrix", "focal") and numbers_in(value)):
            return True
        if key == "focal" and isinstance(value, dict) and {*AXES} <= value.keys():
            return True
    return False


def rank_of(*names: str) -> int:
    """The rank of a camera among others, by the last name that tells its kind."""
    for name in reversed(names):
        for rank, kind in KINDS.items():
            if re.search(kind, name, re.I):
                return rank
    return UNNAMED


def is_number(value: object) -> TypeGuard[float]:
    """True for a number of JSON that is neither infinite nor close to it."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    return abs(value) < MAX_NUMBER


def numbers_in(value: Any) -> list[float] | None:
    """The numbers in lists, or in the data of an object with rows and columns; None for
    anything else.
    """
    if isinstance(value, dict):
        value = value.get("data")
    if not isinstance(value, list):
        return None
    found: list[float] = []
    for one in value:
        inner = [float(one)] if is_number(one) else numbers_in(one)
        if inner is None:
            return None
        found += inner
    return found
