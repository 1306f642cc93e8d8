"""Archives in buckets, on an fsspec store in memory: what is published when, and what a killed process leaves."""

import fsspec
import pytest

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.fleet.entry import OK, Entry, LogState
from ftbias_jax.fleet.manifest import Manifest, contents_of
from ftbias_jax.fleet.place import Place

NAME = "manifest.filter.jsonl"


@pytest.fixture
def store():
    memory = fsspec.filesystem("memory")
    yield memory
    if memory.exists("/bucket"):
        memory.rm("/bucket", recursive=True)


@pytest.fixture(params=["folder", "bucket"])
def place(request, tmp_path, store):
    return Place(str(tmp_path) if request.param == "folder" else "memory://bucket/results")


def lines(store, name=NAME):
    return store.cat(f"/bucket/results/{name}").decode().split()


def test_files_are_there_once_all_are_written(place):
    with place.writing() as folder:
        for name in ("a.npz", "manifest.filter.jsonl"):
            open(f"{folder}/{name}", "wb").close()
    assert place.sizes(["a.npz", "b.npz"]) == {"a.npz": 0}
    assert place.named() == [NAME]
    with place.reading(["a.npz", "b.npz"]) as folder:
        assert Place(folder).sizes(["a.npz", "b.npz"]) == {"a.npz": 0}


def test_nothing_is_published_of_what_goes_wrong(store):
    bucket = Place("memory://bucket/results")

    def work():
        with bucket.writing() as folder:
            open(f"{folder}/b.npz", "wb").close()
            raise OutputError("no room", file=f"{folder}/day/a.npz")

    with pytest.raises(OutputError, match=r"^memory://bucket/results/day/a.npz: no room"):
        work()
    assert bucket.sizes(["b.npz"]) == {}


def test_a_store_that_cannot_be_written_is_told(store, monkeypatch):
    def refused(*given, **named):
        raise PermissionError("403")

    monkeypatch.setattr(type(store), "put_file", refused)
    with (
        pytest.raises(OutputError, match=r"^memory://bucket: cannot be written: 403 \(check the URL"),
        Place("memory://bucket").writing() as folder,
    ):
        open(f"{folder}/a.npz", "wb").close()


def test_names_that_lead_out_of_the_bucket_are_refused(store, monkeypatch):
    monkeypatch.setattr(type(store), "find", lambda *given, **named: {"/bucket/results/../manifest.json": {"size": 1}})
    with pytest.raises(LogError, match="which is not in it"):
        Place("memory://bucket/results").named()


def test_a_file_that_grows_is_one_object_and_goes_on_where_it_was(store):
    bucket = Place("memory://bucket/results")
    for word in ("one", "two"):
        with bucket.growing(NAME) as (path, publish):
            with open(path, "a") as file:
                file.write(f"{word}\n")
            publish()
            assert lines(store)[-1] == word
            with open(path, "a") as file:
                file.write("more\n")
    assert lines(store) == ["one", "more", "two", "more"]
    assert len(store.find("/bucket/results")) == 1


def test_a_manifest_that_takes_long_to_send_is_sent_seldom(tmp_path, monkeypatch):
    sent, clock = [], iter(range(0, 10**6, 10))  # each reading of the clock is 10 s later
    monkeypatch.setattr("ftbias_jax.fleet.manifest.time.monotonic", lambda: float(next(clock)))
    with Manifest(str(tmp_path / NAME), lambda: sent.append(1)) as manifest:
        for _ in range(100):
            manifest.add("log", {})
    assert len(sent) == 5


def test_a_manifest_in_a_bucket_is_read_while_it_grows(store):
    bucket = Place("memory://bucket/results")
    one = Entry("a.npz", "a.npz", status=OK, state=LogState(1, 2, 3, "x"), done=1.0)
    with bucket.growing(NAME) as growing, Manifest(*growing) as manifest:
        manifest.add_entry(one)
        assert contents_of(bucket).entries == {}
        manifest.add("run", {})
        assert contents_of(bucket).entries == {"a.npz": one}
        manifest.add_entry(one._replace(output="b.npz"))
        manifest.add("run", {})
        assert contents_of(bucket).entries.keys() == {"a.npz", "b.npz"}
    store.pipe_file("/bucket/results/below/manifest.filter.jsonl", b"{")
    assert contents_of(bucket).damaged == 0  # it belongs to another archive
