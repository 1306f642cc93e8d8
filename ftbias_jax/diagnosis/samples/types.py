"""Findings of the examination of single samples."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue
from ftbias_jax.model.effects.fitting import LEVEL, Samples
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.types import AXES

Numbers = dict[str, float | list[float] | list[list[float]]]


class Finding(NamedTuple):
    """Result for one sign that is searched for in the samples, whether it is there or not."""

    sign: str
    """What the samples show: one of ``fitting.SIGNS``."""
    detected: bool
    parameters: Numbers
    """Values in the units of the catalogue; neutral where a channel shows nothing."""
    stderr: Numbers
    nats: float
    """Log-likelihood ratio against a healthy sensor and driver; 0 = no evidence."""
    sentence: str
    """The evidence, for the report."""
    nats_stderr: float | None = None
    """Standard error of ``nats`` from blocks of the log; None = sqrt(2 nats), as of a chi-square."""
    effect: str = ""
    """The entry of the catalogue that leaves this sign; "" = not looked up (``together``)."""
    doubt: str = ""
    """Why the numbers differ in meaning from those of the catalogue's entry; "" = they do not."""
    remedy: str = ""
    """Remedy in place of the one in the catalogue's entry; "" = that of the entry."""


class SampleFindings(NamedTuple):
    """Findings of all signs, and the cleaned data for the rest of the diagnosis."""

    level: Finding
    spikes: Finding
    lattice: Finding
    flat_tops: Finding
    lost: Finding
    jitter: Finding
    growth: Finding
    clean_wrench: np.ndarray
    """(T, 6) N, Nm: NaN also where a sample is saturated, a spike or a repetition."""
    noise_std: np.ndarray
    """(6,) N, Nm, measured white noise of one sample at rest; the stated one where nothing was measured."""
    noise_std_stderr: np.ndarray
    """(6,) N, Nm."""
    heavy_tailed: bool
    """The noise has more large values than a normal distribution, without a gap between them and the rest."""

    in_motion: MotionNoise
    """Variance that the speeds of the joints add to a sample, N^2, Nm^2 in six channels: as found or, where the setup
    states it, as stated; zeros without joints."""

    @property
    def detected(self) -> tuple[Finding, ...]:
        """The findings that were detected."""
        return tuple(one for one in self if isinstance(one, Finding) and one.detected)


def log_likelihood_ratio(count: float, expected: float) -> float:
    """Poisson log-likelihood ratio in nats of a count that is larger than expected; 0 if it is not."""
    expected = max(expected, 1e-9)
    return count * np.log(count / expected) - count + expected if count > expected else 0.0


def name_channels(which: np.ndarray) -> str:
    """Names of the channels marked in (6,) bool, for a sentence."""
    if which.all():
        return "all channels"
    return ", ".join(name for name, marked in zip(AXES, which, strict=True) if marked)


def together(logs: Sequence[SampleFindings], catalogue: Catalogue = CATALOGUE) -> tuple[Finding, ...]:
    """Effects found in any of several logs of one robot, each from the log with the strongest evidence.

    The level of the noise comes last, because residuals of the other effects raise it. A sign that no effect of the
    catalogue leaves is omitted.
    """
    searches = {effect.name: effect.fit.search for effect in catalogue.values()}
    names = {search.sign: name for name, search in searches.items() if isinstance(search, Samples)}
    best: dict[str, Finding] = {}
    for finding in (finding for log in logs for finding in log.detected if finding.sign in names):
        if finding.sign not in best or finding.nats > best[finding.sign].nats:
            best[finding.sign] = finding._replace(effect=names[finding.sign])
    return tuple(sorted(best.values(), key=lambda finding: finding.sign == LEVEL))
