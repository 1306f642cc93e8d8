import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from small_archive import SETUP

from ftbias_jax.cli.main import main
from ftbias_jax.io.write.npz import load_npz
from ftbias_jax.model.effects.catalogue import CATALOGUE, typical_values
from ftbias_jax.model.effects.types import Model
from ftbias_jax.model.simulate import simulate, temperature_course
from ftbias_jax.model.trajectories import excitation_sines, working_range
from ftbias_jax.model.wrench.tool_wrench import measurement_covariance
from ftbias_jax.setup import parse_setup
from ftbias_jax.setup.robots import BUILT_IN

T = jnp.arange(500) / 100


@pytest.fixture(scope="module")
def trajectory(params):
    return excitation_sines(jax.random.key(1), T, jnp.zeros(3), jnp.array([1.5, 0.3, 1.5]), base_frequency=0.2)


@pytest.fixture(scope="module")
def model(params):
    return Model(params.arm, params.gravity, params.theta)


def test_the_log_is_tool_minus_bias_plus_noise(params, trajectory):
    log = simulate(jax.random.key(2), params, trajectory)
    noise = np.asarray(log.wrench - log.wrench_tool + log.bias)
    bias = params.bias
    R = measurement_covariance(params.theta, bias.data_variance, bias.wrench_variance)  # including Sigma_D
    std = np.sqrt(np.diagonal(R))
    np.testing.assert_allclose(noise.std(0), std, rtol=0.15)
    np.testing.assert_allclose(noise.mean(0), 0, atol=4 * std.max() / np.sqrt(len(T)))
    np.testing.assert_array_equal(log.wrench_clean, log.wrench_tool)


def test_noise_that_params_say_grows_is_in_the_log_once(params, trajectory):
    variance = jnp.full((3, 6), 0.5)
    shaking = params._replace(bias=params.bias._replace(vibration=variance))
    log = simulate(jax.random.key(2), shaking, trajectory)
    noise = np.asarray(log.wrench - log.wrench_tool + log.bias)
    expected = np.asarray(params.bias.wrench_variance) + np.asarray(trajectory.dq) ** 2 @ np.asarray(variance)
    np.testing.assert_allclose((noise**2 / expected).mean(0), 1, atol=5 * np.sqrt(2 / len(T)))
    named = simulate(jax.random.key(2), shaking, trajectory, {"vibration": {"variance": variance}})
    np.testing.assert_allclose(named.wrench, log.wrench, rtol=1e-12, atol=1e-12)
    bent = shaking._replace(bias=shaking.bias._replace(vibration_speed=jnp.asarray(0.2)))
    less = simulate(jax.random.key(2), bent, trajectory).wrench
    also = {"vibration": {"variance": variance, "speed": jnp.asarray(0.2)}}
    same = simulate(jax.random.key(2), params, trajectory, also).wrench
    np.testing.assert_allclose(same, less, rtol=1e-12, atol=1e-12)
    assert not np.array_equal(less, log.wrench)


def test_the_same_key_gives_the_same_log(params, trajectory):
    first, again = (simulate(jax.random.key(2), params, trajectory) for _ in range(2))
    other = simulate(jax.random.key(3), params, trajectory)
    jax.tree.map(np.testing.assert_array_equal, first, again)
    assert not np.array_equal(first.wrench, other.wrench)


def test_effects_change_the_reading_and_nothing_that_is_drawn(params, trajectory, model):
    plain = simulate(jax.random.key(2), params, trajectory)
    names = ("tool_mass", "bias_jump", "temperature_drift", "quantisation")
    effects = {name: typical_values(CATALOGUE[name], model) for name in names}
    log = simulate(jax.random.key(2), params, trajectory, effects, temperature_course(T))
    np.testing.assert_array_equal(log.q, plain.q)
    np.testing.assert_allclose(log.wrench_tool, plain.wrench_tool, rtol=1e-12, atol=1e-12)
    step = effects["quantisation"]["step"]
    moved = log.wrench_clean - plain.wrench_clean
    assert (jnp.abs(log.wrench - plain.wrench - moved) <= step[None] / 2 + 1e-9).all()
    # The bias of effects is part of the true bias, in the report's sign.
    no_bias = {name: effects[name] for name in ("tool_mass",)}
    tool_only = simulate(jax.random.key(2), params, trajectory, no_bias)
    np.testing.assert_allclose(log.bias - plain.bias, tool_only.wrench_clean - log.wrench_clean, atol=1e-9)


def test_simulation_maps_over_seeds_and_parameters(params, trajectory):
    keys = jax.random.split(jax.random.key(4), 3)
    masses = jnp.array([0.8, 0.9, 1.0])

    def one(key, mass):
        return simulate(key, params, trajectory, {"tool_mass": {"mass": mass}})

    many = jax.vmap(one)(keys, masses)
    for i in range(3):
        for of_many, of_one in zip(many, one(keys[i], masses[i]), strict=True):
            np.testing.assert_allclose(of_many[i], of_one, atol=1e-12)


def test_simulation_keeps_single_precision(params, trajectory):
    single = jax.tree.map(lambda x: x.astype(jnp.float32), (params, trajectory))
    log = simulate(jax.random.key(2), *single)
    assert all(x.dtype == jnp.float32 for x in log)
    assert all(jnp.isfinite(x).all() for x in log)


@pytest.mark.parametrize("robot", BUILT_IN)
def test_simulated_motion_stays_within_the_limits_of_the_arm(robot):
    tool = {"mass": 0.9, "center_of_mass": [0.0, 0.0, 0.06]}
    setup = parse_setup({"robot": {"model": robot}, "sensor": {"noise_std": 0.1}, "tool": tool})
    center, excursion = working_range(setup)
    assert (excursion > 0.1).all()
    if setup.robot.position_limits is None:
        return
    assert (center - excursion >= setup.robot.position_limits[:, 0] - 1e-12).all()
    assert (center + excursion <= setup.robot.position_limits[:, 1] + 1e-12).all()


# The command line.


@pytest.fixture
def setup_file(tmp_path):
    path = tmp_path / "setup.toml"
    path.write_text(SETUP)
    return path


def command(setup_file, *arguments):
    log = setup_file.parent / "log.npz"
    return main(
        ["simulate", "--setup", str(setup_file), "--duration", "2", "--rate", "100", "-o", str(log), *arguments]
    )


def test_the_command_writes_log_and_truth(setup_file, capsys):
    warming = "temperature_drift:per_kelvin=0.1/0.2/0.3/0.01/0.02/0.03"
    assert command(setup_file, "--effect", "tool_mass:mass=0.8", "--effect", warming) == 0
    log, truth = load_npz(setup_file.parent / "log.npz"), load_npz(setup_file.parent / "log_truth.npz")
    assert set(log) == {"t", "q", "dq", "wrench", "temperature", "about", "provenance"}
    assert log["q"].shape == (200, 2)
    assert truth["effects.tool_mass.mass"] == 0.8
    warmer = log["temperature"] - log["temperature"][0]
    assert warmer.max() > 5
    # The temperature drift is in both, the clean reading and the true bias.
    process = truth["bias"] - np.outer(warmer, truth["effects.temperature_drift.per_kelvin"])
    noise = log["wrench"] - truth["wrench_clean"] + process
    np.testing.assert_allclose(noise.std(0), [0.1] * 3 + [0.004] * 3, rtol=0.2)
    assert "effects: temperature_drift, tool_mass" in capsys.readouterr().out


def test_the_command_replays_a_log_and_summarises_the_truth(setup_file):
    assert command(setup_file, "--motion", "moves") == 0
    folder = setup_file.parent
    again = ["--setup", str(setup_file), "-o", str(folder / "again.npz"), "--truth", str(folder / "truth.json")]
    assert main(["simulate", *again, "--motion", str(folder / "log.npz"), "--effect", "time_delay"]) == 0
    first, second = load_npz(folder / "log.npz"), load_npz(folder / "again.npz")
    np.testing.assert_allclose(second["q"], first["q"], atol=3e-4)
    truth = json.loads((folder / "truth.json").read_text())
    assert truth["effects"] == {"time_delay": {"delay": 0.01}}
    assert len(truth["bias_1hz"]) == 2


def test_effects_of_the_setup_are_in_the_log_and_the_sensors_sign_is_kept(setup_file):
    assert command(setup_file) == 0
    plain = load_npz(setup_file.parent / "log.npz")
    setup_file.write_text(
        SETUP.replace("[tool]", 'reports = "wrench_on_sensor"\n[tool]') + "[effects.gain]\ngain = 1.5\n"
    )
    assert command(setup_file) == 0
    log, truth = load_npz(setup_file.parent / "log.npz"), load_npz(setup_file.parent / "log_truth.npz")
    np.testing.assert_allclose(-log["wrench"] - plain["wrench"], truth["wrench_tool"] / 2, atol=1e-9)


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ("tool_mass:mass=x", "cannot read 'mass=x'"),
        ("tool_mass:mass", "cannot read 'mass'"),
        ("bias_jump:time=1", "bias_jump.amplitude: missing key"),
        ("contact:start=1,end=2/3,force=1/2/3", "different numbers of events"),
    ],
)
def test_wrong_effects_are_one_line_and_exit_code_2(setup_file, capsys, effect, message):
    assert command(setup_file, "--effect", effect) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (setup_file.parent / "log.npz").exists()
