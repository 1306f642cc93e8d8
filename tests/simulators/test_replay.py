from dataclasses import replace

import mujoco
import numpy as np
import pytest
from made_scenes import SCENE, TOML, reading_of_mujoco, write

from ftbias_jax.diagnosis.problem import make_problem
from ftbias_jax.diagnosis.regression import fit as fits
from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.compose import EXTRA_WRENCH
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.mjcf import load_mjcf
from ftbias_jax.simulators.mend_mjcf import mend_mjcf
from ftbias_jax.simulators.replay import MODEL, against, against_columns, joint_states, read_against, replay
from ftbias_jax.simulators.validate import validate

CABLE = {"stiffness": 30.0, "rest_length": 0.1, "anchor": [0.3, 0.1, 0.9], "attachment": [0.0, 0.0, 0.05]}


@pytest.fixture(scope="module")
def cell(tmp_path_factory):
    """Folder, setup, and a log of the scene's own robot."""
    folder = tmp_path_factory.mktemp("cell")
    setup = load_setup(write(folder)[1])
    return folder, setup, simulate(setup, {}, duration=12, rate=200, seed=1)


def scene_with(cell, name, **effects):
    """The scene with effects added to it."""
    folder, setup, _ = cell
    scene = load_mjcf(folder / "scene.xml")
    (text,) = mend_mjcf(replace(setup, effects=effects), scene, str(folder / name)).files.values()
    (folder / name).write_text(text)
    return load_mjcf(folder / name)


def true_states(made):
    return np.stack([made.truth.q, made.truth.dq, made.truth.ddq], 2)


def test_a_replay_is_what_the_sensors_of_mujoco_read(cell):
    folder, setup, made = cell
    states = true_states(made)[:50]
    scene = scene_with(cell, "cable.xml", cable=CABLE)
    model = mujoco.MjModel.from_xml_path(str(folder / "cable.xml"))
    expected = reading_of_mujoco(model, setup.robot.joint_names, *np.moveaxis(states, 2, 0))
    scene.model.opt.disableflags = model.opt.disableflags
    np.testing.assert_allclose(replay(scene, made.log.t[:50], states), expected, atol=1e-9)


def test_what_hangs_on_springs_begins_at_rest_and_swings_as_in_a_forward_simulation(tmp_path):
    """The arm accelerates upwards by g until the log begins, and then stops: the tool starts from twice its sag."""
    text = """<mujoco><option timestep="0.0005"/><worldbody><body name="arm"><joint name="arm" type="slide"/>
      <geom size="0.1"/><body name="mount" pos="0.3 0 0"><site name="s"/><geom size="0.02" mass="0.2"/>
      <body name="tool"><joint axis="0 1 0" stiffness="40" damping="0.02"/><geom size="0.03" pos="0.1 0 0" mass="0.5"/>
      </body></body></body></worldbody><sensor><force site="s"/><torque site="s"/></sensor></mujoco>"""
    (tmp_path / "arm.xml").write_text(text)
    (tmp_path / "held.xml").write_text(text.replace('<joint name="arm" type="slide"/>', ""))
    t = np.arange(2000) * 0.0005
    states = np.zeros((len(t), 1, 3))
    at_rest = replay(load_mjcf(tmp_path / "arm.xml"), t, states)
    assert np.ptp(at_rest, axis=0).max() < 1e-9
    states[0, 0, 2] = 9.81
    replayed = replay(load_mjcf(tmp_path / "arm.xml"), t, states)
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "held.xml"))
    data, expected = mujoco.MjData(model), []
    model.opt.gravity[2], model.dof_damping[0] = -2 * 9.81, 1.0
    mujoco.mj_step(model, data, 10000)
    model.opt.gravity[2], model.dof_damping[0] = -9.81, 0.02
    for _ in t:
        mujoco.mj_step(model, data)
        expected.append(np.array(data.sensordata))
    swing = np.ptp(np.array(expected)[:, 2])
    assert swing > 3
    assert np.abs(replayed - expected)[1:, 2].max() < 0.03 * swing


def test_a_log_against_its_own_simulator_has_no_gap(cell):
    _, setup, made = cell
    scene = scene_with(cell, "cable.xml", cable=CABLE)
    real = replay(scene, made.log.t, true_states(made)) + made.log.wrench - made.truth.wrench_tool
    log = made.log._replace(wrench=real)
    beside = against(setup, log, log.t, replay(scene, log.t, joint_states(setup, log)))
    alone, both = (fits.base(make_problem(setup, [one])[0]).error for one in (log, beside))
    assert (alone**2).mean() > 20
    assert abs((both**2).mean() - 1) < 0.1


def test_the_gap_of_a_scene_shrinks_when_it_is_mended(cell):
    folder, setup, made = cell
    effects = {"tool_mass": {"mass": 0.62}, "gain": {"gain": [1.03, 1.03, 1.03, 1.0, 1.0, 1.0]}}
    # What the files cannot express is not in the corrected simulator, and so not counted.
    term = {"drive": "time", "form": "linear", "frame": "sensor", "acts_as": "wrench", "coefficients": [9.0] * 6}
    mended = replace(setup, effects={**effects, "term": [term]})
    scene = scene_with(cell, "mended.xml", **effects)
    wrench = replay(scene, made.log.t, true_states(made)) * effects["gain"]["gain"]
    log = made.log._replace(wrench=wrench + made.log.wrench - made.truth.wrench_tool)
    found = validate(setup, mended, [log], (load_mjcf(folder / "scene.xml"), scene))
    assert found.before.rms[2] > 20 * found.after.rms[2]
    assert found.shrink > 0.9
    assert found.shrink_stderr < 0.1
    assert "fz N" in str(found)
    assert str(found).endswith(", without term, which the files cannot express")
    assert found.plain()["after"]["rms"] == found.after.rms.tolist()


def test_a_file_has_the_stamps_of_the_log_or_its_seconds_and_its_sign(cell, tmp_path):
    _, setup, made = cell
    setup = replace(setup, sensor=replace(setup.sensor, reports="wrench_on_sensor"))
    wrench = np.cumsum(np.ones_like(made.truth.wrench_tool), 0)
    log = made.log._replace(start=1e9)
    for t in (log.t, log.t + 1e9):
        np.savez(tmp_path / "sim.npz", t=t, wrench_model=-wrench)
        beside = read_against(tmp_path / "sim.npz", setup, log)
        expected = against(setup, log, log.t, wrench)
        np.testing.assert_allclose(beside.columns["beyond_fz"].values, expected.columns["beyond_fz"].values, atol=1e-3)


def test_a_log_may_bring_the_wrench_of_its_simulator_in_columns_of_its_own(cell, tmp_path):
    folder, _, made = cell
    columns = {name: name.removeprefix("wrench_model_") for name in MODEL}
    text = "\n".join(f'{name} = "sim_{axis}"' for name, axis in columns.items())
    (folder / "columns.toml").write_text(f"{TOML}reports = 'wrench_on_sensor'\n[log.columns]\n{text}\n")
    setup, wrench = load_setup(folder / "columns.toml"), np.cumsum(np.ones_like(made.log.wrench), 0)
    arrays = {f"sim_{axis}": -wrench[:, k] for k, axis in enumerate(columns.values())}
    np.savez(tmp_path / "log.npz", t=made.log.t, q=made.log.q, wrench=made.log.wrench, **arrays)
    log = read_log(tmp_path / "log.npz", setup)
    beside, expected = against_columns(setup, log), against(setup, log, log.t, wrench)
    for name in EXTRA_WRENCH:
        np.testing.assert_allclose(beside.columns[name].values, expected.columns[name].values, atol=1e-6)
    assert against_columns(setup, made.log) is made.log
    some = {name: column for name, column in log.columns.items() if name != "wrench_model_tz"}
    with pytest.raises(LogError, match=r"wrench_model: has 5 of six columns.*wrench_model_fx"):
        against_columns(setup, log._replace(columns=some))


@pytest.mark.parametrize(
    ("t", "wrench", "words"),
    [
        (np.arange(3.0), np.zeros((3, 6)), "lasts from 0 s to 2 s"),
        (np.arange(30.0), np.zeros((30, 5)), "has shape"),
        (np.arange(30.0), np.full((30, 6), np.nan), "NaN"),
    ],
)
def test_a_wrench_that_is_of_another_log_is_refused(cell, t, wrench, words):
    _, setup, made = cell
    with pytest.raises(LogError, match=words):
        against(setup, made.log, t, wrench)


def test_a_file_without_the_wrench_and_a_scene_with_other_joints_are_refused(cell, tmp_path):
    _, setup, made = cell
    np.savez(tmp_path / "sim.npz", t=made.log.t)
    with pytest.raises(LogError, match="wrench_model: is not there"):
        read_against(tmp_path / "sim.npz", setup, made.log)
    (tmp_path / "scene.xml").write_text(SCENE)
    write(tmp_path)
    with pytest.raises(SetupError, match="has 6 joints before the sensor, the log 7"):
        replay(load_mjcf(tmp_path / "scene.xml", base="link1"), made.log.t, true_states(made))
    assert isinstance(made.log, Log)
