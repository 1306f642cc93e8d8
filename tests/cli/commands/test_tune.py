"""Assignment of logs to tools, before anything is computed."""

import pytest
import small_archive

from ftbias_jax.cli.commands.tune import _tools
from ftbias_jax.cli.main import build_parser, main


def tools_of(line):
    return _tools(build_parser().parse_args(["tune", *line.split()]))


@pytest.mark.parametrize(
    ("line", "tools"),
    [
        ("a.npz b.npz --setup s.toml -o o.toml", [("s.toml", ["a.npz", "b.npz"])]),
        ("--setup s.toml a.npz b.npz -o o.toml", [("s.toml", ["a.npz", "b.npz"])]),
        ("a.npz --setup s.toml b.npz -o o.toml", [("s.toml", ["a.npz", "b.npz"])]),
        ("--setup s.toml a.npz --setup t.toml b.npz c.npz", [("s.toml", ["a.npz"]), ("t.toml", ["b.npz", "c.npz"])]),
    ],
)
def test_logs_stand_after_the_setup_of_their_tool(line, tools):
    assert tools_of(line) == tools


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("--setup setup.toml -o out.toml", "LOG: 'setup.toml' has no log"),
        ("log.npz --setup setup.toml log.npz --setup other.toml log.npz", "before the first of several --setup"),
        ("--setup setup.toml log.npz --setup other.toml log.npz -o out.toml", "--output: 1 outputs for 2 setups"),
        ("--setup setup.toml log.npz --setup other.toml log.npz -o out.toml -o out.toml", "out.toml"),
    ],
)
def test_mistakes_are_refused(tmp_path, monkeypatch, capsys, line, words):
    monkeypatch.chdir(tmp_path)
    small_archive.write_log(tmp_path / "log.npz")
    for name in ("setup.toml", "other.toml"):
        (tmp_path / name).write_text(small_archive.SETUP)
    assert main(["tune", *line.split()]) == 2
    assert words in capsys.readouterr().err
