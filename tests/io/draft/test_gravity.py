import made_weights as made
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from ftbias_jax.cli.main import main
from ftbias_jax.io.draft.conventions import likely_gravity
from ftbias_jax.io.draft.evidence import tool_keys, weigh
from ftbias_jax.io.pose import arm_rotations
from ftbias_jax.setup import load_setup, parse_setup

SETUP = parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": [0.1, 0.004]}})


def weighed(t, q, wrench):
    return weigh(t, arm_rotations(SETUP.robot, SETUP.sensor, q), SETUP.robot.gravity, wrench)


def test_the_sensor_is_turned_as_matrix_exponentials_say():
    _, q, _ = made.arm_log(samples=5)
    ours = arm_rotations(SETUP.robot, SETUP.sensor, q)
    np.testing.assert_allclose(ours, made.rotations(SETUP.robot, q), atol=1e-12)


def test_a_tool_is_weighed_by_turning_it():
    found = weighed(*made.arm_log())
    assert abs(found.mass - made.MASS) < 3 * found.mass_stderr < 0.1
    np.testing.assert_allclose(found.center_of_mass, made.CENTER, atol=2e-3)
    assert found.residual == pytest.approx(0.05 * np.sqrt(3), rel=0.1)
    assert found.credible


def test_contact_is_left_out_and_a_sensor_of_the_opposite_sign_shows_a_negative_mass():
    t, q, wrench = made.arm_log(sign=-1.0)
    wrench[100:160, 2] += 40.0
    found = weighed(t, q, wrench)
    assert abs(found.mass + made.MASS) < 0.02
    np.testing.assert_allclose(found.center_of_mass, made.CENTER, atol=2e-3)


def test_a_sensor_that_is_never_turned_shows_nothing():
    t, q, wrench = made.arm_log()
    assert weighed(t, np.zeros_like(q), wrench) is None
    assert weighed(t[:5], q[:5], wrench[:5]) is None


def test_a_weight_that_is_missing_or_overcompensated_is_absent_and_a_light_tool_is_not():
    t, q, wrench = made.arm_log(samples=3000)
    weight = made.readings(made.rotations(SETUP.robot, q), noise=0.0) + made.BIAS
    for subtracted, absent in ((0.0, False), (0.95, False), (1.0, True), (1.05, True), (2.0, False)):
        found = weighed(t, q, wrench - subtracted * weight)
        assert found.absent == absent, subtracted
        np.testing.assert_allclose(found.mass, (1 - subtracted) * made.MASS, atol=0.02)
    lighter_than_the_noise = weighed(t, q, 5 * np.random.default_rng(1).normal(size=wrench.shape))
    assert not lighter_than_the_noise.absent
    assert not lighter_than_the_noise.credible
    assert np.degrees(found.turn) > 30


def test_a_sensor_set_to_zero_on_the_way_weighs_as_before():
    t, q, wrench = made.arm_log(samples=1000)
    wrench[600:] += [20, -10, 5, 1, 0, 2]
    turned = arm_rotations(SETUP.robot, SETUP.sensor, q)
    found = weigh(t, turned, SETUP.robot.gravity, wrench, [t[600]])
    assert abs(found.mass - made.MASS) < 3 * found.mass_stderr < 0.1
    np.testing.assert_allclose(found.center_of_mass, made.CENTER, atol=2e-3)


@pytest.mark.parametrize(("factor", "unit"), [(1.0, ""), (100.0, '"Ncm"'), (1000.0, '"Nmm"')])
def test_a_centre_of_mass_that_no_tool_has_shows_another_unit_of_the_torque(factor, unit):
    t, q, wrench = made.arm_log()
    keys, notes = tool_keys(weighed(t, q, wrench * np.repeat([1.0, factor], 3)), is_stated=False)
    assert ("tool.center_of_mass" in keys) == (not unit)
    assert ("state log.torque_unit" in notes[-1]) == bool(unit)
    assert unit in notes[-1]


def test_an_hour_of_motion_is_no_series_of_static_poses():
    """Every seventh of the samples is used, 0.7 s apart; the information is nevertheless that of one per second."""
    t = np.arange(36000) * 0.1
    rng, turned = np.random.default_rng(4), Rotation.from_euler("xyz", np.sin(np.outer(t, [0.11, 0.07, 0.05])) * 1.2)
    weight = -turned.inv().apply(np.array(SETUP.robot.gravity))
    wrench = np.hstack([0.9 * weight, np.zeros((36000, 3))]) + 0.1 * rng.normal(size=(36000, 6))
    whole, few = (weigh(t[::step], turned.as_matrix()[::step], SETUP.robot.gravity, wrench[::step]) for step in (1, 8))
    assert few.mass_stderr == pytest.approx(np.sqrt(3600 / 4500) * whole.mass_stderr, rel=0.05)


@pytest.mark.parametrize("gravity", [[0.0, 9.81, 0.0], [0.0, -4.905, -8.496], [0.0, 0.0, -9.81]])
def test_a_base_on_a_wall_or_a_slope_is_drafted_with_its_gravity(tmp_path, capsys, gravity):
    """Otherwise a constant bias that turns with a wrench in base axes would stand for the weight."""
    rng, down = np.random.default_rng(1), np.array(gravity)
    turns = Rotation.random(24, random_state=2)
    weight = -1.35 * turns.inv().apply(down)
    torque = np.cross([0.012, -0.008, 0.071], weight)
    wrench = np.column_stack([weight, torque]) + [3.1, -5.2, 8.4, 0.12, -0.33, 0.08] + rng.normal(size=(24, 6)) * 0.02
    header = "qx,qy,qz,qw,fx,fy,fz,tx,ty,tz"
    np.savetxt(
        tmp_path / "poses.csv", np.column_stack([turns.as_quat(), wrench]), "%.9g", ",", header=header, comments=""
    )
    assert main(["setup", str(tmp_path / "poses.csv"), "-o", str(tmp_path / "setup.toml")]) == 0
    setup = load_setup(tmp_path / "setup.toml", with_tool=True)
    np.testing.assert_allclose(setup.robot.gravity, down, atol=0.05)
    assert setup.tool.mass == pytest.approx(1.35, abs=0.02)
    assert setup.sensor.reports == "wrench_on_tool"
    assert ("the base is not level" in capsys.readouterr().out) == (gravity[2] != -9.81)


def test_gravity_has_no_direction_where_the_sensor_turns_about_one_axis():
    turns = Rotation.from_rotvec(np.linspace(0, 3, 50)[:, None] * [0.0, 0.0, 1.0]).as_matrix()
    assert likely_gravity(turns, np.ones((50, 6))) is None
