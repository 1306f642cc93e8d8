"""The manifest: lines are only appended, a truncated one is ignored, and edits by hand do no harm."""

import hashlib
import json
import os
import time
import tracemalloc

import pytest

from ftbias_jax.errors import LogError, OutputError
from ftbias_jax.fleet.entry import FAILED, OK, Entry, LogState, Settings
from ftbias_jax.fleet.manifest import LONGEST_LINE, Manifest, done_before, is_unchanged, manifest_name, read_manifests
from ftbias_jax.fleet.place import Place

ENTRY = Entry("logs/a.npz", "a.npz", status=OK, output_bytes=3, state=LogState(1, 2, 3, "x"), quality={"nis": 1.0})


def write(folder, *entries, name="manifest.filter.jsonl"):
    with Manifest(str(folder / name)) as manifest:
        for entry in entries:
            manifest.add_entry(entry)


def test_what_was_added_is_read(tmp_path):
    settings = Settings("filter", "abc", {"smooth": True}, "1", "setup.toml", "arm 3")
    with Manifest(str(tmp_path / "manifest.filter.jsonl")) as manifest:
        manifest.add("settings", settings._asdict())
        manifest.add("run", {"logs": 1})
        manifest.add_entry(ENTRY._replace(settings=settings.key, repairs=("one",)))
    found = read_manifests(str(tmp_path))
    assert found.settings == {settings.key: settings}
    assert found.entries == {"a.npz": ENTRY._replace(settings=settings.key, repairs=("one",))}


def test_the_key_of_settings_is_of_what_results_depend_on():
    one = Settings("filter", "abc", {"a": 1, "b": 2}, "1", "setup.toml")
    assert one.key == one._replace(setup="elsewhere/setup.toml", choices={"b": 2, "a": 1}).key
    others = [one._replace(job="check"), one._replace(setup_sha256="abd"), one._replace(choices={"a": 2, "b": 2})]
    assert len({one.key, *(other.key for other in others)}) == 4


def test_the_last_line_about_a_result_holds(tmp_path):
    write(tmp_path, ENTRY._replace(done=5.0), ENTRY._replace(done=6.0, status=FAILED))
    write(tmp_path, ENTRY._replace(done=4.0, error="of another machine"), name="manifest.filter.1-of-2.jsonl")
    assert read_manifests(str(tmp_path)).entries["a.npz"].status == FAILED


@pytest.mark.parametrize("cut", [1, 20, 200])
def test_a_torn_line_is_forgotten_and_the_next_one_is_whole(tmp_path, cut):
    write(tmp_path, ENTRY, ENTRY._replace(output="b.npz"))
    path = tmp_path / "manifest.filter.jsonl"
    path.write_bytes(path.read_bytes()[:-cut])
    write(tmp_path, ENTRY._replace(output="c.npz"))
    found, is_whole = read_manifests(str(tmp_path)), cut == 1
    assert found.entries.keys() == ({"a.npz", "c.npz"} | ({"b.npz"} if is_whole else set()))
    assert found.damaged == (not is_whole)


@pytest.mark.parametrize(
    "change",
    [
        {"done": "yesterday"},
        {"state": None},
        {"quality": [1]},
        {"output": 7},
        {"repairs": 3},
        {"surprise": 1},
        {"samples": 10**25},
        {"samples": True},
        {"state": {**ENTRY.state._asdict(), "modified_ns": 10**25}},
        {"quality": {"nis": [[1.0]]}},
        {"quality": {"bias": [1.0] * 5}},
        {"quality": {"date": "0001-01-01T00:00:00+14:00"}},
        {"quality": {"date": "9999-12-31T23:59:59-14:00"}},
        {"quality": {"causes": 3}},
        {"output": "../a.npz"},
        {"sums": {"/etc/passwd": "x"}},
    ],
)
def test_lines_with_other_fields_or_types_say_nothing(tmp_path, change):
    content = {**ENTRY._asdict(), "state": ENTRY.state._asdict(), **change}
    lines = [json.dumps({"log": content}), "[1, 2]", '"log"', "{", "\x00", json.dumps({"log": {}})]
    (tmp_path / "manifest.filter.jsonl").write_text("\n".join(lines))
    assert read_manifests(str(tmp_path)) == ({}, {}, len(lines))


def test_a_long_line_is_damaged_and_those_around_it_are_read_without_holding_it(tmp_path):
    write(tmp_path, ENTRY)
    with (tmp_path / "manifest.filter.jsonl").open("ab") as file:
        file.write(b'{"log": "' + b"x" * (20 * LONGEST_LINE) + b'"}\n')
    write(tmp_path, ENTRY._replace(output="b.npz"))
    tracemalloc.start()
    found = read_manifests(str(tmp_path))
    assert tracemalloc.get_traced_memory()[1] < 6 * LONGEST_LINE
    tracemalloc.stop()
    assert (found.entries.keys(), found.damaged) == ({"a.npz", "b.npz"}, 1)


@pytest.mark.parametrize("name", ["manifest.filter.jsonl", "manifest.json"])
def test_a_sparse_manifest_of_5_gb_is_refused_before_it_is_read(tmp_path, name):
    with (tmp_path / name).open("wb") as file:
        file.truncate(5 * 10**9)
    started = time.perf_counter()
    with pytest.raises(LogError, match=r"MiB, more than the \d+ MiB that a manifest may have"):
        read_manifests(str(tmp_path))
    assert time.perf_counter() - started < 1


def test_a_file_with_other_bytes_is_not_unchanged(tmp_path):
    (tmp_path / "a.npz").write_bytes(b"123")
    (tmp_path / "a.html").write_bytes(b"page")
    sums = {name: hashlib.sha256((tmp_path / name).read_bytes()).hexdigest() for name in ("a.npz", "a.html")}
    entry = ENTRY._replace(sums=sums)
    assert is_unchanged(Place(str(tmp_path)), entry)
    assert not is_unchanged(Place(str(tmp_path)), ENTRY)  # of an earlier version, which kept no sums
    (tmp_path / "a.html").write_bytes(b"pale")
    assert not is_unchanged(Place(str(tmp_path)), entry)
    (tmp_path / "a.html").unlink()
    os.mkfifo(tmp_path / "a.html")  # reading it would block
    assert not is_unchanged(Place(str(tmp_path)), entry)


def test_only_whole_results_are_done(tmp_path):
    names = ("a.npz", "cut.npz", "gone.npz", "failed.npz")
    write(tmp_path, *(ENTRY._replace(output=name, status=FAILED if name == "failed.npz" else OK) for name in names))
    for name, content in (("a.npz", b"123"), ("cut.npz", b"12"), ("failed.npz", b"123")):
        (tmp_path / name).write_bytes(content)
    assert done_before(Place(str(tmp_path)), read_manifests(str(tmp_path))).keys() == {"a.npz"}


def test_a_line_costs_the_same_for_the_first_log_and_for_the_ten_thousandth(tmp_path):
    """The median is compared, because other processes use the machine at times."""
    seconds = []
    with Manifest(str(tmp_path / "manifest.filter.jsonl")) as manifest:
        for number in range(5000):
            started = time.perf_counter()
            manifest.add_entry(ENTRY._replace(output=f"{number}.npz"))
            seconds.append(time.perf_counter() - started)
    first, last = (sorted(part)[len(part) // 2] for part in (seconds[:500], seconds[-500:]))
    assert last < 5 * first
    assert len(read_manifests(str(tmp_path)).entries) == 5000


def test_a_folder_that_is_not_there_is_told(tmp_path):
    with pytest.raises(OutputError, match="cannot be written"):
        Manifest(str(tmp_path / "none" / "manifest.filter.jsonl"))


def test_commands_and_machines_have_manifests_of_their_own():
    names = {manifest_name(job, *shard) for job in ("filter", "check") for shard in ((1, 1), (1, 2), (2, 2))}
    assert len(names) == 6


def test_a_manifest_that_is_a_link_is_not_written_through(tmp_path):
    (tmp_path / "recording").write_bytes(b"samples")
    path = tmp_path / "manifest.filter.jsonl"
    path.symlink_to("recording")
    with pytest.raises(OutputError, match="symbolic link"):
        Manifest(str(path))
    assert (tmp_path / "recording").read_bytes() == b"samples"
