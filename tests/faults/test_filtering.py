"""Faults in a log that is filtered: the bias stays within its error bars, or the loss is reported; no value is NaN.

Every fault is put into one simulated log of two joints with a known bias, which is filtered from file to file.
"""

from typing import NamedTuple

import by_params
import numpy as np
import pytest
import two_joints
from two_joints import SETUP

from ftbias_jax.cli.main import main
from ftbias_jax.filtering.bias_filter import FORGET
from ftbias_jax.filtering.result import named_arrays
from ftbias_jax.io.log import Log
from ftbias_jax.io.write import npz
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.setup import dump_setup, parse_setup
from ftbias_jax.types import Array

RATE, SECONDS = 200, 40
NOISE = np.array(SETUP["sensor"]["noise_std"])


class Simulated(NamedTuple):
    """A log as arrays, and the true bias."""

    log: dict
    bias: Array


@pytest.fixture(scope="module")
def simulated():
    return Simulated(*two_joints.simulated(SETUP, RATE, SECONDS))


@pytest.fixture
def filtered(simulated, tmp_path, capsys):
    """Filter the log with a fault; return the result and what was printed."""

    def run(fault, *options, setup=SETUP, code=0):
        log = {name: values.copy() for name, values in simulated.log.items()}
        log = fault(log) or log
        np.savez(tmp_path / "log.npz", **log)
        (tmp_path / "setup.toml").write_text(dump_setup(parse_setup(setup)))
        files = [tmp_path / "log.npz", "--setup", tmp_path / "setup.toml", "-o", tmp_path / "out.npz"]
        assert main(["filter", *map(str, files), "--precision", "double", *options]) == code
        printed = capsys.readouterr()
        result = npz.load_npz(tmp_path / "out.npz")
        for name in ("bias", "drift", "bias_std", "drift_std", "q", "dq", "ddq", "wrench_tool", "nis"):
            assert np.isfinite(result[name]).all(), name
        return result, printed.out + printed.err

    return run


def errors(result, simulated):
    """Errors of the bias in its own standard deviations, at the stamps of the result."""
    rows = np.minimum(np.searchsorted(simulated.log["t"], result["t"] - 1e-9), len(simulated.bias) - 1)
    return (result["bias"] - simulated.bias[rows]) / result["bias_std"]


def nothing(log):
    """Leave the log as it is."""


KEPT = np.sort(np.random.default_rng(0).permutation(RATE * SECONDS)[: int(0.7 * RATE * SECONDS)])
HARMLESS = {
    "nothing": nothing,
    "no velocities": lambda log: log["dq"].fill(np.nan),
    "positions that are NaN": lambda log: log["q"][1500:1700, 0].fill(np.nan),
    "random drops": lambda log: {name: values[KEPT] for name, values in log.items()},
}


@pytest.mark.parametrize("what", HARMLESS)
def test_faults_that_cost_no_accuracy(filtered, simulated, what):
    result, told = filtered(HARMLESS[what])
    assert len(result["t"]) == (len(KEPT) if what == "random drops" else RATE * SECONDS)
    assert np.abs(errors(result, simulated)).max() < 5
    assert what != "nothing" or not ("warning: " in told or "ftbias: " in told)


def test_nan_in_one_axis(filtered, simulated):
    result, _ = filtered(lambda log: log["wrench"][1000:3000, 2].fill(np.nan))
    assert np.abs(errors(result, simulated)).max() < 5
    std = result["bias_std"]
    assert std[2999, 2] > 1.5 * std[2999, 1]  # only this axis has become uncertain
    assert np.isnan(result["wrench_unbiased"][1000:3000, 2]).all()


def test_a_block_of_nan_for_ten_seconds(filtered, simulated):
    def fault(log):
        for name in ("q", "dq", "wrench"):
            log[name][2000:4000] = np.nan

    result, _ = filtered(fault)
    assert len(result["t"]) == RATE * (SECONDS - 10)
    assert np.abs(errors(result, simulated)).max() < 5


def test_held_readings_of_wrench_and_joints_are_used_once(filtered, simulated):
    """Readings are repeated four times: error bars are those of the readings, and the joints show no false motion."""
    place = np.arange(RATE * SECONDS)

    def fault(log):
        return {name: values if name == "t" else values[place - place % 4] for name, values in log.items()}

    result, told = filtered(fault)
    assert len(result["t"]) == RATE * SECONDS / 4
    assert "the wrench is held for up to 4 samples, 6000 of 8000 repeat: each reading is used once" in told
    for which in ("joints", "velocities"):
        assert f"the {which} are held for up to 4 samples, 6000 of 8000 repeat: each reading is used once" in told
    assert np.abs(errors(result, simulated)).max() < 5
    once, _ = filtered(lambda log: {name: values[place % 4 == 0] for name, values in log.items()})
    np.testing.assert_allclose(result["bias_std"][-1], once["bias_std"][-1], rtol=0.02)
    np.testing.assert_allclose(result["ddq"][100:-100], once["ddq"][100:-100], atol=0.05)


def test_a_gap_of_an_hour(filtered, simulated):
    """The bias may have changed by what its process allows, and is found again."""
    moved = np.repeat([3.0, 0.1], 3)

    def fault(log):
        log["t"][4000:] += 3600
        log["wrench"][4000:] += moved

    result, _ = filtered(fault)
    assert (result["bias_std"][4000] > 10 * result["bias_std"][3999]).all()  # one sample has little information
    late = (result["bias"][4000:] - simulated.bias[4000:] + moved) / result["bias_std"][4000:]
    assert np.abs(late).max() < 5


def test_a_saturated_axis_is_left_out_and_does_not_pull_the_bias(filtered, simulated):
    limit = np.quantile(simulated.log["wrench"][:, 0], 0.8)

    def fault(log):
        log["wrench"][:, 0] = np.minimum(log["wrench"][:, 0], limit)

    result, told = filtered(fault, code=3)
    count = (simulated.log["wrench"][:, 0] >= limit).sum()
    assert f"samples at the end of the sensor's range left out: {count} of fx" in told
    error = errors(result, simulated)
    # The remaining samples near the limit have lost the upper half of their noise, which may bias them slightly.
    assert np.abs(error[:, 0]).max() < 8
    assert np.abs(error[:, 1:]).max() < 5
    params = params_from_setup(parse_setup(SETUP))
    log = {**simulated.log, "wrench": simulated.log["wrench"].copy()}
    fault(log)
    unmasked = by_params.filter_with_params(params, Log(**log, temperature=np.full(len(log["t"]), np.nan)))
    assert np.abs(errors(named_arrays(unmasked), simulated)[:, 0]).max() > 20


def spikes(log):
    """Add contacts of 5 to 50 N and 0.02 to 0.5 s, one-sided, about one in two seconds, and single spikes."""
    rng = np.random.default_rng(3)
    for start in range(300, RATE * SECONDS - 200, 400):
        rows = slice(start, start + int(rng.uniform(0.02, 0.5) * RATE))
        push = rng.choice([-1, 1]) * rng.uniform(5, 50)
        log["wrench"][rows] += push * np.array([0.1, 0.2, 1.0, 0.02, 0.03, 0.001])
    log["wrench"][rng.integers(400, RATE * SECONDS, 40), 1] += 30


def test_contact_spikes_do_not_pull_the_bias_behind_the_gate(filtered, simulated):
    """The bias differs by less than one standard deviation from that of a log without the touched samples."""
    touched = {"wrench": simulated.log["wrench"].copy()}
    spikes(touched)
    touched = (touched["wrench"] != simulated.log["wrench"]).any(1)
    expected, _ = filtered(lambda log: log["wrench"].__setitem__(touched, np.nan), "--as-stated")
    gated, told = filtered(spikes, "--gate", "5", "--as-stated")
    assert (np.abs(gated["bias"][~touched] - expected["bias"]) / expected["bias_std"]).max() < 1
    assert np.abs(errors(gated, simulated)).max() < 5
    assert f"{touched.sum()} samples ({touched.mean():.2%}) were rejected by the gate: contact?" in told
    pulled, told = filtered(spikes, "--as-stated")
    assert (np.abs(pulled["bias"][~touched] - expected["bias"]) / expected["bias_std"]).max() > 20
    assert "samples are far off their prediction: contact? --gate 5 keeps them out" in told


def test_spikes_are_kept_out_without_being_asked(filtered, simulated):
    """The filter of recordings has a gate; the samples that it rejects are reported and marked."""
    expected, _ = filtered(nothing)
    result, told = filtered(spikes)
    assert "were rejected by the gate: contact?" in told
    untouched = result["used"]
    shifts = np.abs(result["bias"] - expected["bias"]) / expected["bias_std"]
    assert shifts[untouched].max() < 3
    assert np.abs(errors(result, simulated)).max() < 5


def test_a_gate_in_the_setup_is_the_gate_of_the_command(filtered):
    (one, _), (other, _) = (
        filtered(spikes, setup={**SETUP, "bias": {"gate": 5}}),
        filtered(spikes, "--gate", "5"),
    )
    np.testing.assert_array_equal(one["bias"], other["bias"])


def test_a_bias_that_jumps_opens_the_gate_again(filtered, simulated):
    """Only its duration distinguishes it from a contact: after a while the filter follows, and finds the bias again."""
    jump = np.repeat([1.0, 0.05], 3)

    def fault(log):
        log["wrench"][1000:] += jump

    result, _ = filtered(fault, "--gate", "5", "--as-stated")
    passed = 1000 + np.flatnonzero(np.isfinite(result["innovation"][1000:, 0]))[0]
    assert FORGET < (passed - 1000) / RATE < 3 * FORGET
    late = (result["bias"][passed:] - simulated.bias[passed:] + jump) / result["bias_std"][passed:]
    assert np.abs(late).max() < 6  # for a moment as far off as the gate is wide


def test_a_static_pose_names_what_it_does_not_tell(filtered, simulated):
    def fault(log):
        rest = np.random.default_rng(1).normal(size=log["q"].shape)
        log["q"], log["dq"] = 0.3 + 1e-5 * rest, 1e-4 * rest
        log["wrench"] = NOISE * np.random.default_rng(2).normal(size=log["wrench"].shape)

    _, told = filtered(fault)
    assert "the sensor turns too little: errors of the tool's mass and center_of_mass would look like bias" in told


def test_singular_priors_are_fine(filtered):
    """A state known exactly at the start is accepted; noise whose square underflows to zero gives a warning."""
    setup = {**SETUP, "bias": {"initial_drift_std": 0.0}, "joints": {**SETUP["joints"], "initial_std": [0.0, 0.0, 0.0]}}
    result, _ = filtered(nothing, setup=setup)
    assert (result["drift_std"][0] == 0).all()
    _, told = filtered(nothing, setup={**SETUP, "sensor": {"noise_std": 1e-200}}, code=3)
    assert "for any initial bias: do not trust the bias" in told
