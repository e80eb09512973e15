"""HDF5Data: the order of rows, resuming, and invalid files."""

import itertools
import os

import h5py
import numpy as np
import pytest

import netlib
from netlib.proto import prototxt

pytestmark = pytest.mark.both_engines


@pytest.fixture
def data(tmp_path, net_of):
    """``data([3, 4], batch, shuffle)``: a net that reads files of 3 and 4 rows, numbered consecutively."""

    def make(counts, batch, shuffle=False, chunks=None, dtype=np.float32, **options):
        number = 0
        for i, count in enumerate(counts):
            (tmp_path / f"{i}.h5").unlink(missing_ok=True)  # keeps the files of an earlier net
            with h5py.File(tmp_path / f"{i}.h5", "w") as file:
                rows = np.arange(number, number + count)
                file.create_dataset("x", data=np.repeat(rows[:, None], 2, 1).astype(dtype), chunks=chunks)
                file.create_dataset("t", data=rows.astype(np.float64))
            number += count
        (tmp_path / "list.txt").write_text("".join(f"{tmp_path}/{i}.h5\n" for i in range(len(counts))))
        return net_of(layer(tmp_path / "list.txt", batch, shuffle), **options)

    return make


def layer(source, batch, shuffle=False):
    """Return a layer with two tops."""
    return (
        f'layer {{ name: "d" type: "HDF5Data" top: "x" top: "t" '
        f'hdf5_data_param {{ source: "{source}" batch_size: {batch} shuffle: {str(shuffle).lower()} }} }}'
    )


def numbers(net, batches):
    """Return the row numbers of this number of batches, after checking that all tops agree."""
    found = []
    for _ in range(batches):
        net.forward()
        assert np.array_equal(net.blobs["x"].data[:, 0], net.blobs["t"].data)
        assert np.array_equal(net.blobs["x"].data[:, 1], net.blobs["t"].data)
        found += [int(v) for v in net.blobs["t"].data]
    return found


@pytest.mark.parametrize("counts", [[7], [3, 4], [1, 1, 5], [7] * 2])
@pytest.mark.parametrize("batch", [1, 2, 5, 7, 20])
def test_rows_come_in_order_over_file_ends_and_start_again(data, counts, batch):
    """Rows are in order across files and repeat, for any batch size, also larger than the data."""
    total = sum(counts)
    batches = 3 * total // batch + 1
    assert numbers(data(counts, batch), batches) == [i % total for i in range(batches * batch)]


@pytest.mark.parametrize("batch", [1, 4, 30])
def test_shuffled_rows_are_a_new_permutation_every_pass(data, batch):
    """The files, and the rows within each file, are shuffled anew in every pass."""
    found = numbers(data([5, 6, 4], batch, shuffle=True), 60 // batch)
    passes = [found[i : i + 15] for i in range(0, 60, 15)]
    owner = np.repeat([0, 1, 2], [5, 6, 4])
    for rows in passes:
        assert sorted(rows) == list(range(15))
        assert sum(owner[a] != owner[b] for a, b in itertools.pairwise(rows)) == 2, "one file after the other"
    assert len({tuple(rows) for rows in passes}) == 4


def test_files_of_one_size_are_shuffled_differently(data):
    """Files of equal size are shuffled by different permutations."""
    found = numbers(data([8, 8, 8], 24, shuffle=True), 1)
    orders = {tuple(n % 8 for n in found[i : i + 8]) for i in (0, 8, 16)}
    assert len(orders) == 3


def test_the_order_depends_on_the_seed_only(data):
    """The order does not depend on the batch size or on reading ahead."""
    one, two = data([5, 6], 2, shuffle=True, seed=4), data([5, 6], 11, shuffle=True, seed=4)
    assert numbers(one, 11) == numbers(two, 2)
    assert numbers(data([5, 6], 11, shuffle=True, seed=5), 2) != numbers(data([5, 6], 11, shuffle=True, seed=4), 2)


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("done", [0, 1, 3, 10])
def test_state_and_restore_go_on_with_the_next_row(data, shuffle, done):
    """Restoring continues with the next row, in another net and in the same one."""
    net = data([5, 6], 4, shuffle)
    numbers(net, done)
    states = net.layer_states()
    want = numbers(net, 5)
    other = data([5, 6], 4, shuffle, seed=99)
    for again in (other, net):
        again.restore_layer_states(states)
        assert numbers(again, 5) == want


def test_other_data_start_from_their_first_row(data):
    """If the data have changed, reading starts at the first row."""
    net = data([5, 6], 4)
    numbers(net, 2)
    other = data([5, 4], 4)
    other.restore_layer_states(net.layer_states())
    assert numbers(other, 1) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("options", "kind"),
    [
        ({}, "in one piece"),
        ({"chunks": (2, 2)}, "in chunks"),
        ({"dtype": np.float64}, "float64"),
        ({"dtype": np.uint8}, "bytes"),
        ({"dtype": ">i2"}, "big-endian"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.parametrize("shuffle", [False, True])
def test_any_storage_is_read(data, options, kind, shuffle):
    """Any layout and type of data is read and converted to the net's type."""
    net = data([5, 6], 4, shuffle, **options)
    assert sorted(numbers(net, 11)) == sorted([*range(11)] * 4)
    assert net.blobs["x"].data.dtype == np.float32


def test_rows_that_were_never_written(tmp_path, net_of):
    """Rows that were never stored are rejected; HDF5 would fill in more than the memory can hold."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file.create_dataset("x", (10**12, 1), "f4", chunks=(1024, 1))
    (tmp_path / "list").write_text("a.h5")
    with pytest.raises(netlib.DataError, match="data set '/x' claims 4000000000000 bytes, but only 0 are stored"):
        net_of(f'layer {{ type: "HDF5Data" top: "x" hdf5_data_param {{ source: "{tmp_path}/list" batch_size: 1 }} }}')


def test_compressed_data(tmp_path, net_of):
    """Compressed data sets are read."""
    with h5py.File(tmp_path / "c.h5", "w") as file:
        for name in ("x", "t"):
            file.create_dataset(name, data=np.arange(6.0), compression="gzip")
    (tmp_path / "list.txt").write_text("c.h5\n\n")
    assert net_of(layer(tmp_path / "list.txt", 4)).forward()["x"].tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("chunks", [None, (2, 2)], ids=["in one piece", "in chunks"])
def test_the_rest_of_a_file_in_another(data, tmp_path, net_of, monkeypatch, chunks):
    """The attribute rest_in names a file with further data sets, relative to the folder of the first file."""
    want = numbers(data([5], 5, chunks=chunks), 1)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "companions").mkdir()
    with h5py.File(tmp_path / "companions" / "a.h5", "w") as file:
        file["t"] = np.arange(5.0)
        file.attrs["rest_in"] = "../0.h5"
    (tmp_path / "companions" / "list.txt").write_text("companions/a.h5\n")
    net = net_of(layer("companions/list.txt", 5))
    assert numbers(net, 1) == want
    read_ahead(net)
    cut(tmp_path / "0.h5")
    with pytest.raises(netlib.DataError, match=r"^0\.h5: was cut to"):
        for _ in range(2):
            net.forward()


def test_a_row_by_its_number(data):
    """Rows are numbered across all files, for tools that show examples."""
    made = data([3, 4], 2).layer_dict["d"]
    assert [float(made.row(i)[1]) for i in (0, 2, 3, 6)] == [0, 2, 3, 6]
    with pytest.raises(IndexError, match="there are 7 rows"):
        made.row(7)


def test_an_array_taken_from_a_top_is_good_until_the_next_forward(data):
    """Reading ahead does not change an array that forward returned."""
    net = data([50], 10)
    for _ in range(20):
        x = net.forward()["t"]
        before = x.copy()
        net.layer_dict["d"].state()  # gives the reading thread time
        assert np.array_equal(x, before)


def test_it_says_what_the_data_are_made_from(data, tmp_path):
    """The notes state the attribute ``made_from`` of the files."""
    made = data([3], 2).layer_dict["d"]
    assert made.notes == [f"3 rows in 1 files of {tmp_path}/list.txt, made from an unknown source"]


def test_a_batch_of_more_rows_than_there_are_is_a_warning(data, caplog):
    """A batch that is larger than the file repeats rows, with a warning."""
    data([3], 4)
    assert "layer 'd': batch_size 4 is more than the 3 rows of " in caplog.text


@pytest.mark.parametrize("options", ["", "scale: 0.5", "mirror: true", 'mean_file: "absent"', "crop_size: 1"])
def test_transform_param_is_rejected(tmp_path, options):
    """HDF5Data does not transform data; transform_param is an error, as in Caffe, even if it is empty."""
    source = f'hdf5_data_param {{ source: "{tmp_path}/list.txt" batch_size: 2 }} transform_param {{ {options} }}'
    text = f'layer {{ name: "d" type: "HDF5Data" top: "x" {source} }}'
    with pytest.raises(netlib.LayerError, match="layer 'd': HDF5Data does not transform data, as in Caffe"):
        netlib.Net(prototxt.parse(text), netlib.TRAIN)


# ---------------------------------------------------------------------------------------------- mistakes


def write(path, **datasets):
    """Write an HDF5 file."""
    with h5py.File(path, "w") as file:
        for name, value in datasets.items():
            file[name] = value


@pytest.mark.parametrize(
    ("datasets", "message"),
    [
        ({"x": np.zeros(3)}, r"a.h5: no data set 't'; it has x"),
        ({}, r"a.h5: no data set 'x'; it has none"),
        ({"x": np.zeros(3), "t": np.zeros(4)}, r"a.h5: data sets of different length: x 3, t 4"),
        ({"x": np.zeros((0, 2)), "t": np.zeros(0)}, r"a.h5: data set 'x' has no rows"),
        ({"x": np.zeros(3), "t": ["a", "b", "c"]}, r"a.h5: data set '/t' holds object, expected numbers"),
        ({"x": np.zeros(3), "t": np.zeros(())}, r"a.h5: data sets of different length: x 3, t 0"),
    ],
    ids=lambda value: "" if isinstance(value, str) else str(list(value)),
)
def test_files_with_something_wrong_in_them(tmp_path, net_of, datasets, message):
    """The error names the file, the fault and the expected content."""
    write(tmp_path / "a.h5", **datasets)
    (tmp_path / "list.txt").write_text("a.h5")
    with pytest.raises(netlib.DataError, match=message) as error:
        net_of(layer(tmp_path / "list.txt", 2))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ("missing", r"other\.h5: cannot read the rest of .*a\.h5: No such file or directory"),
        ("lacks it", r"a\.h5: no data set 'x'; it has t, y"),
        (
            "is not HDF5",
            r"other\.h5: cannot read the rest of .*a\.h5: damaged or truncated: .*signature not found",
        ),
    ],
)
def test_a_rest_that_is_not_there(tmp_path, net_of, other, message):
    """If the file in rest_in is missing, invalid or lacks the data set, an error names the file."""
    if other == "lacks it":
        write(tmp_path / "other.h5", y=np.zeros(3))
    if other == "is not HDF5":
        (tmp_path / "other.h5").write_text("text")
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = np.zeros(3)
        file.attrs["rest_in"] = "other.h5"
    (tmp_path / "list.txt").write_text("a.h5")
    with pytest.raises(netlib.DataError, match=message):
        net_of(layer(tmp_path / "list.txt", 2))


@pytest.mark.parametrize(
    ("rest", "link"),
    [
        ("/etc/hostname", ""),
        ("../../private.h5", ""),
        ("../near/below/private.h5", ""),
        ("../../set/a/../../private.h5", ""),
        ("link.h5", "../../private.h5"),
        ("link/private.h5", "../.."),
    ],
)
def test_a_rest_elsewhere(tmp_path, net_of, rest, link):
    """rest_in may not refer to a file outside the folder of the data file and its neighbouring folders."""
    for folder in ("set/a", "set/near/below"):
        (tmp_path / folder).mkdir(parents=True)
    for place in ("private.h5", "set/near/below/private.h5"):
        write(tmp_path / place, x=np.zeros((3, 2)))
    if link:
        (tmp_path / "set" / "a" / rest.split("/")[0]).symlink_to(link)
    write(tmp_path / "set" / "a" / "a.h5", t=np.zeros(3))
    with h5py.File(tmp_path / "set" / "a" / "a.h5", "r+") as file:
        file.attrs["rest_in"] = rest
    (tmp_path / "list.txt").write_text("set/a/a.h5")
    with pytest.raises(netlib.DataError, match=f"rest_in is '{rest}'; expected a relative name of a file in the same"):
        net_of(layer(tmp_path / "list.txt", 2))


@pytest.mark.parametrize("rest", ["rest.h5", "below/rest.h5", "../rest.h5", "../near/rest.h5", "link.h5"])
def test_a_rest_nearby(tmp_path, net_of, rest):
    """rest_in may name a file in the same folder, below it or in a neighbouring folder, also by a link."""
    for folder in ("set/a/below", "set/near"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "set" / "a" / "link.h5").symlink_to("../near/rest.h5")
    write(tmp_path / "set" / "a" / rest, x=np.zeros((3, 2)))
    write(tmp_path / "set" / "a" / "a.h5", t=np.zeros(3))
    with h5py.File(tmp_path / "set" / "a" / "a.h5", "r+") as file:
        file.attrs["rest_in"] = rest
    (tmp_path / "list.txt").write_text("set/a/a.h5")
    assert net_of(layer(tmp_path / "list.txt", 2)).forward()["x"].shape == (2, 2)


def test_files_whose_rows_differ(tmp_path, net_of):
    """The error names both files and their shapes."""
    write(tmp_path / "a.h5", x=np.zeros((3, 2)), t=np.zeros(3))
    write(tmp_path / "b.h5", x=np.zeros((3, 4)), t=np.zeros(3))
    (tmp_path / "list.txt").write_text("a.h5\nb.h5")
    with pytest.raises(netlib.DataError, match=r"b.h5: rows of 'x' have shape \(4,\), those in .*a.h5 \(2,\)"):
        net_of(layer(tmp_path / "list.txt", 2))


@pytest.mark.parametrize(
    ("listed", "message"),
    [
        (None, "list.txt: cannot read the list of HDF5 files: No such file or directory"),
        ("", "list.txt: the list of HDF5 files is empty"),
        ("gone.h5", "list.txt: names 'gone.h5', which does not exist"),
        ("list.txt", "list.txt: cannot read the HDF5 file: "),
    ],
)
def test_lists_with_something_wrong_in_them(tmp_path, net_of, listed, message):
    """A missing or empty list, a missing file and a file that is not HDF5 raise an error."""
    if listed is not None:
        (tmp_path / "list.txt").write_text(listed)
    with pytest.raises(netlib.DataError, match=message) as error:
        net_of(layer(tmp_path / "list.txt", 2))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("keep", [0.3, 0.6, 0.95])
def test_a_truncated_file(tmp_path, net_of, keep):
    """A truncated file is rejected when the net is built."""
    write(tmp_path / "a.h5", x=np.zeros((100, 5)), t=np.zeros(100))
    content = (tmp_path / "a.h5").read_bytes()
    (tmp_path / "a.h5").write_bytes(content[: int(keep * len(content))])
    (tmp_path / "list.txt").write_text("a.h5")
    with pytest.raises(netlib.DataError, match=r"a.h5: cannot read the HDF5 file") as error:
        net_of(layer(tmp_path / "list.txt", 2))
    assert "\n" not in str(error.value)


def cut(path):
    """Truncate a file to half of its size."""
    os.truncate(path, path.stat().st_size // 2)


def read_ahead(net):
    """Wait for the batch that the fast engine reads ahead; return whether there is one."""
    ahead = getattr(net.layer_dict["d"], "_ahead", None)
    return ahead is not None and ahead.result() is not None


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("done", [0, 2], ids=["before the first batch", "while it is read ahead"])
def test_a_file_that_is_cut_under_a_running_net(data, tmp_path, shuffle, done):
    """A truncated file raises a one-line error, also from the reading thread; on whole files a new net continues."""
    other, net = data([6, 5], 2, shuffle), data([6, 5], 2, shuffle)
    found = numbers(net, done)
    ahead = read_ahead(net)  # no row is read while the files are truncated
    for path in (tmp_path / "0.h5", tmp_path / "1.h5"):
        cut(path)
    if ahead:
        found += numbers(net, 1)
    for _ in range(2):
        with pytest.raises(netlib.DataError, match=r"[01]\.h5: was cut to \d+ of \d+ bytes while in use; restore the"):
            net.forward()
    again = data([6, 5], 2, shuffle, seed=9)
    again.restore_layer_states(net.layer_states())
    found += numbers(again, 11)
    other = data([6, 5], 2, shuffle)
    assert found == numbers(other, len(found) // 2)


@pytest.mark.parametrize("row", [(2,), (2000,)], ids=["held in memory", "read"])
def test_data_that_are_overwritten_in_place(tmp_path, net_of, row):
    """A file that is overwritten during training, with the same size, raises an error."""
    write(tmp_path / "a.h5", x=np.ones((6, *row), np.float32))
    (tmp_path / "list.txt").write_text("a.h5")
    net = net_of(layer(tmp_path / "list.txt", 2).replace('top: "t"', ""))
    net.forward()
    read_ahead(net)
    size = (tmp_path / "a.h5").stat().st_size
    with (tmp_path / "a.h5").open("r+b") as file:
        file.seek(size // 2)
        file.write(bytes(100))
    os.utime(tmp_path / "a.h5", ns=(0, 1))  # also for file systems with a coarse clock
    with pytest.raises(netlib.DataError, match=r"a\.h5: was changed while in use; restore the file and run again"):
        for _ in range(2):
            net.forward()


def test_a_batch_that_nobody_wants(data, tmp_path):
    """A failure to read ahead is not an error if reading continues elsewhere; reading that row is."""
    net = data([4, 4, 4], 4)
    numbers(net, 1)
    read_ahead(net)
    cut(tmp_path / "2.h5")
    assert numbers(net, 1) == [4, 5, 6, 7]
    net.layer_dict["d"].rewind()
    assert numbers(net, 2) == [0, 1, 2, 3, 4, 5, 6, 7]
    with pytest.raises(netlib.DataError, match=r"2\.h5: was cut to"):
        net.layer_dict["d"].row(9)


def test_a_file_that_takes_the_place_of_another(data, tmp_path):
    """The net continues to read the file that it opened."""
    net = data([5], 5)
    write(tmp_path / "short.h5", x=np.zeros((1, 2)))
    (tmp_path / "short.h5").replace(tmp_path / "0.h5")
    assert numbers(net, 2) == [0, 1, 2, 3, 4] * 2


def test_batch_size_0(data):
    """A batch size of 0 raises an error."""
    with pytest.raises(netlib.LayerError, match="layer 'd': batch_size must be at least 1"):
        data([3], 0)
