"""Whole logs in and out: chunks, merged timelines, summaries, and the recorded logs with their known truth."""

import json
from dataclasses import replace

import by_params
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from stated import YAW_PITCH_ROLL

from ftbias_jax.filtering import params_for_log, pipeline, smoother
from ftbias_jax.filtering.fast import stages
from ftbias_jax.filtering.fast.scan import filter_scan
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.process_models import drift_noise
from ftbias_jax.filtering.quality import summary as summaries
from ftbias_jax.filtering.result import Filtered, named_arrays
from ftbias_jax.filtering.samples import FORGOTTEN, samples_from_log
from ftbias_jax.filtering.smoother import smooth_track
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.setup import load_setup, parse_setup

START = 100.0
OPTIONS = [Options(), Options(uncertain_joints=False), Options(gate=40.0)]


@pytest.fixture(scope="module")
def log(samples):
    """The log of 40 samples, as if read from a file."""
    t = np.cumsum(samples.dt)
    return Log(t, *map(np.asarray, samples[1:4]), np.full(len(t), np.nan), START)


def rows_of(tree, rows):
    return jax.tree.map(lambda x: x[rows], tree)


def assert_same(got, expected, rtol=1e-9):
    for name, other in named_arrays(expected).items():
        one = getattr(got, name)
        np.testing.assert_allclose(one, other, rtol=rtol, atol=rtol * np.nanmax(np.abs(other)), err_msg=name)


@pytest.fixture(scope="module", params=OPTIONS, ids=["diagonal", "none", "gated"])
def whole(request, params, samples):
    """Options, and state and info of every sample from one run over the whole log."""
    return request.param, pipeline.run(
        params, pipeline.init(params, samples), samples, request.param, pipeline.keep_all
    )[1]


def test_a_result_is_one_run_at_the_stamps_of_the_wrench(params, log, whole):
    options, (states, infos) = whole
    got = by_params.filter_with_params(params, log, options)
    rows = np.isfinite(log.wrench).any(1)
    std = np.sqrt(np.diagonal(states.bias.covariance, axis1=1, axis2=2))[rows]
    bias, wrench = states.bias.mean[rows], infos.wrench
    joint = states.joint.mean[rows]
    expected = Filtered(
        t=log.t[rows] + START,
        bias=bias[:, :6],
        drift=bias[:, 6:],
        bias_std=std[:, :6],
        drift_std=std[:, 6:],
        wrench_unbiased=log.wrench[rows] + bias[:, :6],
        q=joint[:, :, 0],
        dq=joint[:, :, 1],
        ddq=joint[:, :, 2],
        ddq_std=np.sqrt(states.joint.covariance[rows][:, :, 2, 2]),
        wrench_tool=infos.wrench_tool[rows],
        innovation=wrench.value[rows],
        nis=wrench.nis[rows],
        log_likelihood=infos.log_likelihood.sum(),
        innovation_std=np.sqrt(np.diagonal(wrench.covariance, axis1=1, axis2=2))[rows],
    )
    assert 0 < rows.sum() < len(log.t)
    assert_same(got, expected)


def test_the_past_does_not_depend_on_the_future(params, log):
    """It does not depend on the length to which the log is padded, either."""
    part = by_params.filter_with_params(params, Log(*rows_of(log[:5], slice(35)), START))
    whole = by_params.filter_with_params(params, log)
    kept = by_params.part_of(whole, slice(len(part.t)))
    assert_same(replace(part, log_likelihood=kept.log_likelihood), kept, rtol=1e-13)


def test_samples_without_measurements_change_nothing(params, log):
    """Such samples occur in a merged timeline, where another stream has a stamp."""
    before = np.arange(1, 21)
    stamps = (log.t[before] + log.t[before - 1]) / 2
    more = Log(*(np.insert(x, before, np.nan, axis=0) for x in log[:5]), START)
    more = more._replace(t=np.insert(log.t, before, stamps))
    assert_same(by_params.filter_with_params(params, more), by_params.filter_with_params(params, log), rtol=1e-6)


def test_a_saturated_sample_is_not_used(params, log):
    limits = np.full(6, 1e3)
    limits[2] = np.nanquantile(np.abs(log.wrench[:, 2]), 0.8)
    clipped = log._replace(wrench=np.clip(log.wrench, -limits, limits))
    used = params_for_log.without_useless(clipped, params._replace(effects={"saturation": {"limits": limits}})).wrench
    np.testing.assert_array_equal(used, np.where(np.abs(clipped.wrench) == limits, np.nan, log.wrench))
    assert np.isnan(used).sum() > np.isnan(log.wrench).sum()


def test_a_fit_uses_what_is_left_once_a_lag_is_forgotten(params, log):
    used = params_for_log.useful_samples(log, params._replace(effects={"low_pass": {"cutoff": 20.0}})).wrench
    early = log.t - log.t[0] < -np.log(FORGOTTEN) / (2 * np.pi * 20.0)
    assert early.any()
    np.testing.assert_array_equal(used, np.where(early[:, None], np.nan, log.wrench))
    np.testing.assert_array_equal(params_for_log.useful_samples(log, params).wrench, log.wrench)


@pytest.mark.slow
def test_smoothing_is_that_of_the_samples_that_passed_the_gate(params, samples, log):
    options = Options(gate=40.0)
    _, states, infos = by_params.found_in(params, log, options, ("smooth_joints", "filter_bias", "smooth_bias"))
    used = samples._replace(wrench=jnp.where(jnp.isfinite(infos.innovation[:40]), samples.wrench, jnp.nan))
    assert (np.isnan(used.wrench) != np.isnan(samples.wrench)).any()
    start = pipeline.init(params, used)
    joints = smoother.smooth_joint_tracks(params, start, used, options)
    inputs = stages.bias_inputs(params, start, used, *stages.predict_wrenches(params, joints, used, options))
    smoothed = smooth_track(drift_noise, inputs, filter_scan(drift_noise, inputs))
    std = np.sqrt(np.diagonal(smoothed.covariance, axis1=1, axis2=2).swapaxes(1, 2))
    np.testing.assert_allclose(states.bias_smooth[:40], smoothed.mean, rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(states.bias_smooth_std[:40], std, rtol=1e-6)


def csv_text(log, names, order):
    """The log with its columns in a given order; missing values are empty cells."""
    header = ["t", *(f"{what}_{name}" for what in ("position", "velocity") for name in names)]
    header += ["fx", "fy", "fz", "tx", "ty", "tz"]
    values = np.concatenate([log.t[:, None], log.q, log.dq, log.wrench], 1)[:, order]
    lines = [[header[i] for i in order], *([repr(float(x)).replace("nan", "") for x in row] for row in values)]
    return "\n".join(map(",".join, lines))


@given(order=st.permutations(range(13)), names=st.permutations(["base", "elbow", "wrist"]))
def test_permuting_the_names_and_columns_of_the_joints_changes_nothing(tmp_path_factory, log, order, names):
    """The filter gets bitwise the same numbers."""
    joints = [{**joint, "name": name} for joint, name in zip(YAW_PITCH_ROLL["robot"]["joints"], names, strict=True)]
    setup = parse_setup({**YAW_PITCH_ROLL, "robot": {**YAW_PITCH_ROLL["robot"], "joints": joints}})
    path = tmp_path_factory.mktemp("csv") / "log.csv"
    path.write_text(csv_text(log, names, order))
    read = read_log(path, setup)
    for name in ("t", "q", "dq", "wrench"):
        np.testing.assert_array_equal(getattr(read, name), getattr(log, name))


def test_a_stated_density_is_kept_to_smooth_and_guarded_to_filter(samples):
    setup = parse_setup({**YAW_PITCH_ROLL, "joints": {**YAW_PITCH_ROLL["joints"], "process_noise_density": [1, 2, 3]}})
    np.testing.assert_array_equal(params_for_log.max_likelihood_params(setup, samples).joint.process_density, [1, 2, 3])
    guarded = params_for_log.params_for_log(setup, samples).joint.process_density
    np.testing.assert_array_equal(guarded, params_for_log.LAG_GUARD * np.array([1, 2, 3]))


def filtered(path):
    setup = load_setup(path.with_suffix(".toml"))
    log = read_log(path, setup)
    params = params_for_log.params_for_log(setup, samples_from_log(log))
    return log, params, by_params.filter_with_params(params, log)


@pytest.mark.slow
def test_logs_of_foreign_physics_without_a_gap(shared_data):
    """Errors are within three of the filter's sigmas, and far below those of a tare in the first second."""
    truth = json.loads((shared_data / "gap_dev" / "truth.json").read_text())
    inside, better = [], []
    for name in (name for name, facts in truth.items() if "none" in facts["effects"]):
        log, _, result = filtered(shared_data / "gap_dev" / f"{name}.npz")
        bias = np.array(truth[name]["bias_1hz"])
        rows = np.minimum(np.searchsorted(log.t, np.arange(len(bias))), len(log.t) - 1)
        error = result.bias[rows] - bias
        inside.append(np.abs(error) < 3 * result.bias_std[rows])
        tare = (result.wrench_tool - log.wrench)[log.t < 1].mean(0)
        better.append(np.abs(tare - bias[-1]) / np.abs(error[-1]))
    assert len(inside) == 6
    assert np.mean(inside) >= 0.99
    assert np.median(better) >= 5


@pytest.mark.slow
def test_a_recorded_arm(shared_data):
    """ABB FRIDA: residual of the wrench, and its prediction one second ahead."""
    _, params, result = filtered(shared_data / "real" / "abb_frida.npz")
    summary = summaries.finish(summaries.add(summaries.start(), result, params.bias))
    assert (summary.residual_std[:3] <= 0.09).all()
    assert (summary.residual_std[3:] <= 3.2e-3).all()
    assert (summary.raw_std[:3] / summary.one_second_rms[:3] >= 8).all()
