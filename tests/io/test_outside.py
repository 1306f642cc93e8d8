"""Names in a setup, a listing or a URL: read only in the log's folder, and never used as the path of a copy."""

import os
import shlex

import fsspec
import made_scenes
import numpy as np
import pytest
from small_archive import SETUP, write_log

from ftbias_jax.cli.main import build_parser, main
from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.fleet import entry
from ftbias_jax.fleet.find import find_logs
from ftbias_jax.io import read_log
from ftbias_jax.io import remote as fetch
from ftbias_jax.io.remote import check_links, check_patterns, copy_name, is_below
from ftbias_jax.io.ros.record import SUFFIXES
from ftbias_jax.io.tables.arrays import TABLES
from ftbias_jax.setup import dump_setup, load_setup

COMMANDS = [
    "info 1_ft.npz --setup setup.toml",
    "check 1_ft.npz --setup setup.toml",
    "filter 1_ft.npz --setup setup.toml -o out.npz",
    "tune 1_ft.npz --setup setup.toml -o out.toml",
    "identify 1_ft.npz --setup setup.toml -o out.toml",
    "diagnose 1_ft.npz --setup setup.toml --json out.json",
    "calibrate 1_ft.npz --setup setup.toml -o out.toml",
    "simulate --motion 1_ft.npz --setup setup.toml -o out.npz",
    *(f"{job} 1_ft.npz --setup setup.toml -o results" for job in ("filter", "check", "diagnose", "identify", "tune")),
    "plan --from 1_ft.npz --setup setup.toml -o out.npz",
    "replay 1_ft.npz --setup setup.toml --mjcf scene.xml -o out.npz",
    "validate-sim 1_ft.npz --setup setup.toml --found setup.toml --like scene.xml --mended scene.xml",
]


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A log of two files in a folder, and its joints again in the folder above."""
    place = tmp_path / "logs"
    write_log(place / "whole.npz")
    monkeypatch.chdir(place)
    with np.load("whole.npz") as log:
        np.savez("1_ft.npz", t=log["t"], wrench=log["wrench"])
        np.savez("1_joints.npz", t=log["t"], q=log["q"])
        np.savez(tmp_path / "above.npz", t=log["t"], q=log["q"])
    return place


def state(pattern):
    with open("setup.toml", "w") as file:
        file.write(f'{SETUP}[log.files]\nposition = "{pattern}"\nwrench = "*_ft.npz"\n')


def outside(tmp_path):
    return [str(tmp_path / "above.npz"), "../above.npz", "sub/../../above.npz", "ftp://127.0.0.1/x.npz", "~/above.npz"]


@pytest.mark.parametrize("words", COMMANDS, ids=lambda words: f"{words.split()[0]} {words.split()[-1]}")
@pytest.mark.parametrize("which", range(5))
def test_a_setup_reads_nothing_outside_without_the_users_word(folder, tmp_path, capsys, monkeypatch, words, which):
    for door in ("local_copy", "size_and_time", "listed"):
        monkeypatch.setattr(fetch, door, lambda url: pytest.fail(f"connects to {url}"))
    monkeypatch.setattr(entry, "size_and_time", fetch.size_and_time)
    if "scene.xml" in words:
        made_scenes.write(folder)
    state(outside(tmp_path)[which])
    assert main(shlex.split(words)) == 1
    assert "log.files.position" in (said := capsys.readouterr().err)
    assert "--allow-outside" in said
    assert not (folder / "out.npz").exists()


def test_the_users_word_allows_it(folder, tmp_path):
    state("../above.npz")
    assert main(["filter", "1_ft.npz", "--setup", "setup.toml", "-o", "out.npz", "--allow-outside"]) == 0
    assert len(read_log("1_ft.npz", load_setup("setup.toml", allow_outside=True)).t) == 300


def test_a_link_out_of_the_folder_is_refused_and_one_within_is_not(folder, tmp_path):
    state("*_link.npz")
    os.symlink("1_joints.npz", "1_link.npz")
    assert len(read_log("1_ft.npz", load_setup("setup.toml")).t) == 300
    os.unlink("1_link.npz")
    os.symlink(tmp_path / "above.npz", "1_link.npz")
    for name in ("1_ft.npz", "1_link.npz"):
        with pytest.raises(LogError, match=r"log.files.position.*leads out of the log's folder.*--allow-outside"):
            read_log(name, load_setup("setup.toml"))
    assert len(read_log("1_ft.npz", load_setup("setup.toml", allow_outside=True)).t) == 300


def test_the_file_that_names_a_log_is_no_way_out_for_a_link(folder, tmp_path, capsys):
    """The user gives the joints, and the command resolves the wrench."""
    state("*_joints.npz")
    os.replace("1_ft.npz", tmp_path / "ft.npz")
    os.symlink(tmp_path / "ft.npz", "1_ft.npz")
    assert main(["check", "1_joints.npz", "--setup", "setup.toml"]) == 1
    assert "log.files.wrench: is a link that leads out of the log's folder" in capsys.readouterr().err


@pytest.mark.parametrize("log", ["1_ft.npz", "../logs/1_ft.npz", ".."])
def test_with_the_users_word_an_address_is_read_wherever_the_log_is(folder, log):
    memory = fsspec.filesystem("memory")
    memory.put("1_joints.npz", "/joints.npz")
    os.unlink("1_joints.npz")
    state("memory://joints.npz")
    assert main(["check", log, "--setup", "setup.toml", "-o", "out", "--allow-outside"]) == 0
    assert os.path.exists("out/logs/1_ft.check.json" if log == ".." else "out/1_ft.check.json")
    fetch.forget()
    memory.rm("/joints.npz")


def test_what_the_star_stands_for_does_not_lead_upward_on_a_server():
    files = {"wrench": "memory://runs/.._ft.npz", "position": "memory://runs/../q.npz"}
    with pytest.raises(LogError, match=r"log.files.position"):
        check_links(files, files["wrench"])
    check_links({"wrench": "memory://runs/a_ft.npz", "position": "memory://runs/a/q.npz"}, "memory://runs/a_ft.npz")


def test_every_command_that_reads_logs_with_a_setup_takes_the_users_word():
    (commands,) = (each.choices for each in build_parser()._actions if each.dest == "command")
    reading = {
        name
        for name, parser in commands.items()
        if {"setup"} < {each.dest for each in parser._actions} & {"setup", "log", "logs", "motion"}
    }
    assert reading == {name for name, parser in commands.items() if "--allow-outside" in parser._option_string_actions}
    assert reading == {words.split()[0] for words in COMMANDS}


def test_a_setup_cannot_give_the_users_word_nor_write_it_down(folder):
    state("../above.npz")
    assert "outside" not in dump_setup(load_setup("setup.toml", allow_outside=True))
    with open("setup.toml", "a") as file:
        file.write("[log]\nallow_outside = true\n")
    with pytest.raises(SetupError, match="allow_outside"):
        load_setup("setup.toml")


def test_a_zero_byte_in_a_name_is_told(folder):
    state("a\\u0000b.npz")
    with pytest.raises(SetupError, match=r"log\.files\.position: has a zero byte"):
        load_setup("setup.toml")


def test_names_in_the_folder_and_below_are_allowed():
    check_patterns({"position": "joints/*_q.npz", "wrench": "*..npz", "velocity": "..hidden.npz"})
    for bad in (
        "/etc/x.npz",
        "..",
        "a/../b",
        "%2e%2e/b",
        "a::file:///etc/x.npz",
        "C:\\x.npz",
        "\\\\host\\x.npz",
        "a\\..\\b",
        "http://h/x",
    ):
        with pytest.raises(SetupError):
            check_patterns({"wrench": bad})


@pytest.mark.parametrize(
    "url",
    [
        "ftp://host/%2Fetc%2Fx.npz",
        "http://host/..%2F..%2Fx.csv",
        "s3://b/a/../../x.npz",
        "http://host/a.npz%00.csv",
        "https://h/x.mcap.zstd",
    ],
)
def test_nothing_of_an_address_is_in_the_name_of_its_copy(url):
    name = copy_name(url)
    stem, _, suffix = name.partition(".")
    assert len(stem) == 16
    assert set(stem) <= set("0123456789abcdef")
    assert f".{suffix}" in {s + packed for s in (*TABLES, *SUFFIXES) for packed in ("", ".zstd")}
    assert copy_name(url) == name != copy_name(url.replace("://", "://other"))


def test_an_address_without_the_suffix_of_a_log_is_refused():
    for name in ("what?.npz", "x.npz?versionId=1", "X.NPZ"):
        assert copy_name(f"s3://bucket/{name}").endswith(".npz")
    assert copy_name(fetch.without_credentials("https://host/x.csv?sig=a.npz")).endswith(".csv")
    for url in ("ftp://host/etc/passwd", "http://host/", "http://host/x.npz?sig=1#.csv".replace(".npz", ".sh")):
        with pytest.raises(LogError, match="no suffix of a log"):
            copy_name(url)


def test_a_copy_lies_in_a_folder_of_its_own(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", os.fspath(tmp_path))
    target = tmp_path / "treasure.npz"
    target.write_bytes(b"treasure")
    memory = fsspec.filesystem("memory")
    url = f"memory://x/{os.fspath(target).replace('/', '%2F')}"
    memory.pipe(memory._strip_protocol(url), b"evil")
    copy = fetch.local_copy(url)
    assert os.path.dirname(os.path.dirname(copy)) == os.fspath(tmp_path)
    assert target.read_bytes() == b"treasure"
    fetch.forget()
    memory.rm("/x", recursive=True)


@pytest.mark.parametrize(
    ("name", "folder", "below"),
    [
        ("/runs/a.npz", "/runs", True),
        ("/runs/../etc/a.npz", "/runs", False),
        ("/runs/%2e%2e/a.npz", "/runs", False),
        ("/runsaway/a.npz", "/runs", False),
        ("http://evil/runs/a.npz", "http://host/runs", False),
        ("http://host/runs/a.npz", "http://host/runs/", True),
        ("bucket/x/a.npz", "bucket/*/a.npz", True),
        ("other/x/a.npz", "bucket/*/a.npz", False),
        ("/runs/a\n.npz", "/runs", False),
        ("/runs/a::file:///etc/x.npz", "/runs", False),
        ("/runs/file://etc/x.npz", "/runs", False),
        ("http://host/runs/http://evil/a.npz", "http://host/runs", False),
        ("/a.npz", "/", True),
        ("/a.npz", "/*.npz", True),
    ],
)
def test_a_listing_names_what_is_in_it(name, folder, below):
    assert is_below(name, folder) is below


def test_a_hostile_listing_is_refused_and_an_ftp_listing_keeps_its_host(monkeypatch, tmp_path):

    class Server(fsspec.AbstractFileSystem):
        protocol = "ftp"
        names = ("/runs/day/a.npz", "/runs/b.npz")

        @classmethod
        def _strip_protocol(cls, path):
            return "/" + path.partition("://")[2].partition("/")[2].strip("/") if "://" in path else path

        @staticmethod
        def _get_kwargs_from_urls(path):
            return {}

        def isdir(self, path):
            return not path.endswith(".npz")

        def find(self, path, **_):
            return list(self.names)

    fsspec.register_implementation("ftp", Server, clobber=True)
    monkeypatch.chdir(tmp_path)
    tasks = find_logs(["ftp://me@127.0.0.1/runs"], "out", ".npz")
    assert [task.log for task in tasks] == ["ftp://me@127.0.0.1/runs/b.npz", "ftp://me@127.0.0.1/runs/day/a.npz"]
    assert [task.output for task in tasks] == ["b.npz", "day/a.npz"]
    monkeypatch.setattr(Server, "names", ("/a%20b/x.npz",))
    assert fetch.listed("ftp://127.0.0.1/a%20b") == ["ftp://127.0.0.1/a%20b/x.npz"]
    monkeypatch.setattr(Server, "names", ("/runs/../../x.npz",))
    with pytest.raises(LogError, match="which is not in it"):
        find_logs(["ftp://127.0.0.1/runs"], "out", ".npz")
