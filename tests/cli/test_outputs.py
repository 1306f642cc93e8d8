"""Every command refuses an output that is an input or another output, before any work; nothing is changed."""

import os
import shlex

import pytest
from small_archive import SETUP, write_log

from ftbias_jax.cli.main import main

URDF = "robot.urdf"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    """Logs, a setup, and other names of them."""
    monkeypatch.chdir(tmp_path)
    write_log(tmp_path / "log.npz")
    write_log(tmp_path / "set" / "log_0.npz")
    (tmp_path / "setup.toml").write_text(SETUP)
    (tmp_path / "results").mkdir()
    (tmp_path / "demo").mkdir()
    os.link("log.npz", "hard.npz")
    os.symlink("log.npz", "soft.npz")
    os.symlink("../log.npz", "results/log.npz")
    os.link("setup.toml", "hard.toml")
    os.symlink("setup.toml", "soft.toml")
    os.link("setup.toml", "offsets.yaml")
    os.symlink("after.npz", "demo/before.npz")
    os.symlink("log.npz", "figure.png")
    os.symlink("out.npz", "out.png")
    return tmp_path


def contents(folder):
    return {path: path.read_bytes() for path in sorted(folder.rglob("*")) if path.is_file()}


CASES = [
    # filter of one log
    "filter log.npz -o log.npz",
    "filter log.npz -o soft.npz",
    "filter log.npz -o hard.npz",
    "filter soft.npz -o log.npz",
    "filter log.npz -o out.npz --plot figure.png",
    "filter log.npz -o out.npz --plot out.png",
    "filter log.npz -o out.npz --offsets setup.toml",
    "filter log.npz -o out.npz --offsets offsets.yaml",
    "filter log.npz -o o.csv --offsets o.csv",
    "filter log.npz -o o.csv --offsets ./o.csv",
    # filter of an archive
    "filter log.npz -o .",
    "filter log.npz -o ./",
    "filter hard.npz log.npz -o .",
    "filter '*.npz' -o .",
    "filter log.npz -o results",
    "filter set/log_0.npz -o set",
    # setups
    "tune log.npz -o setup.toml",
    "tune log.npz -o soft.toml",
    "tune log.npz -o hard.toml",
    "tune log.npz -o out.toml --in-place",
    "tune log.npz",
    "identify log.npz -o setup.toml",
    "identify log.npz -o soft.toml",
    "identify log.npz -o hard.toml",
    "identify log.npz -o out.toml --in-place",
    "identify log.npz",
    "diagnose log.npz --apply -o setup.toml",
    "diagnose log.npz --apply -o soft.toml",
    "diagnose log.npz --apply -o hard.toml",
    "diagnose log.npz --apply -o out.toml --in-place",
    "diagnose log.npz --apply",
    "diagnose log.npz --in-place",
    # reports
    "check log.npz --json log.npz",
    "diagnose log.npz --html x.html --json x.html",
    "diagnose log.npz --html log.npz",
    # simulated logs
    "simulate -o soft.npz --motion log.npz",
    "simulate -o log.npz --motion log.npz",
    "simulate -o new.npz --motion log.npz --truth log.npz",
    "simulate -o new.npz --motion log.npz --truth hard.npz",
    "simulate -o new.npz --truth new.npz",
    "simulate -o new.npz --truth ./new.npz",
]


@pytest.mark.parametrize("line", CASES)
def test_an_output_is_neither_an_input_nor_another_output(folder, capsys, line):
    before = contents(folder)
    assert main([*shlex.split(line), "--setup", "setup.toml"]) == 2
    assert capsys.readouterr().err.startswith("ftbias: ")
    assert contents(folder) == before


def test_a_demonstration_refuses_them_too(folder, capsys):
    before = contents(folder)
    assert main(["demo", "-o", "demo"]) == 2
    assert "is the same file as" in capsys.readouterr().err
    assert contents(folder) == before


def test_the_message_names_both(capsys):
    main(shlex.split("filter log.npz -o . --setup setup.toml"))
    expected = "ftbias: the result of 'log.npz': './log.npz' is the same file as the input 'log.npz' (give"
    assert capsys.readouterr().err.startswith(expected)


def test_a_demonstration_does_not_replace_a_recording(folder, capsys):
    before = contents(folder)
    assert main(["demo", "-o", "."]) == 1
    assert "holds setup.toml or log.npz, which are not those of a demonstration" in capsys.readouterr().err
    assert contents(folder) == before


def test_a_urdf_is_an_input_too(folder, capsys):
    (folder / URDF).write_text("""<robot name="r">
      <link name="base"/><link name="tip"/>
      <joint name="a" type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>
      <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>""")
    setup = """
[robot]
urdf = "robot.urdf"
base_link = "base"
tip_link = "tip"
[sensor]
noise_std = [0.1, 0.004]
[tool]
mass = 0.7
center_of_mass = [0, 0, 0.06]
"""
    (folder / "setup.toml").write_text(setup)
    line = f"filter log.npz --setup setup.toml -o out.npz --offsets ./{URDF}"
    assert main(shlex.split(line)) == 2
    assert f"is the same file as the input {URDF!r}" in capsys.readouterr().err
