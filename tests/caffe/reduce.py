"""Make the recordings in this folder from the whole ones: python tests/caffe/reduce.py FOLDER

The whole recordings are 33 MB. A clone carries what its tests need, in less than 3 MB; README.md lists the parts left
out. Nothing is computed here: every number was recorded from Caffe. The same input gives the same bytes.
"""

from __future__ import annotations

import json
import re
import shutil
import sys
from pathlib import Path
from typing import Any

import h5py
import numpy as np

HERE = Path(__file__).resolve().parent
LIMIT = 3_000_000  # bytes, all recordings together

# The largest layer cases are only partly kept. Results that depend only on kept inputs can still be compared: pooling
# acts on one channel at a time; a row of a 5x5 convolution's input gradient needs the five rows of the top diff above.
KEPT = {
    "conv_deepmodel_L1/top/y": "[:, :, ::9, ::5]",
    "conv_deepmodel_L1/topdiff/y": "[:, :, 112:]",
    "conv_deepmodel_L1/indiff/x": "[:, :, 116:]",
    "conv_deepmodel_L1/pdiff/c/0": None,  # a sum over the whole top diff
    "conv_deepmodel_L1/pdiff/c/1": None,
    "chain_deepmodel_small/top/c1": "[:, :, ::9, ::5]",
    "chain_deepmodel_small/indiff/x": "[:, :, ::3, ::5]",
    **{f"pool_{kind}_k4s4_124/{part}": "[:, :1]" for kind in ("MAX", "AVE")
       for part in ("in/x", "top/y", "topdiff/y", "indiff/x")},
}

LARGE, ITERATIONS = "ip1/0", (1, 10, 20)  # 94% of the weights of the solvers' net: kept after these updates only


def main(source: Path, out: Path = HERE) -> int:
    """Write all recordings and return their size in bytes."""
    made = [
        *layers(source, out),
        *copies(source, out, "hand_model.npz", "phys_limit.npz", "logs/*.log", "solvers/solver_*.prototxt"),
        *copies(source, out, "solvers/snap/*", "solvers/init.*", "solvers/net.prototxt", "solvers/net_mults.prototxt"),
        *copies(source, out, "hdf5data/*.h5", "hdf5data/*.txt", "hdf5data/*.prototxt", "hdf5data/index.json"),
        *copies(source, out, "solvers/net_shared.prototxt", "solvers/init_shared.caffemodel*"),
        *copies(source, out, "solvers/train_list.txt", "solvers/train[01].h5"),
        *copies(source, out, "solvers/test_list.txt", "solvers/test0.h5"),
        *data_order(source, out),
        *trajectories(source, out),
    ]
    size = sum(path.stat().st_size for path in set(made))
    assert size <= LIMIT, f"{size} bytes, expected at most {LIMIT}"
    return size


def copies(source: Path, out: Path, *patterns: str) -> list[Path]:
    """Copy files unchanged."""
    made = []
    for path in sorted(path for pattern in patterns for path in source.glob(pattern)):
        made.append(out / path.relative_to(source))
        made[-1].parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, made[-1])
    return made


def layers(source: Path, out: Path) -> list[Path]:
    """Write layers.json, a line for each case, and layers.h5, the numbers of all cases, one after the other."""
    recorded = dict(np.load(source / "layers.npz"))
    lines, single, double = [], [], []
    for entry in json.loads((source / "layers_index.json").read_text()):
        name = entry["case"]
        case: dict[str, Any] = {key: entry[key] for key in ("case", "phase", "backward", "note") if entry[key] != ""}
        case["prototxt"] = (source / f"layers/{name}.prototxt").read_text()
        case["types"] = re.findall(r'layer { name: "\w+" type: "(\w+)"', case["prototxt"])
        assert len(case["types"]) == case["prototxt"].count("layer {")
        case["arrays"], case["kept"], case["twins"] = {}, {}, []
        for key in [key for key in recorded if key.startswith(f"{name}/") and not key.endswith("_f64")]:
            part, kept = key.removeprefix(f"{name}/"), KEPT.get(key, "[...]")
            if kept is None:
                continue
            case["arrays"][part] = recorded[key].shape
            if kept != "[...]":
                case["kept"][part] = kept
            cut = slices(kept)
            single.append(recorded[key][cut].ravel())
            assert single[-1].dtype == np.float32
            if f"{key}_f64" in recorded:
                case["twins"].append(part)
                double.append(bits(recorded[f"{key}_f64"][cut].ravel()) - bits(single[-1].astype(np.float64)))
        lines.append(json.dumps(case))
    (out / "layers.json").write_text("[\n" + ",\n".join(lines) + "\n]\n")
    with h5py.File(out / "layers.h5", "w") as file:
        pack(file, "float32", np.concatenate(single))
        pack(file, "float64_bits_minus_float32", np.concatenate(double))
    return [out / "layers.json", out / "layers.h5"]


def pack(file: h5py.File, name: str, array: np.ndarray) -> h5py.Dataset:
    """Write an array compactly: the first bytes of all numbers, the second bytes, and so on, compressed."""
    return file.create_dataset(
        name, data=array, chunks=array.shape, shuffle=True, compression="gzip", compression_opts=9
    )


def bits(array: np.ndarray) -> np.ndarray:
    """Return the bits of float64 numbers as integers. Those of close numbers are close, so differences are small."""
    return array.view(np.int64)


def slices(text: str) -> Any:
    """Convert a text such as ``[:, ::2]`` to an index."""
    if text == "[...]":
        return ...
    return tuple(
        slice(*(int(n) if n.strip() else None for n in axis.split(":"))) for axis in text.strip("[]").split(",")
    )


def data_order(source: Path, out: Path) -> list[Path]:
    """Write hdf5data.npz: the batches of a case and blob in one array, (iterations, batch, ...)."""
    recorded = np.load(source / "hdf5data/hdf5data.npz")
    stacked = {}
    for entry in json.loads((source / "hdf5data/index.json").read_text()):
        for name in (f"{entry['case']}/{blob}" for blob in ("label", "data", "vec")):
            stacked[name] = np.stack([recorded[f"{name}/{i}"] for i in range(entry["iters"])])
    np.savez_compressed(out / "hdf5data/hdf5data.npz", **stacked)
    return [out / "hdf5data/hdf5data.npz"]


def trajectories(source: Path, out: Path) -> list[Path]:
    """Write trajectories.h5: all solver cases together, (cases, iterations, ...); iteration 0 is init.caffemodel."""
    cases = sorted(json.loads((source / "solvers/index.json").read_text()))
    recorded = [np.load(source / f"solvers/traj_{case}.npz") for case in cases]
    path = out / "solvers/trajectories.h5"
    with h5py.File(path, "w") as file, h5py.File(source / "solvers/init.caffemodel.h5") as init:
        file["cases"] = cases
        for name in ("loss_last_subbatch", "loss_printed", "lr_printed"):
            pack(file, name, np.stack([one[name] for one in recorded]))
        for key in sorted(key for key in recorded[0] if key.startswith("w/")):
            name = key.removeprefix("w/")
            kept = ITERATIONS if name == LARGE else range(1, 21)
            assert all(np.array_equal(one[key][0], init[f"data/{name}"]) for one in recorded)
            weights = pack(file, key, np.stack([one[key][list(kept)] for one in recorded]))
            weights.attrs["iterations"] = list(kept)
    for one in recorded:  # the resumed training equals the uninterrupted one from iteration 10 on
        assert all(np.array_equal(one[key], one[key[7:]][-len(one[key]) :]) for key in one if key[:9] == "resume/w/")
    return [path]


if __name__ == "__main__":
    print(main(Path(sys.argv[1])), "bytes")
