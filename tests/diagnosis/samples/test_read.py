"""Logs simulated in this file, with one effect each; the model's error is known exactly."""

import numpy as np
import pytest

from ftbias_jax.diagnosis.samples.exact import find_gaps, find_lattice
from ftbias_jax.diagnosis.samples.read import inspect_samples
from ftbias_jax.diagnosis.samples.types import together
from ftbias_jax.diagnosis.thresholds import AROUND_CLIPPED
from ftbias_jax.io.log import Log
from ftbias_jax.model.motion_noise import MotionNoise

STATED = np.array([0.1, 0.1, 0.1, 0.004, 0.004, 0.004])
SIZE = np.array([5.0, 5.0, 5.0, 0.3, 0.3, 0.3])


def smooth_wrench(t, rng):
    frequency, phase = rng.uniform(0.1, 0.6, (4, 6)), rng.uniform(0, 6, (4, 6))
    return SIZE * np.sin(2 * np.pi * frequency * t[:, None, None] + phase).sum(1)


class Recording:
    def __init__(self, seed=0, rate=250.0, duration=20.0, stated_error=0.0):
        self.rng = np.random.default_rng(seed)
        self.t = np.arange(int(rate * duration)) / rate
        self.model = smooth_wrench(self.t, self.rng)
        self.noise = STATED * (1 + stated_error) * self.rng.normal(size=self.model.shape)
        at = 2 * np.pi * np.array([0.07, 0.11]) * self.t[:, None]
        self.speed = np.sin(at) * (np.cos(0.4 * at) > -0.5)  # with pauses

    def inspect(self, wrench=None, keep=slice(None), stated=None, touched=None):
        wrench = self.model + self.noise if wrench is None else wrench
        wrench = np.asarray(wrench, np.float32).astype(float)[keep]
        t, model = self.t[keep], self.model[keep]
        unknown = np.full((len(t), 2), np.nan)
        log = Log(t, unknown, unknown, wrench, unknown[:, 0])
        rate = np.gradient(model, t, axis=0)
        return inspect_samples(log, STATED, model - wrench, rate, self.speed[keep], stated, touched)


def names(found):
    """Names of the effects whose signs were detected."""
    effects = {finding.sign: finding.effect for finding in together([found])}
    return tuple(effects[finding.sign] for finding in found.detected)


def agrees(finding, name, truth, errors=3.0):
    value, stderr = np.array(finding.parameters[name]), np.array(finding.stderr[name])
    np.testing.assert_array_less(np.abs(value - truth), errors * stderr + 1e-12)


@pytest.mark.slow
def test_clean_logs_raise_no_alarm():
    for seed in range(200):
        recording = Recording(seed, 125.0, 20.0, stated_error=0.02 * (-1) ** seed)
        found = recording.inspect()
        assert names(found) == (), seed
        assert "not white" not in found.level.sentence
        assert not found.heavy_tailed
        assert np.isfinite(found.clean_wrench).mean() > 0.999
        np.testing.assert_allclose(found.noise_std, STATED, rtol=0.12)
    for rate, duration in ((25.0, 60.0), (1000.0, 10.0)):
        assert names(Recording(1, rate, duration).inspect()) == ()


@pytest.mark.parametrize("scale", [np.full(6, 2.3), np.full(6, 0.6), np.array([1, 1, 1.5, 1, 3.0, 1])])
def test_noise_level(scale):
    recording = Recording(2)
    found = recording.inspect(recording.model + scale * recording.noise)
    assert names(found) == ("noise_level",)
    agrees(found.level, "scale", scale, 3.5)  # the largest of six
    np.testing.assert_allclose(found.noise_std, scale * STATED, rtol=0.06)


def test_heavy_tails_are_noise_and_no_outliers():
    recording = Recording(3)
    tails = STATED * recording.rng.standard_t(4, size=recording.model.shape) / np.sqrt(2)
    found = recording.inspect(recording.model + 3 * tails)
    assert names(found) == ("noise_level",)
    assert found.heavy_tailed
    np.testing.assert_allclose(found.level.parameters["scale"], 3.0, rtol=0.15)


@pytest.mark.parametrize("form", ["whole sample", "single channels", "spread"])
def test_outliers(form):
    recording, rate = Recording(4, duration=40.0), 0.01
    rng, shape = recording.rng, recording.model.shape
    hit = rng.random(shape) < rate if form != "whole sample" else np.repeat(rng.random((shape[0], 1)) < rate, 6, 1)
    size = 25 * STATED * (rng.uniform(0.6, 1.4, shape) if form == "spread" else 1)
    spike = hit * size * rng.choice([-1, 1], shape)
    found = recording.inspect(recording.model + recording.noise + spike)
    assert names(found) == ("outliers",)
    agrees(found.spikes, "rate", rate)
    agrees(found.spikes, "size", np.sqrt((size**2).mean(0) if form == "spread" else size**2), 4.0)
    assert not np.isfinite(found.clean_wrench[hit]).any()
    assert np.isnan(found.clean_wrench).any(1).mean() < 1.02 * hit.any(1).mean()


def test_contact_and_steps_are_no_outliers():
    recording = Recording(5)
    force = np.zeros_like(recording.model)
    for start, length, peak in ((2.0, 0.012, 20.0), (5.0, 0.3, 3.0), (9.0, 0.1, 40.0), (13.0, 0.02, -6.0)):
        phase = (recording.t - start) / length
        force[:, 1] += np.where((phase > 0) & (phase < 1), peak * np.sin(np.pi * phase), 0)
    force[15 * 250 :, 4] += 0.5
    found = recording.inspect(recording.model + recording.noise + force)
    assert names(found) == ()


@pytest.mark.parametrize("rounding", [np.round, np.floor])
@pytest.mark.parametrize("sigmas", [1.0, 8.0])
def test_quantisation(rounding, sigmas):
    recording = Recording(6)
    step = sigmas * STATED * np.array([1, 1.1, 1.2, 1, 1, 1])
    found = recording.inspect(step * rounding((recording.model + recording.noise) / step))
    assert names(found) == ("quantisation",)
    agrees(found.lattice, "step", step)


def test_quantised_force_alone_and_fine_digits():
    recording = Recording(7)
    wrench = recording.model + recording.noise
    wrench[:, :3] = 0.5 * np.round(wrench[:, :3] / 0.5)
    wrench[:, 3:] = 1e-4 * np.round(wrench[:, 3:] / 1e-4)
    found = recording.inspect(wrench)
    assert names(found) == ("quantisation",)
    np.testing.assert_allclose(found.lattice.parameters["step"][:3], 0.5, rtol=1e-5)


@pytest.mark.parametrize("side", ["both", "above"])
def test_saturation(side):
    recording = Recording(8)
    wrench = recording.model + recording.noise
    limit = 0.95 * np.abs(wrench).max(0) if side == "both" else 0.9 * wrench.max(0)
    clipped = np.clip(wrench, -limit, limit) if side == "both" else np.minimum(wrench, limit)
    clipped[:, 3:] = wrench[:, 3:]
    found = recording.inspect(clipped)
    assert names(found) == ("saturation",)
    np.testing.assert_allclose(found.flat_tops.parameters["limits"][:3], limit[:3], rtol=1e-5)
    assert np.isinf(found.flat_tops.parameters["limits"][3:]).all()
    left_out, at_limit = np.isnan(found.clean_wrench), clipped != wrench
    assert left_out[at_limit].all()
    near = np.apply_along_axis(np.convolve, 0, at_limit, np.ones(2 * AROUND_CLIPPED + 1), "same") > 0.5
    np.testing.assert_array_equal(left_out, near)


def test_readings_that_noise_left_below_a_limit_are_no_evidence():
    """The tool rests with its wrench just above the limit, so unclipped readings are below it by selection."""
    recording = Recording()
    still = recording.model * 0 + SIZE
    recording.model = np.where((recording.t > 5)[:, None], still, recording.model.clip(-SIZE, 0.5 * SIZE))
    limit = SIZE + 0.3 * STATED
    found = recording.inspect((recording.model + recording.noise).clip(max=limit))
    assert names(found) == ("saturation",)
    resting = recording.t > 5.1
    kept = found.clean_wrench[resting]
    assert np.isfinite(kept).mean() < 0.01  # 38 % were not clipped


def test_rows_in_which_every_axis_is_clipped_are_not_lost():
    recording = Recording()
    overloaded = (recording.t > 8) & (recording.t < 10)
    recording.model[overloaded] = 5 * SIZE
    wrench = (recording.model + recording.noise).clip(max=0.5 * SIZE)
    assert (np.diff(wrench, axis=0) == 0).all(1).sum() >= overloaded.sum() - 1
    assert names(recording.inspect(wrench)) == ("saturation",)


@pytest.mark.parametrize("form", ["rows", "NaN", "repeats"])
def test_dropped_samples(form):
    recording, rate = Recording(9), 0.1
    wrench = recording.model + recording.noise
    lost = recording.rng.random(len(wrench)) < rate
    lost[[0, -1]] = False
    if form == "repeats":
        last = np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))
        wrench = wrench[last]
    if form == "NaN":
        wrench[lost] = np.nan
    found = recording.inspect(wrench, keep=~lost if form == "rows" else slice(None))
    assert names(found) == ("dropped_samples",)
    agrees(found.lost, "rate", lost.mean())
    assert found.lost.parameters["repeated"] == (form == "repeats")
    if form == "repeats":
        np.testing.assert_array_equal(np.isnan(found.clean_wrench).all(1), lost)


@pytest.mark.parametrize(("rate", "expected"), [(0.003, ()), (0.02, ("dropped_samples",))])
def test_a_few_lost_samples_are_usual(rate, expected):
    recording = Recording(9)
    lost = recording.rng.random(len(recording.t)) < rate
    lost[[0, -1]] = False
    found = recording.inspect(recording.model + recording.noise, keep=~lost)
    assert names(found) == expected


def test_a_single_gap_shows_no_rate_of_loss():
    """A pause of the recorder, which a rate with an error as large as itself would call a cause."""
    recording = Recording(9)
    there = np.ones(len(recording.t), bool)
    there[500:540] = False
    found = recording.inspect(recording.model + recording.noise, keep=there)
    assert names(found) == ()


@pytest.mark.parametrize("steps", [np.full(6, 0.49), np.array([0.8, 0.8, 0.8, 0.8, 0.49, 0.49]), np.full(6, 0.3)])
@pytest.mark.parametrize("axes", [6, 2])
def test_equal_readings_of_a_lattice_are_lost_samples_only_beyond_chance(steps, axes):
    recording = Recording(12)
    recording.model[recording.t > 14] = recording.model[-1]  # at rest neighbours are equal more often
    readings = np.round((recording.model + recording.noise) / (steps * STATED)) * steps * STATED
    readings[:, axes:] = np.nan
    assert axes == 6 or (np.diff(readings[:, :2], axis=0) == 0).all(1).sum() > 20
    assert "dropped_samples" not in names(recording.inspect(readings))
    lost = recording.rng.random(len(readings)) < 0.1
    lost[0] = False
    repeated = readings[np.maximum.accumulate(np.where(lost, 0, np.arange(len(lost))))]
    found = recording.inspect(repeated)
    if steps[:axes].min() > 0.5:
        return  # equal numbers are no evidence where noise hardly leaves a step
    assert "dropped_samples" in names(found)
    assert found.lost.parameters["rate"] == pytest.approx(0.1, abs=0.04)


def test_merged_timeline_is_not_a_drop():
    recording = Recording(10, 1000.0)
    wrench = recording.model + recording.noise
    wrench[np.arange(len(wrench)) % 4 != 1] = np.nan
    assert names(recording.inspect(wrench)) == ()


def test_uneven_stamps_are_not_a_drop():
    t = np.arange(4000) * 0.004
    late = t + np.random.default_rng(0).uniform(0, 0.0038, len(t))
    assert find_gaps(late).lost.sum() == 0
    assert find_gaps(np.delete(t, [10, 11, 500])).lost.tolist() == [2, 1]
    assert find_gaps(np.concatenate([t, t + 20])).pauses == 1


@pytest.mark.parametrize("form", ["gaussian", "latency"])
def test_stamp_jitter(form):
    recording, std = Recording(11, duration=40.0), 0.008
    rng = recording.rng
    late = std * (rng.normal(size=len(recording.t)) if form == "gaussian" else rng.exponential(size=len(recording.t)))
    moved = np.stack([np.interp(recording.t - late, recording.t, x) for x in recording.model.T], 1)
    found = recording.inspect(moved + recording.noise)
    assert names(found) == ("stamp_jitter",)
    agrees(found.jitter, "std", std)
    np.testing.assert_allclose(found.noise_std, STATED, rtol=0.1)


GROWTH = np.array([[20.0], [60.0]]) * STATED**2  # eight times the noise at rest where both joints are fast


def grown(recording):
    """Noise that grows with the speed of two joints."""
    return recording.noise * np.sqrt(1 + recording.speed**2 @ (GROWTH / STATED**2))


@pytest.mark.parametrize("rate", [25.0, 250.0])
def test_noise_that_grows_with_the_motion_is_no_noise_level(rate):
    recording = Recording(16, rate, 60.0 if rate > 100 else 400.0)
    found = recording.inspect(recording.model + grown(recording))
    assert names(found) == ("vibration",)
    agrees(found.growth, "variance", GROWTH, 4.0)
    np.testing.assert_allclose(found.noise_std, STATED, rtol=0.2)
    np.testing.assert_array_equal(found.in_motion.per_speed, found.growth.parameters["variance"])


def test_noise_that_grows_and_is_wrong_at_rest_has_both_names():
    recording = Recording(17, duration=60.0)
    found = recording.inspect(recording.model + 4 * grown(recording))
    assert names(found) == ("noise_level", "vibration")
    np.testing.assert_allclose(found.level.parameters["scale"], 4.0, rtol=0.1)


def test_a_log_that_never_rests_does_not_show_the_noise_at_rest():
    recording = Recording(20, duration=60.0)
    recording.speed = np.sin(recording.t[:, None] + [0, 1.5])
    found = recording.inspect(recording.model + recording.noise * (1 + 9 * np.abs(recording.speed).sum(1))[:, None])
    assert names(found) == ("vibration",)


def test_growth_that_the_setup_knows_is_not_told_again():
    recording = Recording(18, duration=60.0)
    found = recording.inspect(recording.model + 5.0 + grown(recording), stated=MotionNoise(GROWTH))
    assert names(found) == ()
    np.testing.assert_allclose(found.noise_std, STATED, rtol=0.05)
    np.testing.assert_array_equal(found.in_motion.per_speed, GROWTH)


def test_growth_with_the_speed_alone_is_told_with_the_speed_from_which_it_is_so():
    recording = Recording(16, 250.0, 60.0)
    stated = MotionNoise(4 * GROWTH, 0.1)
    noise = recording.noise * np.sqrt(1 + stated.variance(recording.speed) / STATED**2)
    found = recording.inspect(recording.model + noise)
    assert names(found) == ("vibration",)
    agrees(found.growth, "speed", 0.1, 3.0)
    assert found.in_motion.speed == found.growth.parameters["speed"]
    assert found.in_motion.variance(np.ones((1, 2))) == pytest.approx(stated.variance(np.ones((1, 2))), rel=0.1)
    known = recording.inspect(recording.model + noise, stated=stated)
    assert names(known) == ()
    np.testing.assert_allclose(known.noise_std, STATED, rtol=0.05)


@pytest.mark.parametrize("frequency", [None, 23.0, 50.0, 93.0])
def test_hum_vibration_and_filtered_noise_are_not_white(frequency):
    recording = Recording(12)
    noise = recording.noise.copy()
    if frequency is None:
        for i in range(1, len(noise)):
            noise[i] = 0.5 * noise[i - 1] + np.sqrt(0.75) * noise[i]
    else:
        noise += 4 * STATED * np.sin(2 * np.pi * frequency * recording.t)[:, None]
    found = recording.inspect(recording.model + noise)
    assert names(found) == ()
    assert "all channels not white" in found.level.sentence


def test_noise_that_is_quieter_and_not_white_says_that_its_white_part_is_told():
    recording = Recording(13)
    noise = 0.1 * recording.noise
    for i in range(1, len(noise)):
        noise[i] += 0.8 * noise[i - 1]
    level = recording.inspect(recording.model + noise).level
    assert level.detected
    assert level.doubt == "all channels: not white, and this is the white part"
    assert level.remedy.startswith("keep sensor.noise_std")
    white = recording.inspect(recording.model + 2 * recording.noise).level
    assert (white.detected, white.doubt, white.remedy) == (True, "", "")


def test_two_effects():
    recording = Recording(14)
    wrench = recording.model + 2 * recording.noise
    wrench[::101] += 40 * STATED
    found = recording.inspect(np.minimum(wrench, [6.0, *[np.inf] * 5]))
    assert names(found) == ("noise_level", "outliers", "saturation")
    agrees(found.level, "scale", 2.0, 4.0)


def test_missing_channels_and_short_logs():
    recording = Recording(15)
    wrench = recording.model + recording.noise
    wrench[:, 3:] = np.nan
    found = recording.inspect(wrench)
    assert names(found) == ()
    np.testing.assert_array_equal(found.noise_std[3:], STATED[3:])
    assert names(recording.inspect(keep=slice(0, 20))) == ()
    assert names(recording.inspect(np.full_like(wrench, np.nan))) == ()


def test_lattice_of_a_few_digits_and_none():
    x = np.random.default_rng(0).normal(size=3000)
    assert find_lattice(x.astype(np.float32)).step == 0
    assert find_lattice(np.round(x, 1) + 0.03).step == pytest.approx(0.1, rel=1e-6)


def unrest(recording, rows):
    """The reading with pushes along dW/dt in some rows, like those of late stamps."""
    late = 0.012 * recording.rng.normal(size=len(recording.t)) * rows
    return recording.model + recording.noise - late[:, None] * np.gradient(recording.model, recording.t, axis=0)


def test_unrest_in_contact_is_not_late_stamps():
    """A clock does not depend on contact: stamps outside contact must be late, too."""
    recording = Recording(11, duration=40.0)
    touched = (recording.t > 8) & (recording.t < 22)
    of_contact, everywhere = unrest(recording, touched), unrest(recording, np.ones_like(recording.t))
    assert recording.inspect(of_contact).jitter.detected  # without the times of contact
    assert not recording.inspect(of_contact, touched=touched).jitter.detected
    assert recording.inspect(everywhere, touched=touched).jitter.detected
    assert recording.inspect(everywhere, touched=np.zeros(len(touched), bool)).jitter.detected


def test_unrest_in_contact_is_no_noise_of_the_sensor():
    recording = Recording(12, duration=40.0)
    touched = (recording.t > 8) & (recording.t < 22)
    wrench = recording.model + recording.noise * np.where(touched, 3.0, 1.0)[:, None]
    assert "noise_level" in names(recording.inspect(wrench))
    assert names(recording.inspect(wrench, touched=touched)) == ()
    np.testing.assert_allclose(recording.inspect(wrench, touched=touched).noise_std, STATED, rtol=0.06)


def test_little_scatter_of_stamps_beside_much_growth_is_what_the_form_of_growth_leaves():
    recording = Recording(16, 250.0, 60.0)
    late = 0.006 * recording.rng.normal(size=len(recording.t))
    moved = np.stack([np.interp(recording.t - late, recording.t, x) for x in recording.model.T], 1)
    assert names(recording.inspect(moved + 3 * grown(recording))) == ("noise_level", "vibration")
    assert "stamp_jitter" in names(recording.inspect(moved + recording.noise))
