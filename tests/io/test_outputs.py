"""No output is an input or another output, under whatever name."""

import os

import pytest

from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.io.outputs import check_outputs, check_writable, output_of_setup


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """A log under many names, in the current folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "log.npz").write_bytes(b"a log")
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"a bag")
    os.symlink("log.npz", "soft.npz")
    os.link("log.npz", "hard.npz")
    os.symlink(".", "here")
    os.symlink("not_there.npz", "dangling.npz")
    return tmp_path


@pytest.mark.parametrize("name", ["log.npz", "./log.npz", "bag/../log.npz", "soft.npz", "hard.npz", "here/log.npz"])
def test_an_output_that_is_an_input_is_refused_and_both_are_named(name):
    with pytest.raises(UsageError, match=rf"--plot: '{name}' is the same file as the input 'log.npz' \(give"):
        check_outputs({"--output": "out.npz", "--plot": name}, ["setup.toml", "log.npz"])


@pytest.mark.parametrize("name", ["new.npz", "here/new.npz", "bag/../new.npz"])
def test_two_outputs_that_do_not_exist_yet_are_compared_by_where_they_would_be(name):
    with pytest.raises(UsageError, match=rf"--json: '{name}' is the same file as 'new.npz' of --html"):
        check_outputs({"--html": "new.npz", "--json": name}, [])


def test_a_link_to_nothing_is_the_file_it_would_make():
    with pytest.raises(UsageError, match=r"'not_there.npz' is the same file as 'dangling.npz' of one"):
        check_outputs({"one": "dangling.npz", "two": "not_there.npz"}, [])


def test_a_folder_stands_for_the_files_in_it():
    with pytest.raises(UsageError, match=r"bag_0.mcap' is the same file as the input 'bag/bag_0.mcap'"):
        check_outputs({"--output": "here/bag/bag_0.mcap"}, ["bag"])
    check_outputs({"--output": "bag/bag_1.mcap"}, ["bag"])


def test_outputs_of_their_own_pass_and_what_was_not_asked_for_is_nothing():
    check_outputs({"--output": "out.npz", "--plot": None, "--offsets": None}, ["log.npz", "", None])


def test_what_cannot_be_written_is_refused():
    check_writable("out.npz", ".npz")
    with pytest.raises(UsageError, match=r"--json: cannot write 'out.txt' \(end the name in .json\)"):
        check_writable("out.txt", ".json", "--json")
    with pytest.raises(OutputError, match=r"nowhere/out.npz: the folder does not exist"):
        check_writable("nowhere/out.npz", ".npz")


def test_a_setup_is_replaced_on_request_only(folder):
    setup = folder / "setup.toml"
    setup.write_text("")
    os.link(setup, "same.toml")
    assert output_of_setup("out.toml", "setup.toml", False) == "out.toml"
    for output in (None, "setup.toml", "same.toml", str(setup)):
        assert output_of_setup(output, "setup.toml", True) == (output or "setup.toml")
    for output, in_place, words in (
        (None, False, "needs the name of the setup to write"),
        ("same.toml", False, "'same.toml' is the same file as the input 'setup.toml'.*--in-place"),
        ("out.toml", True, "--in-place: replaces 'setup.toml', but -o names 'out.toml'"),
    ):
        with pytest.raises(UsageError, match=words):
            output_of_setup(output, "setup.toml", in_place)
