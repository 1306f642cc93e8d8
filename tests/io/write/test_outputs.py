"""Outputs that the commands refuse; cli/test_outputs.py tests that none is an input or another output."""

import os

import pytest

from ftbias_jax.errors import OutputError, UsageError
from ftbias_jax.io.write.outputs import check_outputs, check_writable, output_of_setup


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """The current folder with files and links."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "bag_0.mcap").write_bytes(b"a bag")
    return tmp_path


def test_a_folder_stands_for_the_files_in_it():
    with pytest.raises(UsageError, match=r"bag_0.mcap' is the same file as the input 'bag/bag_0.mcap'"):
        check_outputs({"--output": "./bag/bag_0.mcap"}, ["bag"])
    check_outputs({"--output": "bag/bag_1.mcap"}, ["bag"])


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
