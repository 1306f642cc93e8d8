"""Archives in buckets, in a store of fsspec in memory: what is published when, and what a killed process leaves."""

import fsspec
import pytest

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.fleet.entry import OK, Entry, LogState
from ftbias_jax.fleet.manifest import Manifest, contents_of
from ftbias_jax.fleet.place import Place, few_parts

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


def objects(store):
    return sorted(name.rsplit("/", 1)[1] for name in store.find("/bucket/results"))


def test_a_file_that_grows_is_few_objects_and_one_in_the_end(store):
    bucket, sent = Place("memory://bucket/results"), []
    words = [f"{i:04d}" for i in range(500)]
    piped = type(store).pipe_file
    with pytest.MonkeyPatch.context() as patch, bucket.growing(NAME) as (path, publish):
        patch.setattr(type(store), "pipe_file", lambda *given: (sent.append(len(given[2])), piped(*given)))
        for i, word in enumerate(words, 1):
            with open(path, "a") as file:
                file.write(f"{word}\n")
            publish()
            there = objects(store)
            assert len(there) <= i.bit_length()
            in_order = there[-1:] + there[:-1]  # the first one has no number
            assert [word for name in in_order for word in lines(store, name)] == words[:i]
    assert objects(store) == [NAME]
    assert lines(store) == words
    assert sum(sent) < 5 * len(words) * len(words).bit_length()
    with bucket.growing(NAME) as (path, publish):  # goes on where it was
        with open(path, "a") as file:
            file.write("more\n")
        publish()
        assert len(objects(store)) == 2
    assert lines(store) == [*words, "more"]


@pytest.mark.parametrize("left", range(5))
def test_a_process_that_is_killed_between_two_objects_loses_and_doubles_nothing(store, left):
    """It has written the object that takes the place of others, and was killed before it removed them."""
    bucket, words = Place("memory://bucket/results"), [f"{i}" * 9 for i in range(9)]
    states = []
    with bucket.growing(NAME) as (path, publish):
        for word in words:
            with open(path, "a") as file:
                file.write(f"{word}\n")
            publish()
            states.append({name: store.cat(name) for name in store.find("/bucket/results")})
    together = states[left + 2] | states[left + 3]
    store.rm("/bucket/results", recursive=True)
    for name, data in together.items():
        store.pipe_file(name, data)
    with bucket.growing(NAME):
        pass
    assert objects(store) == [NAME]
    assert lines(store) == words[: left + 4]


@pytest.mark.parametrize(
    ("starts", "size", "kept"),
    [
        ([0], 10, [0]),
        ([0, 10], 14, [0, 10]),
        ([0, 10], 15, [0]),
        ([0, 100, 110], 115, [0, 100]),
        ([0, 10, 16], 16, [0, 10, 16]),
    ],
)
def test_objects_become_one_from_half_the_size_of_the_one_before(starts, size, kept):
    assert few_parts(starts, size) == kept


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
    assert contents_of(bucket).damaged == 0  # that of another archive
