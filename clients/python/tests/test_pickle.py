"""Datasets that go to other processes: pickle, multiprocessing, dask. The token stays where it is."""

import asyncio
import importlib.util
import multiprocessing
import pathlib
import pickle

import pytest

import isoscope
import skips


def token_of(client):
    return pathlib.Path(client.token_file).read_text()


def test_a_dataset_comes_back_from_pickle_and_renders(client, dataset):
    again = pickle.loads(pickle.dumps(dataset))
    assert again == dataset and again._client is not client
    assert again.render(127.5, size=32).png == dataset.render(127.5, size=32).png
    # The contents that it means go along.
    assert again._client._capabilities == client._capabilities


def test_the_token_is_in_no_pickle_and_comes_from_where_the_dataset_is_used(client, monkeypatch):
    token = token_of(client)
    with isoscope.connect(client.address, token=token, metadata=[("x-secret", "another secret")]) as through:
        for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
            for thing in (through, through["shells"], through._target):
                text = pickle.dumps(thing, protocol)
                assert token.encode() not in text and b"another secret" not in text
        text = pickle.dumps(through["shells"])
    with pytest.raises(isoscope.UnauthenticatedError):
        pickle.loads(text).render(127.5, size=16)
    monkeypatch.setenv("ISOSCOPE_TOKEN", token)
    assert pickle.loads(text).render(127.5, size=16).width == 16
    # And it is what connect sends unless it is told otherwise.
    assert list(isoscope.connect(client.address)) == ["shells"]


def test_a_token_of_the_environment_goes_unencrypted_to_no_other_machine(monkeypatch):
    from isoscope._channel import Target

    monkeypatch.setenv("ISOSCOPE_TOKEN", "t")
    assert pickle.loads(pickle.dumps(Target("host:1"))).with_token().token is None
    assert pickle.loads(pickle.dumps(Target("host:1", tls=True))).with_token().token == "t"
    with pytest.raises(isoscope.InvalidArgumentError, match="unencrypted"):
        isoscope.connect("host:1")
    monkeypatch.setenv("ISOSCOPE_TOKEN", "two words")
    with pytest.raises(isoscope.InvalidArgumentError, match="ISOSCOPE_TOKEN holds no token"):
        isoscope.connect("localhost:1")


def test_datasets_of_one_server_share_a_connection_until_it_is_closed(dataset):
    text = pickle.dumps(dataset)
    first, second = pickle.loads(text), pickle.loads(text)
    assert first._client is second._client
    first._client.close()
    assert pickle.loads(text).render(127.5, size=16).width == 16


def test_an_async_client_says_that_it_is_not_pickled(client):
    async def pickled():
        async with isoscope.aio.connect(client.address, token_file=client.token_file) as through:
            with pytest.raises(TypeError, match="event loop.*isoscope.Dataset"):
                pickle.dumps(await through.dataset("shells"))

    asyncio.run(pickled())


def rendered(dataset, azimuth):
    return dataset.render(127.5, size=24, azimuth=azimuth).png


def test_a_pool_of_other_processes_renders(dataset):
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        pictures = pool.starmap(rendered, [(dataset, 0), (dataset, 40)])
    assert pictures == [rendered(dataset, 0), rendered(dataset, 40)]


def test_dask_renders(client, dataset):
    if importlib.util.find_spec("dask") is None or importlib.util.find_spec("cloudpickle") is None:
        skips.skip("python", "no dask (python3-dask)")
    import cloudpickle
    import dask

    text = cloudpickle.dumps(dataset)
    assert token_of(client).encode() not in text
    assert cloudpickle.loads(text) == dataset
    tasks = [dask.delayed(dataset.render)(127.5, size=24, azimuth=angle) for angle in (0, 40)]
    expected = [rendered(dataset, 0), rendered(dataset, 40)]
    for scheduler in ("threads", "processes"):
        assert [frame.png for frame in dask.compute(*tasks, scheduler=scheduler)] == expected, scheduler
