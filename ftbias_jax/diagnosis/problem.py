"""Logs prepared for the diagnosis: smoothed joints, cleaned wrench, averaged to bins, and the noise of each bin."""

from collections.abc import Sequence
from typing import NamedTuple, Self

import jax
import numpy as np

from ftbias_jax.check.contact import STILL
from ftbias_jax.diagnosis.regression.chain_model import nominal_motion
from ftbias_jax.diagnosis.regression.coordinates import Layout, layout
from ftbias_jax.diagnosis.regression.whitening import Whitener, make_whitener
from ftbias_jax.diagnosis.samples.bins import bins_of, fill_up, mean_of_bins, sum_of_bins
from ftbias_jax.diagnosis.samples.read import inspect_samples
from ftbias_jax.diagnosis.samples.smoothed import padded_samples, smoothed
from ftbias_jax.diagnosis.samples.touched import variance_in_contact, with_exact_ends
from ftbias_jax.diagnosis.samples.types import SampleFindings
from ftbias_jax.diagnosis.thresholds import LEAST_BINS
from ftbias_jax.errors import LogError
from ftbias_jax.filtering import bias_filter, params_for_log
from ftbias_jax.filtering.likelihood import WrenchProblem
from ftbias_jax.filtering.method.look import Touched, contacts_in, scatter_at_rest
from ftbias_jax.filtering.noise.contact import Contact, in_contact
from ftbias_jax.filtering.noise.joint_scatter import remark_of_joints
from ftbias_jax.filtering.noise.log_noise import MARGIN, by_axis
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.samples import waiting
from ftbias_jax.io.log import Log, Repairs
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue
from ftbias_jax.model.effects.compose import fill_temperature
from ftbias_jax.model.effects.types import Model, Signals, Values
from ftbias_jax.model.kinematics.arm_batch import ArmMotion
from ftbias_jax.model.kinematics.recorded_pose import speeds_of
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.model.params import Params, unknown_acceleration, with_noise_as_known
from ftbias_jax.setup.types import Setup

NEGLIGIBLE, POINT = 1e-6, (1.0, 0.0, 0.0, 0.05, 0.0025, 0.0, 0.0, 0.0025, 0.0, 0.0)
"""kg of a negligible tool, and inertial parameters of one kilogram, 5 cm in front of the sensor."""


class Part(NamedTuple):
    """One log in bins, padded to B of them; a padded bin has no measurement."""

    signals: Signals
    """Motion at the bins, and what the setup states about robot and tool."""
    wrench: WrenchProblem
    """Input of the bias filter: mean readings of the bins minus the stated bias (B, 6), NaN = none, and their noise."""
    used: int
    """Number of bins before the padding."""
    nominal: ArmMotion
    """Motion of the arm at the nominal joint positions, with the padding."""
    whiten: Whitener
    """Whitening by the innovations of that filter."""
    touched: Touched = Touched()
    """Contacts as a filter detects them."""
    coherent: np.ndarray = np.zeros((0, 6))
    """(U, 6) N^2, Nm^2: noise variance that averaging over a bin does not reduce, mostly the joints' error."""
    unseen: np.ndarray = np.zeros(6)
    """(6,) N, Nm: standard deviation of the tool's wrench due to unrecorded accelerations."""
    remarks: Repairs = ()
    """Remarks for the log's owner."""

    def with_wrench(self, **changed: np.ndarray) -> Self:
        """Copy with other fields of ``wrench``, and the whitening filter that belongs to them."""
        wrench = self.wrench._replace(**jax.device_put(changed))
        return self._replace(wrench=wrench, whiten=make_whitener(wrench, self.used))

    @property
    def begins_in_motion(self) -> bool:
        """Whether the arm moves at the first bin."""
        return bool(np.abs(speeds_of(self.signals.model.arm, np.asarray(self.signals.dq)[0])).max() > STILL)

    def without_readings_before(self, seconds: float) -> Self:
        """Copy without the readings of its first seconds."""
        reading = np.where(np.asarray(self.signals.t)[:, None] < seconds, np.nan, self.wrench.wrench)
        return self.with_wrench(wrench=reading)


class Problem(NamedTuple):
    """One log, or several logs of one robot concatenated. U = bins of all logs, without padding."""

    parts: tuple[Part, ...]
    t: np.ndarray
    """(U,) s since the start of the bin's own log."""
    log: np.ndarray
    """(U,) number of the bin's log."""
    samples: np.ndarray
    """(U, 6) number of samples in each bin."""
    variance: np.ndarray
    """(U, 6) N^2, Nm^2: noise variance of the bins' means, including the joints' error."""
    temperature: np.ndarray
    """(U,) deg C."""
    durations: tuple[float, ...]
    """s, duration of each log."""
    noise_std: np.ndarray
    """(6,) N, Nm, measured noise of one sample at rest."""
    known: Values
    """Effects that the setup states."""
    catalogue: Catalogue = CATALOGUE
    """Effects that are searched."""
    recorded: frozenset[str] = frozenset()
    """What the logs contain besides joints and wrench, for effects that need it."""
    noise_stderr: np.ndarray = np.zeros(6)
    """(6,) N, Nm, standard error of ``noise_std``."""

    @property
    def duration(self) -> float:
        """s, total duration of all logs."""
        return sum(self.durations)

    @property
    def joints(self) -> int:
        """Number of the robot's joints."""
        return int(self.parts[0].signals.q.shape[1])

    @property
    def layout(self) -> Layout:
        """Layout of the coordinates of all effects."""
        return layout(self.joints, self.catalogue)

    def block(self, seconds: float) -> np.ndarray:
        """(U,) block numbers 0, 1, ... of blocks of this many seconds; no block spans two logs."""
        piece = self.t // seconds
        begins = (np.diff(self.log) != 0) | (np.diff(piece) != 0)
        return np.concatenate([[0], np.cumsum(begins)])

    def without(self, bins: np.ndarray) -> Self:
        """Copy without the samples of some bins (U,) bool."""
        return self._replace(samples=np.where(bins[:, None], 0, self.samples))

    def settled(self, effects: Values) -> Self:
        """Copy without the readings before effects have settled, in logs that begin in motion.

        What effects did before the log is unknown; a model of them starts as if the arm had been at rest.
        """
        waits = [waiting(effects, duration, self.catalogue) for duration in self.durations]
        pairs = zip(waits, self.parts, strict=True)
        waits = [wait if wait > 0 and part.begins_in_motion else 0.0 for wait, part in pairs]
        if not any(waits):
            return self
        pairs = zip(waits, self.parts, strict=True)
        parts = tuple(part.without_readings_before(wait) if wait else part for wait, part in pairs)
        return self.without(self.t < np.array(waits)[self.log])._replace(parts=parts)

    def wandering(self, density: np.ndarray) -> Self:
        """Copy with another noise density of the bias drift, (6,) N/s^1.5, Nm/s^1.5."""
        return self._replace(parts=tuple(part.with_wrench(density=density) for part in self.parts))

    def louder(self, added: np.ndarray) -> Self:
        """Copy with additional variance (U, 6) N^2, Nm^2 of the bins' means."""
        pieces = np.split(added, np.cumsum([part.used for part in self.parts])[:-1])
        parts = [
            part.with_wrench(variance=np.asarray(part.wrench.variance) + fill_up(own, len(part.signals.t), 0.0))
            for part, own in zip(self.parts, pieces, strict=True)
        ]
        return self._replace(parts=tuple(parts), variance=self.variance + added)


def make_problem(setup: Setup, logs: Sequence[Log]) -> tuple[Problem, tuple[SampleFindings, ...]]:
    """Smooth the joints, examine the samples, and average the cleaned log over short bins.

    Returns the problem for effects on the mean reading, and what the individual samples of each log show.
    """
    setup = with_noise_as_known(setup)
    prepared = [_prepare(setup, log) for log in logs]
    parts = tuple(part for part, *_ in prepared)
    found = tuple(found for *_, found in prepared)
    used = [part.used for part in parts]
    stds, stderrs = np.array([one.noise_std for one in found]), np.array([one.noise_std_stderr for one in found])
    noise_std = np.sqrt((stds**2).mean(0))

    def join(arrays: Sequence[np.ndarray]) -> np.ndarray:
        return np.concatenate([np.asarray(array)[:length] for array, length in zip(arrays, used, strict=True)])

    problem = Problem(
        parts=parts,
        t=join([part.signals.t for part in parts]),
        log=np.repeat(np.arange(len(parts)), used),
        samples=join([count for _, count, _, _ in prepared]),
        variance=join([np.asarray(part.wrench.variance) for part in parts]),
        temperature=join([part.signals.temperature for part in parts]),
        durations=tuple(float(log.t[-1]) for log in logs),
        noise_std=noise_std,
        known=prepared[0][2],
        catalogue=catalogue_of_setup(setup),
        recorded=_recorded_in(logs),
        noise_stderr=np.sqrt(((stds * stderrs) ** 2).sum(0)) / len(found) / noise_std,
    )
    return problem.settled(problem.known), found


def _recorded_in(logs: Sequence[Log]) -> frozenset[str]:
    """Signals besides joints and wrench: "temperature" if any log has it, and the columns that all logs have."""
    warm = {"temperature"} if any(np.isfinite(log.temperature).any() for log in logs) else set()
    return frozenset(warm).union(set(logs[0].columns).intersection(*(log.columns for log in logs)))


def _prepare(setup: Setup, log: Log) -> tuple[Part, np.ndarray, Values, SampleFindings]:
    """One log: bins, samples in each (B, 6), effects that the setup states, and what the samples show."""
    options, samples, length = Options(joint_model=setup.joints.model), padded_samples(log), len(log.t)
    params = params_for_log.max_likelihood_params(setup, samples, options)
    known = params.bias.in_motion
    joints, reading, variance = (x[:length] for x in smoothed(params, samples, options))  # sample noise is added below
    rate, speed = np.gradient(reading, log.t, axis=0), speeds_of(params.arm, joints[:, :, 1])
    contacts = contacts_in(log, reading, speed, variance, setup.sensor.compensated == "none")
    error = reading - log.wrench
    contacts = contacts._replace(contacts=with_exact_ends(log.t, error, contacts.contacts))
    touched = in_contact(log.t, contacts.contacts, MARGIN)
    found = inspect_samples(log, setup.sensor.noise_std, error, rate, speed, known, touched)
    if found.level.detected and found.level.doubt:
        scatter = scatter_at_rest(log, error, speed, variance, setup.sensor.noise_std)
        words = f"{found.level.doubt} of what scatters at rest, by {by_axis(scatter)} of noise_std (ftbias filter)"
        found = found._replace(level=found.level._replace(doubt=words))
    joint_variance = np.maximum(variance - setup.sensor.noise_std**2, 0.0)  # including unrecorded accelerations
    noise_std, coherent = noise_on_lattice(found, setup.sensor.noise_std)
    found = found._replace(noise_std=noise_std)
    late = float(np.max(found.jitter.parameters["std"])) if found.jitter.detected else 0.0
    of_samples, catalogue = (late * rate) ** 2 + found.in_motion.variance(speed), catalogue_of_setup(setup)
    variances = joint_variance + coherent, of_samples
    part, count = _bin(params, log, joints, error, variances, found, contacts.contacts, catalogue)
    of_joints = remark_of_joints(setup, params)
    part = part._replace(touched=contacts, unseen=np.sqrt(unknown_acceleration(setup)), remarks=of_joints)
    return part, count, params.effects or {}, found


def noise_on_lattice(found: SampleFindings, stated_std: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Noise of one sample (6,) N, Nm including quantisation, and the variance (6,) that averaging does not reduce.

    Noise smaller than the lattice's step is hardly visible in the readings, so the stated noise is used there. The
    quantisation error then follows the signal; the share of its variance that the noise leaves coherent is that of its
    first harmonic, exp(-4 pi^2 (noise / step)^2).
    """
    step = np.broadcast_to(np.asarray(found.lattice.parameters.get("step", 0.0), float), (6,))
    coarse = step > stated_std
    noise_std = np.where(coarse, np.hypot(stated_std, step / np.sqrt(12)), found.noise_std)
    dither = np.exp(-((2 * np.pi * stated_std / np.where(coarse, step, 1.0)) ** 2))
    return noise_std, np.where(coarse, step**2 / 12 * dither, 0.0)


def _bin(
    params: Params,
    log: Log,
    states: np.ndarray,
    error: np.ndarray,
    variances: tuple[np.ndarray, np.ndarray],
    found: SampleFindings,
    contacts: Sequence[Contact],
    catalogue: Catalogue,
) -> tuple[Part, np.ndarray]:
    """Average a log over short bins, compute their noise, subtract the stated bias, and pad.

    The states are (T, n, 3), the model's error (T, 6) N, Nm. Of the variances (T, 6) N^2, Nm^2 that of the joints is
    correlated within a bin, and that of samples, from jitter and noise that grows with the motion, is not. Also returns
    (U, 6) samples in each bin.
    """
    wrench, temperature = found.clean_wrench, fill_temperature(log.t, log.temperature)
    rows = np.isfinite(wrench).any(1)
    index, used, padded = bins_of(log.t[rows], float(log.t[-1]))
    if used < LEAST_BINS:
        message = f"only {rows.sum()} usable readings remain; the others are saturated, repeated or spikes"
        raise LogError(message, field="wrench", remedy="check the sensor and its driver, and record again")
    count = sum_of_bins(index, np.isfinite(wrench[rows]))
    columns = {name: mean_of_bins(index, column.at(log.t)[rows]) for name, column in log.columns.items()}
    series = (log.t, states, temperature, wrench, error, *variances)
    t, joints, temperature, reading, error, coherent, white = (mean_of_bins(index, x[rows]) for x in series)
    # The smoothed joints' error is correlated over longer than a bin, so averaging does not reduce it.
    variance = np.where(count > 0, (found.noise_std**2 + white) / np.maximum(count, 1) + coherent, 1.0)
    variance = variance + variance_in_contact(t, error, variance, contacts)
    bias, place = params.bias, jax.device_put  # unlike jnp.asarray it compiles nothing
    jump = None
    if log.rezeroed_at:
        # The bin of the re-zeroing has samples from before and after it, so its level is unrelated to its neighbours'.
        rezeroed = log.is_rezeroed(t, 0.0)
        either = np.concatenate([rezeroed | np.append(False, rezeroed[:-1]), np.zeros(padded - used, bool)])
        jump = bias_filter.jumps(params, place(either.astype(float)))
    t, joints, temperature = (fill_up(x, padded, x[-1]) for x in (t, joints, temperature))
    q, dq, ddq = (place(x) for x in np.moveaxis(joints, 2, 0))
    tool = np.asarray(params.theta)
    # A controller that subtracts the tool leaves none, but effects of a tool need one to act on.
    theta = params.theta if tool[0] else place((NEGLIGIBLE * np.array(POINT)).astype(tool.dtype))
    stated = Model(params.arm, params.gravity, theta)
    seen = {name: place(fill_up(x, padded, x[-1])) for name, x in columns.items()}
    signals = Signals(place(t), q, dq, ddq, place(temperature), stated, columns=seen)
    at_first, drift = np.split(np.asarray(bias.prior_mean), 2)
    free = fill_up(reading, padded, np.nan) + at_first + t[:, None] * drift
    dt, variance = place(np.diff(t, prepend=t[0])), fill_up(variance, padded, 1.0)
    problem = WrenchProblem(dt, place(free), place(variance), bias.density, bias.prior_std, jump)
    nominal = nominal_motion(signals, params.effects or {}, catalogue)
    return Part(signals, problem, used, nominal, make_whitener(problem, used), coherent=coherent), count
