import json
import pathlib
import sys
from types import ModuleType

import numpy as np
import pytest
import still_logs
from made_judged import judged
from scipy.spatial.transform import Rotation

from ftbias_jax.cli.main import main
from ftbias_jax.commissioning.result import CALIBRATED, GIVEN, Calibrated, Step
from ftbias_jax.setup import load_setup


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """Arguments of calls of ``calibrate``, which returns a made-up result, in a folder with a setup and a log."""
    (tmp_path / "setup.toml").write_text(still_logs.SETUP)
    wrench = np.ones((still_logs.COUNT, 6))
    still_logs.write_log(tmp_path / "log.npz", wrench)
    kept = []

    def calibrate(setup, logs, names, **asked):
        kept.append((setup, logs, names, asked))
        held = judged(3.0)._replace(inside=np.full((2, 4_000, 6), np.nan))
        rows = {GIVEN: judged(2.0), CALIBRATED: judged(1.0), "constant bias": held}
        step = Step("causes", "cause: low_pass", True, "errors 50 +- 1 % smaller", ("low_pass",))
        return Calibrated(setup, (step,), rows, None, tuple(log.repairs for log in logs))

    module = ModuleType("ftbias_jax.commissioning.calibrate")
    module.calibrate = calibrate
    monkeypatch.setitem(sys.modules, "ftbias_jax.commissioning.calibrate", module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ftbias_jax.runtime.jax_config.prepare_jax", lambda: None)
    return kept


def test_it_prints_steps_and_errors_and_writes_what_was_asked_for(calls, capsys):
    command = "calibrate log.npz --setup setup.toml -o out.toml --html out.html --json out.json --bias --hold-out 0.4"
    assert main(command.split()) == 0
    ((_, logs, names, asked),) = calls
    assert len(logs) == 1
    assert names == ["log.npz"]
    assert (asked["bias"], asked["hold_out"], asked["unchecked"]) == (True, 0.4, False)
    told = capsys.readouterr().out
    assert "kept      cause: low_pass (errors 50 +- 1 % smaller)" in told
    assert "wrote out.toml, out.html, out.json" in told
    assert load_setup("out.toml").tool.mass == 0.73
    with open("out.json") as file:
        assert json.load(file)["kept"] == ["low_pass"]
    assert main(command.split()) == 0, "its own outputs are replaced"


def test_static_poses_are_calibrated_by_the_tool_alone(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    turned = Rotation.random(20, np.random.default_rng(1))
    weight = 9.81 * turned.inv().apply([0, 0, 1])
    wrench = np.hstack([0.8 * weight, np.cross([0.0, 0.01, 0.05], 0.8 * weight)]) + 0.5
    wrench += 0.01 * np.random.default_rng(2).normal(size=(20, 6))
    np.savez("poses.npz", orientation=turned.as_quat(), wrench=wrench)
    assert main(["calibrate", "poses.npz", "-o", "out.toml", "--html", "page.html", "--json", "out.json"]) == 0
    assert "20 static poses" in capsys.readouterr().out
    assert load_setup("out.toml").tool.mass == pytest.approx(0.8, abs=0.01)
    with open("out.json") as file:
        told = json.load(file)
    assert told["tool"]["mass"]["value"] == pytest.approx(0.8, abs=0.01)
    assert "Ixx" not in told["tool"], "poses at rest show no inertia"
    assert told["poses"]["poses"] == 20
    page = pathlib.Path("page.html").read_text()
    assert "The tool weighs 0.8" in page
    assert "mass = 0.8" in page


def test_without_a_setup_it_drafts_one(calls):
    assert main(["calibrate", "log.npz", "--robot", "panda", "-o", "out.toml"]) == 0
    ((setup, *_),) = calls
    assert setup.robot.model == "panda"


@pytest.mark.parametrize(
    ("command", "told"),
    [
        ("calibrate log.npz --setup setup.toml --robot panda -o out.toml", "states the robot"),
        ("calibrate log.npz --setup setup.toml -o setup.toml", "same file"),
        ("calibrate log.npz --setup setup.toml -o out.txt", ".toml"),
        ("calibrate log.npz --setup setup.toml", "--output"),
    ],
)
def test_what_cannot_be_meant_is_refused_before_anything_is_worked_out(calls, capsys, command, told):
    try:
        code = main(command.split())
    except SystemExit as stopped:
        code = stopped.code
    assert code == 2
    assert told in capsys.readouterr().err
    assert not calls
