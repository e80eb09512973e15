"""netlib/files/hdf5.py: files that refer to other files, sealed and damaged files; rows
by plain reads.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from netlib import files
from netlib.errors import DataError, WeightsError
from netlib.files import hdf5
from tests.support.hdf5_files import write_hdf5


def test_errors_of_the_file_and_of_the_block_have_the_callers_class(tmp_path: Path) -> None:
    path = write_hdf5(tmp_path / "a.h5", x=np.zeros(3))
    with hdf5.opened(path, "weights", WeightsError) as file:
        assert list(file) == ["x"]
    wrong = r"a\.h5: cannot read weights: damaged, or not as expected: .*'y'"
    with (
        pytest.raises(WeightsError, match=wrong),
        hdf5.opened(path, "weights", WeightsError) as file,
    ):
        file["y"]
    (tmp_path / "text.h5").write_text("no HDF5")
    wrong = r"text\.h5: cannot read the data: damaged or truncated: .*signature not found"
    with pytest.raises(DataError, match=wrong), hdf5.opened(tmp_path / "text.h5", "the data"):
        pass


def external_link(file: h5py.File) -> None:
    """Following the link would open any file or pipe that it names."""
    file["deep/x"] = h5py.ExternalLink("other.h5", "x")


def external_storage(file: h5py.File) -> None:
    """The values are the bytes of another file."""
    file.create_dataset("x", (4,), "u1", external=[("/etc/hostname", 0, 4)])


def virtual(file: h5py.File) -> None:
    """A virtual data set that refers to itself: reading it overflows the library's stack."""
    layout = h5py.VirtualLayout((4,), "f4")
    layout[:] = h5py.VirtualSource(file.filename, "x", (4,))
    file.create_virtual_dataset("x", layout)


def never_written(file: h5py.File) -> None:
    """HDF5 would fill in the values."""
    file.create_dataset("x", (10**12,), "f4", chunks=(1024,))


@pytest.mark.parametrize(
    ("make", "fault"),
    [
        (
            external_link,
            "'/deep/x' is a link into another file, 'other.h5', which is not followed; expected all in one",
        ),
        (
            external_storage,
            "data set '/x' is kept in another file, '/etc/hostname', which is not read; expected all",
        ),
        (virtual, "data set '/x' is virtual"),
        (
            never_written,
            "data set '/x' claims 4000000000000 bytes, but only 0 are stored; expected data",
        ),
    ],
    ids=lambda value: getattr(value, "__name__", ""),
)
def test_external_virtual_and_missing_data_are_rejected(
    tmp_path: Path, make: Any, fault: str
) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        make(file)
    with pytest.raises(DataError) as error, hdf5.opened(tmp_path / "a.h5", "the data"):
        pass
    assert str(error.value).startswith(f"{tmp_path}/a.h5: cannot read the data: {fault}")


def test_links_within_a_file(tmp_path: Path) -> None:
    """Links are followed; a broken or circular link matters only if it is read."""
    with h5py.File(write_hdf5(tmp_path / "a.h5", x=np.arange(3)), "r+") as file:
        file["y"], file["nowhere"] = h5py.SoftLink("/x"), h5py.SoftLink("/none")
        file["group/up"] = file["/"]
    assert hdf5.File(tmp_path / "a.h5", ("x", "y")).datasets[1][:].tolist() == [0, 1, 2]
    with pytest.raises(DataError, match="no data set 'nowhere'; it has x, y"):
        hdf5.File(tmp_path / "a.h5", ("nowhere",))


def test_content_that_was_read_before(tmp_path: Path) -> None:
    path = write_hdf5(tmp_path / "x.h5", a=np.arange(3))
    content = files.Content(path, path.read_bytes())
    for _ in range(2):
        with hdf5.opened(content, "data") as file:
            np.testing.assert_array_equal(file["a"][...], [0, 1, 2])


@pytest.fixture
def sealed(tmp_path: Path) -> Path:
    path = write_hdf5(tmp_path / "plain.h5", a=np.arange(50.0), b=np.zeros((3, 4)))
    (tmp_path / "sealed.h5").write_bytes(hdf5.sealed(path.read_bytes()))
    return tmp_path / "sealed.h5"


def test_a_seal_is_no_part_of_the_content(sealed: Path) -> None:
    """h5py reads a sealed file, and a program that changes it removes the seal."""
    with h5py.File(sealed) as file:
        assert file["a"][...].tolist() == list(range(50))
    with h5py.File(sealed, "r+") as file:
        file["c"] = np.ones(5)
    assert b"netlib:crc32" not in sealed.read_bytes()
    with hdf5.opened(sealed, "data") as file:
        assert file["c"][...].tolist() == [1] * 5


@pytest.mark.parametrize("as_content", [False, True])
def test_damage_of_a_sealed_file_is_found_without_hdf5(sealed: Path, as_content: bool) -> None:
    good = sealed.read_bytes()
    rng = np.random.default_rng(3)
    for bit in rng.choice(8 * (len(good) - hdf5.SEAL_BYTES), 200, replace=False):
        damaged = bytearray(good)
        damaged[bit // 8] ^= 1 << bit % 8
        sealed.write_bytes(damaged)
        source = files.Content(sealed, sealed.read_bytes()) if as_content else sealed
        with (
            pytest.raises(DataError, match="damaged: checksum mismatch"),
            hdf5.opened(source, "data"),
        ):
            pass


@pytest.mark.parametrize("shape", [(), (3,), (40, 40)], ids=["numbers", "small rows", "large rows"])
@pytest.mark.parametrize("dtype", ["<f4", ">f4", "<f8", "<i2", "u1"])
@pytest.mark.parametrize("options", [{}, {"chunks": True}, {"compression": "gzip"}], ids=str)
def test_rows_are_what_h5py_reads(
    tmp_path: Path, shape: tuple[int, ...], dtype: str, options: dict[str, Any]
) -> None:
    """A single row, a range, a list of rows and all rows equal h5py's; take converts to the
    type of ``out``.
    """
    values = np.random.default_rng(3).integers(0, 100, (20, *shape)).astype(dtype)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", data=values, **options)
    rows = hdf5.File(tmp_path / "a.h5", ("x",)).datasets[0]
    assert (rows.shape, rows.dtype) == (values.shape, values.dtype)
    for key in (
        0,
        19,
        -1,
        slice(None),
        slice(3, 9),
        slice(15, 2, -3),
        [5, 6, 7, 1, 0, 19, 19],
        np.array([4]),
    ):
        assert np.array_equal(rows[key], values[key]), key
    assert np.array_equal(np.asarray(rows), values)
    out = np.empty((4, *shape), np.float32)
    rows.take(np.array([7, 8, 2, 3]), out)
    assert np.array_equal(out, values[[7, 8, 2, 3]])
