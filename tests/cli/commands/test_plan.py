import json
import sys
from types import ModuleType

import numpy as np
import pytest
import still_logs

from ftbias_jax.cli.main import main
from ftbias_jax.planning.forecast import Cannot, Forecast
from ftbias_jax.planning.result import Options, Plan
from ftbias_jax.planning.shape import Motion


@pytest.fixture
def calls(tmp_path, monkeypatch):
    """Arguments of calls of ``plan``, which returns a made-up result, in a folder with a setup and a log."""
    (tmp_path / "setup.toml").write_text(still_logs.SETUP)
    still_logs.write_log(tmp_path / "log.npz", np.ones((still_logs.COUNT, 6)))
    kept = []

    def plan(setup, to_find, **asked):
        kept.append((to_find, asked))
        still = np.zeros((3, len(setup.robot.joint_names)))
        told = Forecast(("mass",), ("kg",), np.array([0.01]), None, None, {}, (Cannot("com_x", "because"),))
        options = Options(to_find, asked["duration"], asked["rate"], asked["margin"], asked["seed"])
        motion = Motion(np.arange(3.0), *[still] * 4)
        return Plan(
            setup,
            options,
            (),
            motion,
            still.T[:, :1],
            told,
            np.full((4, still.shape[1]), 0.5),
            ("jerk: any",),
            tuple(asked["logs"]),
        )

    module = ModuleType("ftbias_jax.planning.plan")
    module.plan = plan
    monkeypatch.setitem(sys.modules, "ftbias_jax.planning.plan", module)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("ftbias_jax.runtime.jax_config.prepare_jax", lambda: None)
    return kept


def test_it_prints_the_forecast_and_writes_what_was_asked_for(calls, capsys):
    command = (
        "plan --setup setup.toml --for gain --duration 9 --margin 0.2 --from log.npz -o motion.csv --json plan.json"
    )
    assert main(command.split()) == 0
    ((to_find, asked),) = calls
    assert (to_find, asked["duration"], asked["margin"], len(asked["logs"])) == ("gain", 9.0, 0.2, 1)
    told = capsys.readouterr().out
    for words in ("0.01  kg", "does not determine com_x: because", "position 50%", "assumed: jerk: any", "Not known"):
        assert words in told
    assert "wrote motion.csv, motion.csv-metadata.json, plan.json" in told
    with open("plan.json") as file:
        assert json.load(file)["expected_std"] == {"mass": 0.01}
    assert main(command.split()) == 0, "its own outputs are replaced"


def test_a_diagnosis_says_what_to_separate(calls):
    with open("found.json", "w") as file:
        json.dump({"causes": [{"effect": "tool_mass", "indistinguishable_from": ["gain"]}]}, file)
    assert main(["plan", "--setup", "setup.toml", "--diagnosis", "found.json", "-o", "motion.npz"]) == 0
    assert calls[0][0] == "tool_mass:gain"


def test_the_page_and_a_trajectory_are_written_if_asked_for(calls, capsys):
    command = "plan --setup setup.toml -o motion.csv --html plan.html --ros motion.yaml"
    assert main(command.split()) == 0
    assert "wrote motion.csv, motion.csv-metadata.json, plan.html, motion.yaml" in capsys.readouterr().out
    with open("motion.yaml") as file:
        assert "trajectory_msgs/msg/JointTrajectory" in file.readline()
    assert main(command.split()) == 0, "its own outputs are replaced"


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ("-o log.npz", 1),
        ("-o motion.txt", 2),
        ("-o motion.csv --json plan.txt", 2),
        ("-o motion.csv --ur motion.script", 2),
        ("-o motion.csv --diagnosis nowhere.json", 2),
        ("-o motion.csv --from nowhere.npz", 1),
    ],
)
def test_what_cannot_be_read_or_written_is_said_in_one_line(calls, capsys, more, code):
    assert main(["plan", "--setup", "setup.toml", *more.split()]) == code
    assert not calls
    assert capsys.readouterr().err.startswith("ftbias: ")
