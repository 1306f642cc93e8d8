import json
import sys
import tomllib
from types import ModuleType

import numpy as np
import pytest
import still_logs

from ftbias_jax.cli.main import main
from ftbias_jax.diagnosis.result import FoundTerm
from ftbias_jax.setup import load_setup

SETUP = f"""{still_logs.SETUP}
[effects.time_delay]
delay = 0.01
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A placeholder setup and log; caches stay in the folder."""
    (tmp_path / "setup.toml").write_text(SETUP)
    wrench = np.ones((still_logs.COUNT, 6))
    still_logs.write_log(tmp_path / "log.npz", wrench)
    wrench[:, 5] = np.nan
    still_logs.write_log(tmp_path / "lame.npz", wrench)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ftbias_jax.runtime.jax_config.prepare_jax", lambda: None)
    monkeypatch.setattr("ftbias_jax.commissioning.judged.objection", lambda setup, diagnosis, logs: "")
    return tmp_path


@pytest.fixture
def calls(make_diagnosis, monkeypatch):
    """Arguments of calls of ``diagnose``, which returns a made-up diagnosis."""
    kept = []

    def diagnose(setup, logs, names, without=(), unchecked=False, progress=str):
        kept.append((setup, logs, names, without))
        return make_diagnosis()._replace(logs=tuple(names), repairs=tuple(log.repairs for log in logs))

    module = ModuleType("ftbias_jax.diagnosis.diagnose")
    module.diagnose = diagnose
    monkeypatch.setitem(sys.modules, "ftbias_jax.diagnosis.diagnose", module)
    return kept


def test_it_prints_and_writes_what_was_asked_for(folder, calls, capsys):
    (folder / "again.npz").write_bytes((folder / "log.npz").read_bytes())
    command = "diagnose log.npz again.npz --setup setup.toml --without gain --without term"
    assert main([*command.split(), "--json", "out.json", "--html", "out.html", "--apply", "-o", "fixed.toml"]) == 0
    ((_, logs, names, without),) = calls
    assert len(logs) == 2
    assert names == ["log.npz", "again.npz"]
    assert without == ("gain", "term")
    out = capsys.readouterr().out
    assert out.startswith("explained: The tool weighs 0.81 kg.")
    assert out.endswith("wrote out.json, out.html, fixed.toml\n")
    assert json.loads((folder / "out.json").read_text())["schema"] == 2
    assert (folder / "out.html").read_text(encoding="utf-8").startswith("<!DOCTYPE html>")


def test_the_fixed_setup_has_the_old_effects_and_the_causes(folder, calls):
    assert main(["diagnose", "log.npz", "--setup", "setup.toml", "--apply", "-o", "fixed.toml"]) == 0
    text = (folder / "fixed.toml").read_text(encoding="utf-8")
    assert tomllib.loads(text)["effects"] == {"time_delay": {"delay": 0.01}, "tool_mass": {"mass": 0.8134}}
    assert "# ftbias diagnose: 0.8134 ± 0.0041 kg" in text
    assert load_setup("fixed.toml").tool.mass == 0.73


def test_what_changes_with_the_time_of_a_log_is_left_to_the_bias(folder, calls, make_diagnosis, monkeypatch, capsys):
    """In a longer log a parabola of time would reach hundreds of newtons."""
    section = {"drive": "time", "form": "quadratic", "frame": "sensor", "acts_as": "wrench", "coefficients": [0.1] * 12}
    term = FoundTerm(
        "time", "quadratic", "sensor", "wrench", "slow", *[{}] * 4, None, (), (), (), "", 1, 0.1, 0.9, section
    )
    found = make_diagnosis()
    made = found._replace(terms=(term,), logs=("log.npz",), repairs=((),))
    monkeypatch.setattr(sys.modules["ftbias_jax.diagnosis.diagnose"], "diagnose", lambda *_, **__: made)
    assert main(["diagnose", "log.npz", "--setup", "setup.toml", "--apply", "-o", "fixed.toml"]) == 0
    assert "not applied: what changes slowly with the time of a log" in capsys.readouterr().err
    assert set(tomllib.loads((folder / "fixed.toml").read_text())["effects"]) == {"time_delay", "tool_mass"}


def test_a_setup_that_predicts_worse_is_written_by_force_alone(folder, calls, monkeypatch, capsys):
    why = "the setup with what was found predicts these logs worse"
    monkeypatch.setattr("ftbias_jax.commissioning.judged.objection", lambda setup, diagnosis, logs: why)
    command = ["diagnose", "log.npz", "--setup", "setup.toml", "--json", "out.json", "--apply", "-o", "fixed.toml"]
    assert main(command) == 1
    assert f"ftbias: not applied: {why}; --force writes it all the same\n" in capsys.readouterr().err
    assert (folder / "out.json").exists()
    assert not (folder / "fixed.toml").exists()
    assert main([*command, "--force"]) == 0
    assert (folder / "fixed.toml").exists()


@pytest.mark.parametrize("other", [[], [("tool_mass", {"mass": 0.8})]], ids=["alone", "beside one that can be applied"])
def test_a_value_that_no_setup_can_state_costs_no_output(
    folder, calls, make_diagnosis, make_candidate, monkeypatch, capsys, other
):
    found = [("gain", {"gain": [-1.078] * 6}), *other]
    causes = tuple(make_candidate(name, parameters=values, stderr={}) for name, values in found)
    module = sys.modules["ftbias_jax.diagnosis.diagnose"]
    monkeypatch.setattr(module, "diagnose", lambda *given, **options: make_diagnosis(causes=causes, repairs=((),)))
    command = "diagnose log.npz --setup setup.toml --json out.json --html out.html --apply -o fixed.toml"
    assert main(command.split()) == 1
    printed = capsys.readouterr()
    assert printed.err.startswith("ftbias: not applied: effects.gain.gain: got [-1.078")
    assert "wrote out.json, out.html" in printed.out
    assert json.loads((folder / "out.json").read_text())["causes"][0]["parameters"] == {"gain": [-1.078] * 6}
    assert (folder / "out.html").stat().st_size > 1000
    assert (folder / "fixed.toml").exists() == bool(other)
    if other:
        assert load_setup("fixed.toml").effects.keys() == {"time_delay", "tool_mass"}


def test_without_outputs_nothing_is_written(folder, calls, capsys):
    before = set(folder.iterdir())
    assert main(["diagnose", "log.npz", "--setup", "setup.toml"]) == 0
    assert set(folder.iterdir()) == before
    assert "wrote" not in capsys.readouterr().out


def test_an_axis_that_was_never_measured_is_told(folder, calls, capsys):
    assert main(["diagnose", "log.npz", "lame.npz", "--setup", "setup.toml"]) == 3
    assert capsys.readouterr().err == "warning: lame.npz: never measured: tz\n"


@pytest.mark.parametrize(
    ("options", "code", "words"),
    [
        ("--apply", 2, "--apply: needs the name of the setup to write (add -o FIXED.toml, or --in-place"),
        ("-o fixed.toml", 2, "--output: is the setup that --apply writes (add --apply; the diagnosis itself is"),
        ("--apply -o fixed.json", 2, "end the name in .toml"),
        ("--json out.html", 2, "--json: cannot write 'out.html' (end the name in .json)"),
        ("--html out", 2, "--html: cannot write 'out' (end the name in .html)"),
        ("--html missing/out.html", 1, "missing/out.html: the folder does not exist"),
        ("--without tool_mas", 2, "--without: unknown effect 'tool_mas' (did you mean 'tool_mass'?)"),
    ],
)
def test_what_cannot_be_done_is_refused_before_the_work(folder, calls, capsys, options, code, words):
    assert main(["diagnose", "log.npz", "--setup", "setup.toml", *options.split()]) == code
    assert words in capsys.readouterr().err
    assert calls == []
