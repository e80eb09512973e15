"""HDF5Data: the order of rows, resuming, and invalid files."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest

import netlib
from tests.support.bad_input import bad_inputs
from tests.support.hdf5_files import write_hdf5


@pytest.fixture
def data(here, net_of):
    """``data([3, 4], batch, shuffle)``: a net that reads files of 3 and 4 rows, numbered
    consecutively.
    """

    def make(counts, batch, shuffle=False, chunks=None, dtype=np.float32, **options):
        number = 0
        for i, count in enumerate(counts):
            Path(f"{i}.h5").unlink(missing_ok=True)  # keeps the files of an earlier net
            with h5py.File(f"{i}.h5", "w") as file:
                rows = np.arange(number, number + count)
                file.create_dataset(
                    "x", data=np.repeat(rows[:, None], 2, 1).astype(dtype), chunks=chunks
                )
                file.create_dataset("t", data=rows.astype(np.float64))
            number += count
        Path("list.txt").write_text("".join(f"{i}.h5\n" for i in range(len(counts))))
        return net_of(layer("list.txt", batch, shuffle), **options)

    return make


def layer(source, batch, shuffle=False):
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
    total = sum(counts)
    batches = 3 * total // batch + 1
    assert numbers(data(counts, batch), batches) == [i % total for i in range(batches * batch)]


def test_the_order_depends_on_the_seed_only(data):
    one, two = data([5, 6], 2, shuffle=True, seed=4), data([5, 6], 11, shuffle=True, seed=4)
    assert numbers(one, 11) == numbers(two, 2)
    one, other = (data([5, 6], 11, shuffle=True, seed=seed) for seed in (5, 4))
    assert numbers(one, 2) != numbers(other, 2)


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("done", [0, 1, 3, 10])
def test_state_and_restore_go_on_with_the_next_row(data, shuffle, done):
    net = data([5, 6], 4, shuffle)
    numbers(net, done)
    states = net.layer_states()
    want = numbers(net, 5)
    other = data([5, 6], 4, shuffle, seed=99)
    for again in (other, net):
        again.restore_layer_states(states)
        assert numbers(again, 5) == want


def test_other_data_start_from_their_first_row(data):
    net = data([5, 6], 4)
    numbers(net, 2)
    other = data([5, 4], 4)
    other.restore_layer_states(net.layer_states())
    assert numbers(other, 1) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    "options", [{}, {"chunks": (2, 2)}, {"dtype": np.uint8}, {"dtype": ">i2"}], ids=str
)
@pytest.mark.parametrize("shuffle", [False, True])
def test_any_storage_is_read(data, options, shuffle):
    net = data([5, 6], 4, shuffle, **options)
    assert sorted(numbers(net, 11)) == sorted([*range(11)] * 4)
    assert net.blobs["x"].data.dtype == np.float32


@pytest.mark.parametrize("chunks", [None, (2, 2)], ids=["in one piece", "in chunks"])
def test_the_rest_of_a_file_in_another(data, here, net_of, monkeypatch, chunks):
    """The attribute rest_in names a file with further data sets, relative to the folder of
    the first file.
    """
    want = numbers(data([5], 5, chunks=chunks), 1)
    Path("companions").mkdir()
    with h5py.File(Path("companions/a.h5"), "w") as file:
        file["t"] = np.arange(5.0)
        file.attrs["rest_in"] = "../0.h5"
    Path("companions/list.txt").write_text("companions/a.h5\n")
    net = net_of(layer("companions/list.txt", 5))
    assert numbers(net, 1) == want
    cut(Path("0.h5"))
    with pytest.raises(netlib.DataError, match=r"^0\.h5: was cut to"):
        net.forward()


def test_a_list_beside_the_prototxt_names_files_beside_itself(here, monkeypatch):
    (here / "elsewhere").mkdir()
    write_hdf5("rows.h5", x=np.zeros((3, 2)), t=np.arange(3.0))
    Path("list.txt").write_text("rows.h5\n")
    Path("net.prototxt").write_text(layer("list.txt", 3))
    monkeypatch.chdir(here / "elsewhere")
    net = netlib.Net(str(here / "net.prototxt"), netlib.TRAIN)
    net.forward()
    assert net.blobs["t"].data.tolist() == [0, 1, 2]


def test_a_row_by_its_number(data):
    made = data([3, 4], 2).layer_dict["d"]
    assert [float(made.row(i)[1]) for i in (0, 2, 3, 6)] == [0, 2, 3, 6]
    with pytest.raises(IndexError, match="there are 7 rows"):
        made.row(7)


def test_an_array_taken_from_a_top_is_good_until_the_next_forward(data):
    net = data([50], 10)
    for _ in range(20):
        x = net.forward()["t"]
        before = x.copy()
        net.layer_dict["d"].state()  # gives the reading thread time
        assert np.array_equal(x, before)


def test_it_says_what_the_data_are_made_from(data, here):
    made = data([3], 2).layer_dict["d"]
    assert made.notes == ["3 rows in 1 files of list.txt, made from an unknown source"]


def test_a_batch_of_more_rows_than_there_are_is_a_warning(data, caplog):
    data([3], 4)
    assert "layer 'd': batch_size 4 is more than the 3 rows of " in caplog.text


@pytest.mark.parametrize(
    "options", ["", "scale: 0.5", "mirror: true", 'mean_file: "absent"', "crop_size: 1"]
)
def test_transform_param_is_rejected(here, net_of, options):
    """HDF5Data does not transform data; transform_param is an error, as in Caffe, even
    if it is empty.
    """
    text = layer("list.txt", 2)[:-1] + f"transform_param {{ {options} }} }}"
    with pytest.raises(
        netlib.LayerError, match="layer 'd': HDF5Data does not transform data, as in Caffe"
    ):
        net_of(text)


def listed(folder, *names, **datasets):
    """Write a.h5 and a list of the files with these names."""
    write_hdf5(folder / "a.h5", **datasets)
    (folder / "list.txt").write_text("\n".join(names))


def unwritten(folder):
    """Write a file of rows that were never stored; HDF5 would fill in more than the
    memory can hold.
    """
    listed(folder, "a.h5", t=np.zeros(10**3))
    with h5py.File(folder / "a.h5", "a") as file:
        file.create_dataset("x", (10**12, 1), "f4", chunks=(1024, 1))


def with_rest(folder, other=None, **datasets):
    """Write a.h5, which says that the rest is in other.h5, and that file."""
    listed(folder, "a.h5", t=np.zeros(3))
    write_hdf5(folder / "other.h5", **datasets)
    with h5py.File(folder / "a.h5", "a") as file:
        file.attrs["rest_in"] = other or "other.h5"
    if other == "text.h5":
        (folder / other).write_text("text")


def cut_to(folder, keep):
    """Truncate a file."""
    listed(folder, "a.h5", x=np.zeros((100, 5)), t=np.zeros(100))
    os.truncate(folder / "a.h5", int(keep * (folder / "a.h5").stat().st_size))


def of_two_shapes(folder):
    write_hdf5(folder / "b.h5", x=np.zeros((3, 4)), t=np.zeros(3))
    listed(folder, "a.h5", "b.h5", x=np.zeros((3, 2)), t=np.zeros(3))


@bad_inputs(
    netlib.DataError,
    {
        "no t": (
            lambda at: listed(at, "a.h5", x=np.zeros(3)),
            "...a.h5: no data set 't'; it has x",
        ),
        "nothing": (lambda at: listed(at, "a.h5"), "...a.h5: no data set 'x'; it has none"),
        "lengths": (
            lambda at: listed(at, "a.h5", x=np.zeros(3), t=np.zeros(4)),
            "...a.h5: data sets of different length: x 3, t 4",
        ),
        "no rows": (
            lambda at: listed(at, "a.h5", x=np.zeros((0, 2)), t=np.zeros(0)),
            "...a.h5: data set 'x' has no rows",
        ),
        "texts": (
            lambda at: listed(at, "a.h5", x=np.zeros(3), t=["a", "b", "c"]),
            "...a.h5: data set '/t' holds object, expected numbers",
        ),
        "a number": (
            lambda at: listed(at, "a.h5", x=np.zeros(3), t=np.zeros(())),
            "...a.h5: data sets of different length: x 3, t 0",
        ),
        "never written": (
            unwritten,
            "...a.h5: cannot read the HDF5 file: data set '/x' claims 4000000000000 bytes, but "
            "only 0 are stored; expected data",
        ),
        "other rows": (
            of_two_shapes,
            "...b.h5: rows of 'x' have shape (4,), those in ...a.h5 (2,)",
        ),
        "no rest": (
            lambda at: with_rest(at, "gone.h5"),
            "...gone.h5: cannot read the rest of ...a.h5: No such file or directory",
        ),
        "a rest without x": (
            lambda at: with_rest(at, y=np.zeros(3)),
            "...a.h5: no data set 'x'; it has t, y",
        ),
        "a text as rest": (
            lambda at: with_rest(at, "text.h5"),
            "...text.h5: cannot read the rest of ...a.h5: damaged or truncated: ...signature not found...",
        ),
        "no list": (
            lambda at: None,
            "...list.txt: cannot read the list of HDF5 files: No such file or directory",
        ),
        "an empty list": (lambda at: listed(at), "...list.txt: the list of HDF5 files is empty"),
        "no file": (
            lambda at: listed(at, "gone.h5"),
            "...list.txt: names 'gone.h5', which does not exist; expected a path relative to the working ...",
        ),
        "a text": (
            lambda at: listed(at, "list.txt"),
            "...list.txt: cannot read the HDF5 file: damaged or truncated: ...",
        ),
        **{
            f"cut to {keep}": (
                lambda at, keep=keep: cut_to(at, keep),
                "...a.h5: cannot read the HDF5 file: damaged or ...",
            )
            for keep in (0.3, 0.6, 0.95)
        },
        "batch_size 0": (
            lambda at: listed(at, "a.h5", x=np.zeros(3), t=np.zeros(3)),
            netlib.LayerError,
            "net.prototxt:1:...: error: layer 'd': batch_size must be at least 1",
        ),
    },
)
def test_invalid_files_are_rejected(here, net_of, request, given, rejected):
    given(here)
    with rejected:
        net_of(layer("list.txt", 0 if "batch_size" in request.node.name else 2))


OUTSIDE = "rest_in is '%s'; expected a relative name of a file in the same"


@pytest.mark.parametrize(
    ("rest", "link", "is_near"),
    [
        ("/etc/hostname", "", False),
        ("../../private.h5", "", False),
        ("../near/below/private.h5", "", False),
        ("../../set/a/../../private.h5", "", False),
        ("link.h5", "../../private.h5", False),
        ("link/private.h5", "../..", False),
        ("rest.h5", "", True),
        ("below/rest.h5", "", True),
        ("../rest.h5", "", True),
        ("../near/rest.h5", "", True),
        ("link.h5", "../near/rest.h5", True),
    ],
)
def test_the_rest_of_a_file_must_be_near_it(here, net_of, rest, link, is_near):
    """In the folder of the data file, below it or in a neighbouring folder, also by a
    link; nowhere else.
    """
    for folder in ("set/a/below", "set/near/below"):
        Path(folder).mkdir(parents=True)
    for place in ("private.h5", "set/near/below/private.h5", "set/near/rest.h5"):
        write_hdf5(place, x=np.zeros((3, 2)))
    if link:
        Path("set", "a", rest.split("/")[0]).symlink_to(link)
    elif is_near:
        write_hdf5(Path("set", "a", rest), x=np.zeros((3, 2)))
    write_hdf5("set/a/a.h5", t=np.zeros(3))
    with h5py.File("set/a/a.h5", "r+") as file:
        file.attrs["rest_in"] = rest
    Path("list.txt").write_text("set/a/a.h5")
    if is_near:
        assert net_of(layer("list.txt", 2)).forward()["x"].shape == (2, 2)
    else:
        with pytest.raises(netlib.DataError, match=OUTSIDE % rest):
            net_of(layer("list.txt", 2))


def cut(path):
    """Truncate a file to half of its size."""
    os.truncate(path, path.stat().st_size // 2)


@pytest.mark.parametrize("shuffle", [False, True])
@pytest.mark.parametrize("done", [0, 2], ids=["before the first batch", "after two batches"])
def test_a_file_that_is_cut_under_a_running_net(data, here, shuffle, done):
    """A truncated file raises a one-line error; on whole files a new net continues."""
    net = data([6, 5], 2, shuffle)
    found = numbers(net, done)
    for path in (Path("0.h5"), Path("1.h5")):
        cut(path)
    for _ in range(2):
        with pytest.raises(
            netlib.DataError,
            match=r"[01]\.h5: was cut to \d+ of \d+ bytes while in use; restore the",
        ):
            net.forward()
    again = data([6, 5], 2, shuffle, seed=9)
    again.restore_layer_states(net.layer_states())
    found += numbers(again, 11)
    other = data([6, 5], 2, shuffle)
    assert found == numbers(other, len(found) // 2)


def test_an_array_that_a_caller_keeps_shows_the_current_batch(data):
    """As in pycaffe: the layer writes each batch into the memory of its tops."""
    net = data([7], 2)
    net.forward()
    kept = net.blobs["x"].data
    for _ in range(3):
        net.forward()
        assert np.array_equal(kept, net.blobs["x"].data)


@pytest.mark.parametrize("row", [(2,), (2000,)], ids=["held in memory", "read"])
def test_data_that_are_overwritten_in_place(here, net_of, row):
    """A file that is overwritten during training, with the same size, raises an error."""
    write_hdf5("a.h5", x=np.ones((6, *row), np.float32))
    Path("list.txt").write_text("a.h5")
    net = net_of(layer("list.txt", 2).replace('top: "t"', ""))
    net.forward()
    size = Path("a.h5").stat().st_size
    with Path("a.h5").open("r+b") as file:
        file.seek(size // 2)
        file.write(bytes(100))
    os.utime("a.h5", ns=(0, 1))  # also for file systems with a coarse clock
    with pytest.raises(
        netlib.DataError, match=r"a\.h5: was changed while in use; restore the file and run again"
    ):
        net.forward()


def test_a_file_that_takes_the_place_of_another(data, here):
    net = data([5], 5)
    write_hdf5("short.h5", x=np.zeros((1, 2)))
    Path("short.h5").replace("0.h5")
    assert numbers(net, 2) == [0, 1, 2, 3, 4] * 2
