"""Archives in a bucket of an S3 server give the same as in a folder, also after a process was killed."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from small_archive import SETUP, filter_archive, manifest, outputs, write_log

from ftbias_jax.cli.main import main
from ftbias_jax.fleet.manifest import contents_of
from ftbias_jax.fleet.place import Place
from ftbias_jax.io.write.npz import load_npz

BUCKET = Place("s3://fleet/results")
NAMES = ["b.npz", "day/a.npz", "day/c.npz"]


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """Address of a server in a process of its own."""
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", "0"]
    said = tmp_path_factory.mktemp("server") / "said.txt"
    with open(said, "w") as file:
        process = subprocess.Popen(words, stderr=file)
    while "Running on" not in said.read_text():
        assert process.poll() is None
        time.sleep(0.1)
    yield next(line.split()[-1] for line in said.read_text().splitlines() if "Running on" in line)
    process.kill()
    process.wait()


@pytest.fixture
def store(server, tmp_path, monkeypatch):
    """The store with an empty bucket; the current folder has a setup and logs."""
    import s3fs

    told = {"ENDPOINT_URL": server, "ACCESS_KEY_ID": "me", "SECRET_ACCESS_KEY": "mine", "DEFAULT_REGION": "us-east-1"}
    for name, value in told.items():
        monkeypatch.setenv(f"AWS_{name}", value)
    monkeypatch.chdir(tmp_path)
    for seed, name in enumerate(NAMES):
        write_log(tmp_path / "logs" / name, seed)
    (tmp_path / "setup.toml").write_text(SETUP)
    system = s3fs.S3FileSystem()
    system.mkdir("fleet")
    yield system
    system.rm("fleet", recursive=True)


def filter_words(*more):
    return ["filter", "logs", "--setup", "setup.toml", "-o", BUCKET.root, *more]


def there(store):
    return sorted(name.removeprefix("fleet/results/") for name in store.find("fleet/results"))


def lines(store):
    return store.cat("fleet/results/manifest.filter.jsonl").decode().splitlines()


def test_an_archive_in_a_bucket_is_that_of_a_folder(store, capsys):
    assert main(filter_words()) == 0
    assert "wrote s3://fleet/results/manifest.filter.jsonl" in capsys.readouterr().out
    assert there(store) == sorted([*NAMES, "manifest.filter.jsonl", "manifest.filter.parquet"])
    assert filter_archive("logs") == 0
    with BUCKET.reading(NAMES) as folder:
        for name, arrays in outputs().items():
            got = load_npz(os.path.join(folder, name))
            assert got.keys() == arrays.keys()
            for key, values in arrays.items():
                np.testing.assert_array_equal(got[key], values)
    of_folder = {entry.output: entry.sums for entry in manifest()}
    assert {name: entry.sums for name, entry in contents_of(BUCKET).entries.items()} == of_folder


def test_what_is_done_in_a_bucket_is_not_done_again(store, capsys):
    assert main(filter_words()) == 0
    before = lines(store)
    assert main(filter_words()) == 0
    assert "(3 of all were done before)" in capsys.readouterr().out
    assert lines(store)[: len(before)] == before
    assert len(lines(store)) == len(before) + 1  # a run has begun
    store.pipe_file("fleet/results/day/a.npz", store.cat("fleet/results/day/a.npz")[:-1] + b"x")
    assert main(filter_words()) == 0
    assert "(3 of all" in capsys.readouterr().out
    assert main(filter_words("--verify")) == 0
    assert "(2 of all" in capsys.readouterr().out
    store.rm_file("fleet/results/b.npz")
    assert main(filter_words()) == 0
    assert "(2 of all" in capsys.readouterr().out


def test_what_others_put_into_a_bucket_is_not_replaced(store, capsys):
    store.pipe_file("fleet/results/b.npz", b"not ours")
    assert main(filter_words()) == 1
    assert "s3://fleet/results/b.npz: is there already" in capsys.readouterr().err
    assert main(filter_words("--force")) == 0


def test_a_bucket_that_is_not_there_is_told_before_anything_is_filtered(store, capsys):
    assert main(["filter", "logs", "--setup", "setup.toml", "-o", "s3://none/results"]) == 1
    assert "s3://none/results: cannot be written" in capsys.readouterr().err


def test_logs_and_results_may_be_in_one_bucket(store):
    for name in NAMES:
        store.put_file(f"logs/{name}", f"fleet/runs/{name}")
    words = ["filter", "s3://fleet/runs", "--setup", "setup.toml", "-o", "s3://fleet/runs/results/"]
    assert main(words) == main(words) == 0
    kept = {name.removeprefix("fleet/runs/results/") for name in store.find("fleet/runs/results")}
    assert kept == {*NAMES, "manifest.filter.jsonl", "manifest.filter.parquet"}


def test_a_page_is_made_of_a_bucket_and_put_there(store, capsys):
    assert main(filter_words()) == 0
    assert main(["report", BUCKET.root, "-o", "s3://fleet/results/fleet.html"]) == 0
    assert "3 logs of 1 robot," in capsys.readouterr().out
    assert b"Fleet in s3://fleet/results" in store.cat("fleet/results/fleet.html")
    store.pipe_file("fleet/results/fleet.html", b"not ours")
    assert main(["report", BUCKET.root, "-o", "s3://fleet/results/fleet.html"]) == 1
    assert "s3://fleet/results/fleet.html: is there already" in capsys.readouterr().err
    assert main(["report", "s3://fleet/results/b.npz", "-o", "b.html"]) == 0
    assert os.path.getsize("b.html") > 10_000


@pytest.mark.slow
def test_a_process_that_is_killed_loses_no_line_that_was_published(store):
    for seed in range(40):
        write_log(Path("logs", f"more{seed}.npz"), seed)
    program = "import sys; from ftbias_jax.fleet import manifest; manifest.PUBLISH_SECONDS = 0.2; "
    program += "from ftbias_jax.cli.main import main; sys.exit(main())"
    killed = subprocess.Popen([sys.executable, "-c", program, *filter_words()], stdout=subprocess.DEVNULL)
    while killed.poll() is None and len(contents_of(BUCKET).entries) < 10:
        time.sleep(0.05)
    killed.send_signal(signal.SIGKILL)
    assert killed.wait() == -signal.SIGKILL
    before = contents_of(BUCKET).entries
    assert 10 <= len(before) < 43
    assert main(filter_words()) == 0
    told = [entry for line in lines(store) if (entry := json.loads(line).get("log"))]
    assert len(told) == len({entry["output"] for entry in told}) == 43
    assert {name: entry.done for name, entry in before.items()}.items() <= {
        e["output"]: e["done"] for e in told
    }.items()
    assert len([name for name in there(store) if name.startswith("manifest")]) == 2
