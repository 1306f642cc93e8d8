"""What a Python user types: every verb on a tiny log, in a process where JAX computes in float32."""

import re
import subprocess
import sys
import tomllib
from dataclasses import replace

import by_params
import jax
import numpy as np
import pytest
import small_archive

import ftbias_jax as ft
from ftbias_jax.calibration.tune_setup import FIT
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.result import named_arrays
from ftbias_jax.filtering.samples import samples_from_log
from ftbias_jax.runtime import jax_config

HEAVIER = 0.84
"""kg; the setup says 0.7."""


@pytest.fixture(scope="module")
def setup():
    return ft.parse_setup(tomllib.loads(small_archive.SETUP), "setup.toml")


@pytest.fixture(scope="module", autouse=True)
def single():
    """JAX as users have it."""
    with jax.enable_x64(False):
        yield


@pytest.fixture(scope="module")
def made(setup, single):
    return ft.simulate(setup, {"tool_mass": {"mass": HEAVIER}}, duration=4, rate=50, seed=1)


@pytest.fixture(scope="module")
def result(setup, made):
    return ft.filter_log(setup, made.log, smooth=True)


def test_all_names_are_listed_and_are_there():
    verbs = {"load_setup", "read_log", "filter_log", "tune", "identify_tool", "simulate", "diagnose"}
    assert verbs | {"log_likelihood"} <= set(dir(ft))
    assert set(dir(ft)) == {*ft.__all__, "__version__"}
    for name in ft.__all__:
        found = getattr(ft, name)
        assert name.isupper() or found.__name__ == name
    with pytest.raises(AttributeError, match="no attribute 'filtre_log'"):
        ft.filtre_log  # noqa: B018


def test_a_simulation_has_a_log_and_its_truth(setup, made, tmp_path):
    assert str(made) == "200 samples, 4.0 s, effects: tool_mass"
    assert made.log.wrench.shape == made.truth.bias.shape == (200, 6)
    assert made.truth.effects["tool_mass"]["mass"] == HEAVIER
    weight = np.linalg.norm(made.truth.wrench_clean[:, :3], axis=1).mean()
    assert abs(weight / 9.81 - HEAVIER) < 0.05
    made.save(tmp_path / "log.npz", tmp_path / "truth.json")
    log = ft.read_log(tmp_path / "log.npz", setup)
    np.testing.assert_array_equal(log.wrench, made.log.wrench)
    assert (tmp_path / "truth.json").read_text().startswith("{")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"effects": {"tool_mas": {}}}, "effects: tool_mas: unknown effect 'tool_mas' (did you mean 'tool_mass'?)"),
        ({"effects": {"tool_mass": {"mass": -1}}}, "effects: tool_mass.mass: got -1"),
        ({"motion": "walk"}, "motion: got 'walk'"),
        ({"duration": 0}, "duration: must be a positive number, not 0"),
    ],
)
def test_what_cannot_be_simulated_is_said(setup, arguments, words):
    with pytest.raises(ft.UsageError) as caught:
        ft.simulate(setup, **arguments)
    assert str(caught.value).startswith(words)


def test_a_result_has_the_numbers_of_the_filter_in_double_precision(setup, made):
    result = ft.filter_log(setup, made.log, smooth=True, as_stated=True)
    with jax.enable_x64(True):
        params = params_for_log.params_for_log(setup, samples_from_log(made.log))
        expected = by_params.filter_with_params(params, made.log)
    for name, values in named_arrays(expected).items():
        np.testing.assert_allclose(getattr(result, name), values, rtol=1e-12, atol=1e-12, err_msg=name)
    assert result.bias.dtype == np.float64
    assert jax.numpy.ones(1).dtype == np.float32
    assert (result.bias_smooth_std <= result.bias_std * (1 + 1e-9)).all()


def test_a_result_is_printed_and_saved_as_the_command_does(result, tmp_path):
    assert str(result).startswith("200 wrench samples, 4.0 s\n")
    assert "joint process noise (integrated_jerk): 5 5" in str(result)
    assert result.check().nis.value == pytest.approx(result.summary.mean_nis)
    result.save(tmp_path / "out.npz")
    saved = np.load(tmp_path / "out.npz")
    assert {"t", "bias", "wrench_unbiased", "nis", "log_likelihood", "bias_smooth_std"} <= set(saved.files)
    assert not {"start", "params", "summary"} & set(saved.files)
    assert (saved["t"].dtype, saved["bias"].dtype) == (np.float64, np.float32)
    result.save(tmp_path / "few.npz", fields="bias", precision="double", every=4)
    few = np.load(tmp_path / "few.npz")
    assert {*few.files} == {"t", "bias", "about", "provenance"}
    np.testing.assert_array_equal(few["bias"], result.bias[::4])
    with pytest.raises(ft.UsageError, match=r"fields: there is no field 'wrench'"):
        result.save(tmp_path / "few.npz", fields=["wrench"])
    with pytest.raises(ft.UsageError, match="seconds: -1 s"):
        result.forecast(-1)
    result.save(tmp_path / "out.csv")
    assert (tmp_path / "out.csv").read_text().startswith("t,bias_fx,")
    with pytest.raises(ft.UsageError, match=r"end the name in .npz"):
        result.save(tmp_path / "out.txt")


def test_the_tool_is_identified_and_written_with_its_errors(setup, made, tmp_path):
    found = ft.identify_tool(setup, made.log)
    assert "\nbias at the end: " in str(found)
    warm = replace(found, setup=replace(setup, effects={"warmup": {}}))
    assert "\nbias at the end, without the setup's warmup: " in str(warm)
    assert abs(found.setup.tool.mass - HEAVIER) < 4 * found.tool.stderr[0]
    assert found.converged
    assert "mass " in str(found)
    found.setup.save(tmp_path / "found.toml")
    assert "identified ±" in (tmp_path / "found.toml").read_text(encoding="utf-8")
    assert ft.load_setup(tmp_path / "found.toml").tool.mass == found.setup.tool.mass


def test_the_noise_is_tuned_judged_and_written_with_its_errors(setup, made, tmp_path):
    """The log has the noise that the setup states, so the fitted joint noise stays near it."""
    tuned = ft.tune(setup, [made.log], fit=["joints"], restarts=0, hold_out=0.5)
    assert tuned.converged
    np.testing.assert_allclose(tuned.setup.joints.position_noise_std, setup.joints.position_noise_std, rtol=0.3)
    assert [score.part for score in tuned.held_out] == ["joint", "wrench"]
    assert "held-out joint score" in str(tuned)
    tuned.save(tmp_path / "tuned.toml")
    assert "tuned, relative standard errors" in (tmp_path / "tuned.toml").read_text(encoding="utf-8")


@pytest.mark.slow
def test_logs_of_two_tools_tell_the_noise_of_the_sensor_from_that_of_the_motion(setup, made, tmp_path):
    """Joints, bias, sensor and Sigma_D in one run; both setups get the same noise and keep their tools."""
    heavy = replace(setup, tool=replace(setup.tool, mass=3.0, center_of_mass=np.array([0.1, -0.1, 0.2])))
    noise = {"data_noise": {"linear_acceleration": 0.1}}
    noise = ft.parse_setup({**tomllib.loads(small_archive.SETUP), **noise}).data_noise
    other = ft.simulate(replace(heavy, data_noise=noise), {}, duration=4, rate=50, seed=2)
    first = ft.simulate(replace(setup, data_noise=noise), {}, duration=4, rate=50, seed=3)
    tuned = ft.tune(setup, [first.log], fit=FIT, tie="pair", others=[(heavy, [other.log])], restarts=0, hold_out=0.4)
    (also,) = tuned.others
    assert set(tuned.fits) == {"joints", "wrench"}
    assert also.tool.mass == 3.0
    np.testing.assert_array_equal(also.data_noise.angular_velocity, tuned.setup.data_noise.angular_velocity)
    np.testing.assert_array_equal(also.sensor.noise_std, tuned.setup.sensor.noise_std)
    assert "data_noise.linear_acceleration only together with data_noise.gravity_direction" in str(tuned)
    form = r"determined: a - g: linear_acceleration\^2 \+ 96\.2 gravity_direction\^2 = s\^2, s = (\S+) ± (\S+) m/s\^2"
    found, stderr = map(float, re.search(form, str(tuned)).groups())
    assert abs(found - 0.1) < 3 * stderr < 0.03
    wrench = next(score for score in tuned.held_out if score.part == "wrench")
    assert wrench.after > wrench.before
    tuned.save(tmp_path / "tuned.toml")
    again = ft.load_setup(tmp_path / "tuned.toml")
    np.testing.assert_array_equal(again.data_noise.linear_acceleration, tuned.setup.data_noise.linear_acceleration)


@pytest.mark.parametrize(
    ("logs", "options", "words"),
    [
        (0, {}, "logs: there is no log"),
        (1, {"fit": ["joint"]}, "fit: cannot fit 'joint'"),
        (1, {"tie": "all"}, "tie: got 'all'"),
        (1, {"data_noise": "two"}, "data_noise: got 'two'"),
        (1, {"fit": ["data"], "total": max}, "fit: Sigma_D (data) can only be fitted in a single process"),
        (1, {"hold_out": 1.0}, "hold_out: got 1.0"),
    ],
)
def test_what_cannot_be_tuned_is_said(setup, made, logs, options, words):
    with pytest.raises(ft.UsageError) as caught:
        ft.tune(setup, [made.log] * logs, **options)
    assert str(caught.value).startswith(words)


def test_the_likelihood_is_a_differentiable_scalar_in_the_precision_of_the_user(setup, made):
    samples, params = ft.samples_from_log(made.log), ft.params_for_log(setup, made.log)
    assert params.theta.dtype == np.float32
    value, slope = jax.value_and_grad(lambda p: ft.log_likelihood(p, samples))(params)
    assert value.shape == ()
    assert value.dtype == np.float32
    assert slope.theta[0] > 0  # the tool is heavier than stated


def test_a_diagnosis_mends_the_setup_and_writes_its_report(setup, make_diagnosis, tmp_path):
    diagnosis = make_diagnosis(setup_name="setup.toml")
    assert str(diagnosis).startswith("explained: The tool weighs 0.81 kg.")
    fixed = diagnosis.apply(setup)
    assert fixed.effects == {"tool_mass": {"mass": 0.8134}}
    fixed.save(tmp_path / "fixed.toml")
    assert "# ftbias diagnose: 0.8134 ± 0.0041 kg" in (tmp_path / "fixed.toml").read_text(encoding="utf-8")
    diagnosis.to_html(tmp_path / "report.html")
    assert "Gap of log_0.npz with setup.toml" in (tmp_path / "report.html").read_text(encoding="utf-8")
    diagnosis.to_json(tmp_path / "report.json")
    assert '"verdict": "explained"' in (tmp_path / "report.json").read_text(encoding="utf-8")


ONE, MANY = ("filter_log", "identify_tool"), ("check_setup", "diagnose", "calibrate", "tune", "diagnose_pooled")
NO_LOGS = [(object(), "object"), ([None], "NoneType"), ({"t": np.zeros(9)}, "dict")]


@pytest.mark.parametrize("verb", [*ONE, *MANY])
def test_what_is_neither_setup_nor_log_nor_a_path_is_said(verb, setup):
    with pytest.raises(ft.UsageError, match=r"^setup: got dict \(give what ft.load_setup reads, or the path"):
        getattr(ft, verb)({}, ["log.npz"])
    for given, kind in NO_LOGS[2:] if verb == "filter_log" else NO_LOGS[0:1] if verb in ONE else NO_LOGS[1:]:
        with pytest.raises(ft.UsageError, match=f"^logs: got {kind} "):
            getattr(ft, verb)(setup, given)


def test_static_poses_are_no_log_of_motion(setup):
    poses = ft.Poses(np.arange(4.0), True, np.zeros((4, 2)), np.zeros((4, 6)))
    for verb in (ft.diagnose, ft.calibrate, ft.tune):
        with pytest.raises(ft.UsageError, match="identify_tool"):
            verb(setup, [poses])


def test_paths_stand_for_what_they_name(setup, made, tmp_path):
    (tmp_path / "setup.toml").write_text(small_archive.SETUP, encoding="utf-8")
    made.save(tmp_path / "log.npz")
    paths = tmp_path / "setup.toml", tmp_path / "log.npz"
    assert str(ft.check_setup(*paths)) == str(ft.check_setup(setup, [made.log]))
    assert str(ft.identify_tool(*paths)) == str(ft.identify_tool(setup, made.log))
    assert str(ft.filter_log(*paths, as_stated=True)) == str(ft.filter_log(setup, made.log, as_stated=True))
    assert str(ft.simulate(paths[0], duration=1)) == str(ft.simulate(setup, duration=1))


def test_what_cannot_be_diagnosed_is_said(setup, made):
    with pytest.raises(ft.UsageError, match="there is no log"):
        ft.diagnose(setup, [])
    with pytest.raises(ft.UsageError, match="did you mean 'tool_mass'"):
        ft.diagnose(setup, [made.log], without=["tool_mas"])


def test_verbs_keep_their_programs_unless_the_user_says_otherwise(monkeypatch):
    calls = []
    monkeypatch.setattr(jax_config, "keep_programs", lambda: calls.append("kept"))
    double = jax_config.in_float64(lambda: jax.numpy.ones(1).dtype)
    assert double() == np.float64
    assert jax.numpy.ones(1).dtype == np.float32
    assert calls == ["kept"]


def test_other_threads_have_the_precision_of_the_one_that_asked():
    from concurrent.futures import ThreadPoolExecutor

    def work():
        return jax.numpy.ones(1).dtype

    with ThreadPoolExecutor(1) as pool:  # threads that a test starts use the setting of all tests, float64
        assert pool.submit(work).result() == np.float64
        assert pool.submit(jax_config.same_precision(work)).result() == np.float32


def test_the_package_is_imported_at_once():
    program = "import time; a = time.process_time(); import ftbias_jax; print(time.process_time() - a)"
    seconds = [float(subprocess.check_output([sys.executable, "-c", program])) for _ in range(3)]
    assert min(seconds) < 0.05
