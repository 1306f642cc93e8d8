"""The command ``check``, and what the other commands do with a wrong setup."""

import json
import tomllib

import numpy as np
import pytest
import small_checks

import ftbias_jax as ft
from ftbias_jax.cli.main import main
from ftbias_jax.setup import dump_setup


@pytest.fixture
def files(tmp_path):
    """Write a log and a setup, each possibly changed; return the beginning of a command's arguments."""

    def write(change=lambda tables, arrays: None):
        tables, arrays = small_checks.right_log(duration=20.0, rate=50.0)
        tables["joints"]["process_noise_density"] = 5.0
        change(tables, arrays)
        np.savez(tmp_path / "log.npz", **arrays)
        (tmp_path / "setup.toml").write_text(dump_setup(ft.parse_setup(tables)))
        return [str(tmp_path / "log.npz"), "--setup", str(tmp_path / "setup.toml")]

    return write


def other_sign(tables, arrays):
    tables["sensor"]["reports"] = "wrench_on_sensor"


def torque_in_newton_millimetres(tables, arrays):
    arrays["wrench"] = arrays["wrench"] * np.repeat([1.0, 1e3], 3)


def test_a_right_setup_is_ok(files, capsys):
    assert main(["check", *files()]) == 0
    assert capsys.readouterr().out.startswith("no mistake found (rms raw ")


def test_a_wrong_one_is_told_and_written(files, tmp_path, capsys):
    arguments = files(other_sign)
    assert main(["check", *arguments, "--json", str(tmp_path / "out.json")]) == 1
    assert "sign: the sensor reports the wrench on tool: set sensor.reports" in capsys.readouterr().out
    content = json.loads((tmp_path / "out.json").read_text())
    assert [finding["mistake"] for finding in content["findings"]] == ["sign"]
    mended = tomllib.loads((tmp_path / "setup.toml").read_text())
    (finding,) = content["findings"]
    for key, value in finding["setup"].items():
        section, name = key.split(".")
        mended[section][name] = value
    (tmp_path / "setup.toml").write_text(dump_setup(ft.parse_setup(mended)))
    assert main(["check", *arguments]) == 0


@pytest.mark.parametrize("stamps", [False, True], ids=["without time", "with time"])
def test_a_table_of_static_poses_is_checked(stamps, tmp_path, capsys):
    tables, arrays = small_checks.static_poses(count=20)
    arrays |= {"t": np.cumsum(np.random.default_rng(0).uniform(4, 60, 20))} if stamps else {}
    np.savez(tmp_path / "poses.npz", **arrays)
    (tmp_path / "setup.toml").write_text(dump_setup(ft.parse_setup(tables)))
    arguments = [str(tmp_path / "poses.npz"), "--setup", str(tmp_path / "setup.toml")]
    assert main(["check", *arguments]) == 0
    np.savez(tmp_path / "poses.npz", **{**arrays, "q": np.degrees(arrays["q"])})
    assert main(["check", *arguments, "--json", str(tmp_path / "out.json")]) == 1
    assert 'set log.angle_unit = "deg"' in capsys.readouterr().out
    content = json.loads((tmp_path / "out.json").read_text())
    assert content["findings"][0]["mistake"] == "angle_units"
    assert main(["check", *arguments, "-o", str(tmp_path / "each")]) == 1
    assert json.loads((tmp_path / "each" / "poses.check.json").read_text())["ok"] is False


@pytest.mark.parametrize("command", ["tune", "identify", "diagnose"])
def test_a_command_that_would_explain_a_mistake_refuses(files, tmp_path, capsys, command):
    more = ["--json", str(tmp_path / "out.json")] if command == "diagnose" else ["-o", str(tmp_path / "out.toml")]
    assert main([command, *files(other_sign), *more]) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    told = [line for line in printed.err.splitlines() if not line.startswith("diagnosing ")]  # progress, if slow
    assert len(told) == 1
    assert (
        "setup.toml: sign: the sensor reports the opposite sign, and the model makes the reading worse" in printed.err
    )
    assert "--unchecked goes on anyway" in printed.err
    assert not list(tmp_path.glob("out.*"))


def test_filter_says_so_first_and_exits_with_3_where_it_makes_things_worse(files, tmp_path, capsys):
    arguments = [*files(other_sign), "-o", str(tmp_path / "out.npz")]
    assert main(["filter", *arguments]) == 3
    assert "log.npz: with this setup the corrected wrench is worse than the raw one: sign: " in capsys.readouterr().err
    assert main(["filter", *files(torque_in_newton_millimetres), "-o", str(tmp_path / "out.npz")]) == 0
    assert "log.npz: the setup seems wrong: wrench_units: " in capsys.readouterr().err
    assert main(["filter", *files(), "-o", str(tmp_path / "out.npz")]) == 0
    assert "wrong" not in capsys.readouterr().err


def test_a_compensated_reading_is_bias_and_contact(files, tmp_path):
    """What the controller has subtracted is not subtracted again, and no tool is sought in the remainder."""

    def without_tool(tables, arrays):
        noise = np.random.default_rng(0).normal(size=arrays["wrench"].shape)
        arrays["wrench"] = noise * [0.1, 0.1, 0.1, 4e-3, 4e-3, 4e-3] - small_checks.BIAS
        tables["sensor"]["compensated"] = True

    arguments = files(without_tool)
    setup = ft.load_setup(arguments[2])
    assert setup.sensor.compensated == "tool"
    result = ft.filter_log(setup, ft.read_log(arguments[0], setup))
    assert not result.wrench_tool.any()
    assert result.warnings == ()
    np.testing.assert_allclose(result.bias[-1], small_checks.BIAS, atol=0.05)
    assert main(["identify", *arguments, "-o", str(tmp_path / "out.toml")]) == 2


def test_a_sensor_zeroed_with_a_heavy_tool_starts_at_its_weight(files):
    def zeroed(tables, arrays):
        tables["tool"]["mass"] = 8.0
        tables["sensor"]["rezeroed"] = True
        tables["bias"] = {"initial_std": 0.5}
        weight = arrays["wrench"][:1] + small_checks.BIAS
        arrays["wrench"] = 10 * (arrays["wrench"] + small_checks.BIAS - weight)

    arguments = files(zeroed)
    setup = ft.load_setup(arguments[2])
    log = ft.read_log(arguments[0], setup)
    result = ft.filter_log(setup, log, unchecked=True)
    np.testing.assert_allclose(result.bias[0], result.wrench_tool[0], atol=2.5)
    assert np.linalg.norm(result.bias[0, :3]) == pytest.approx(8 * 9.81, rel=0.1)


def at_rest(tables, arrays):
    arrays["q"] = np.tile(arrays["q"][:1], (len(arrays["t"]), 1))
    arrays["wrench"] = arrays["wrench"][:1] + 0.01 * np.random.default_rng(0).normal(size=arrays["wrench"].shape)
    arrays.pop("dq", None)


def test_a_log_at_rest_is_said_to_show_nothing(files, tmp_path, capsys):
    assert main(["check", *files(at_rest)]) == 0
    told = capsys.readouterr().err
    assert "at rest: only bias and noise can be estimated" in told
    _, *setup = files(at_rest)
    assert main(["check", str(tmp_path / "*.npz"), *setup]) == 0  # a pattern is replaced by its logs
    assert "log.npz: at rest" in capsys.readouterr().err
    assert main(["check", *files()]) == 0
    assert "at rest" not in capsys.readouterr().err
