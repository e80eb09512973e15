"""The distribution of rows among ranks, and training with one rank, without MPI."""

import cv2
import lmdb
import numpy as np
import pytest

from netlib.distributed.ranks import ALONE, RankOfLayers, Shard
from netlib.errors import LayerError, NetlibError
from netlib.net import Net
from netlib.proto import prototxt
from tests.support.caffe_messages import datum

COUNT, ROWS, BATCH = 3, 10, 2


@pytest.mark.parametrize("count", [1, 2, 3, 7])
def test_every_row_of_a_step_goes_to_one_rank(count):
    """Row k of a step is row k div N of rank k mod N, however the step is divided into pieces."""
    for pieces in ([12], [1, 1, 10], [5, 7], [2, 3, 0, 7]):
        for rank in range(count):
            got, done = {}, 0
            for take in pieces:
                own, places = Shard(rank, count).rows(done, take)
                got.update(zip(range(places.start, places.stop), range(done, done + take)[own]))
                done += take
            assert got == {k // count: k for k in range(12) if k % count == rank}
            places = Shard(rank, count).places(-(-12 // count))
            assert got == {place: k for place, k in zip(places, range(12)) if place is not None}


def test_batches():
    assert Shard(1, 4).batch(6) == 6
    assert Shard(1, 4, divide=True).batch(8) == 2
    with pytest.raises(
        ValueError,
        match=r"^a batch of 6 cannot be divided among 4 ranks; expected a multiple of 4$",
    ):
        Shard(1, 4, divide=True).batch(6)


def test_a_batch_that_cannot_be_divided(write_rows):
    with pytest.raises(
        LayerError,
        match=r"^net:1:\d+: error: layer 'd': a batch of 6 cannot be divided among 4 ranks",
    ):
        net(hdf5(None, write_rows, "false"), 6, Shard(1, 4, divide=True))


def test_alone():
    y, done = np.ones(3), []
    ALONE.introduce({"data": 1})
    ALONE.at_root(lambda: done.append(1))
    assert done == [1]
    assert y.tolist() == [1, 1, 1]
    assert ALONE.shard == Shard()
    assert ALONE.agree(2.5, "stop") == 2.5
    assert ALONE.asked("stop") == "stop"
    assert ALONE.everyone({"a": 1}) == [{"a": 1}]
    error = NetlibError("no")
    with pytest.raises(NetlibError) as raised, ALONE.together():
        raise error
    assert raised.value is error


def hdf5(folder, write_rows, shuffle):
    path = write_rows("list.txt", [4, 1, 5], x=(1,))
    return f'type: "HDF5Data" top: "x" hdf5_data_param {{ source: "{path}" batch_size: %d shuffle: {shuffle} }}'


def database(folder, write_rows, shuffle):
    path = folder / f"lmdb_{shuffle}"
    with lmdb.open(str(path), map_size=1 << 20) as env, env.begin(write=True) as change:
        for i in range(ROWS):
            change.put(f"{i:08}".encode(), datum(np.full((1, 1, 1), i, np.uint8), i))
    return f'type: "Data" top: "x" top: "t" data_param {{ source: "{path}" batch_size: %d backend: LMDB }}'


def pictures(folder, write_rows, shuffle):
    for i in range(ROWS):
        cv2.imwrite(str(folder / f"{i}.png"), np.full((1, 1, 3), i, np.uint8))
    (folder / "list").write_text("".join(f"{i}.png {i}\n" for i in range(ROWS)))
    return (
        f'type: "ImageData" top: "x" top: "t" image_data_param '
        f'{{ source: "{folder}/list" batch_size: %d shuffle: {shuffle} }}'
    )


def net(text, batch, share):
    return Net(
        prototxt.parse('layer { name: "d" ' + text % batch + " }", "net"),
        seed=1,
        layer_hook=RankOfLayers(share),
    )


@pytest.mark.parametrize("shuffle", ["false", "true"])
@pytest.mark.parametrize("layer", [hdf5, database, pictures])
def test_ranks_read_what_one_would_read(tmp_path, write_rows, layer, shuffle):
    """Row k of rank r is row k N + r of a batch N times as large, for several steps, past the end
    of the data, after a resume, and also if the batch is divided among the ranks.
    """
    text = layer(tmp_path, write_rows, shuffle)
    whole = net(text, BATCH * COUNT, Shard())
    ranks = [net(text, BATCH, Shard(r, COUNT)) for r in range(COUNT)]
    divided = [net(text, BATCH * COUNT, Shard(r, COUNT, divide=True)) for r in range(COUNT)]
    seen = []
    for step in range(5):
        expected = whole.forward()["x"].copy()
        seen.append(expected)
        for nets in (ranks, divided):
            for r, of_rank in enumerate(nets):
                if step == 2:
                    states = of_rank.layer_states()
                    of_rank = nets[r] = net(
                        text, BATCH * (COUNT if nets is divided else 1), of_rank.layers[0].shard
                    )
                    of_rank.restore_layer_states(states)
                assert np.array_equal(of_rank.forward()["x"], expected[r::COUNT])
    assert len(np.unique(seen)) == ROWS  # all rows occur and they differ


def test_more_ranks_than_rows(write_rows, caplog):
    text = hdf5(None, write_rows, "false")
    nets = [net(text, 1, Shard(r, 12)) for r in range(12)]
    rows = [float(n.forward()["x"][0, 0]) for n in nets]
    assert rows[:2] == rows[10:]
    assert len(set(rows)) == 10
    assert "batch_size 12 is more than the 10 rows" in caplog.text


@pytest.mark.parametrize("layer", [hdf5, database, pictures])
def test_reads_identifies_the_data_of_a_layer(tmp_path, write_rows, layer):
    text = layer(tmp_path, write_rows, "false")
    first, second = (net(text, 1, Shard(r, 2)).layers[0].reads() for r in range(2))
    assert first == second
    if layer is hdf5:
        write_rows("list.txt", [4, 1, 5], seed=1, x=(1,))  # the same number of rows
    elif layer is database:
        with (
            lmdb.open(str(tmp_path / "lmdb_false"), map_size=1 << 20) as env,
            env.begin(write=True) as change,
        ):
            change.put(f"{0:08}".encode(), datum(np.full((1, 1, 1), 99, np.uint8), 0))
    else:
        (tmp_path / "list").write_text((tmp_path / "list").read_text().replace(" 7\n", " 8\n"))
    assert net(text, 1, Shard()).layers[0].reads() != first


def test_random_numbers():
    """All ranks have the same initial parameters, but draw different random data."""
    text = """type: "DummyData" top: "x" dummy_data_param { shape { dim: %d dim: 4 }
              data_filler { type: "gaussian" } } }
              layer { name: "fc" type: "InnerProduct" bottom: "x" top: "y"
                      inner_product_param { num_output: 3 weight_filler { type: "gaussian" } }"""
    nets = [net(text, 2, Shard(r, 3)) for r in range(3)]
    drawn = [n.forward()["y"].tobytes() for n in nets]
    assert len({n.params["fc"][0].data.tobytes() for n in nets}) == 1
    assert len(set(drawn)) == 3
    assert net(text, 2, Shard(1, 3)).forward()["y"].tobytes() == drawn[1]
