"""What the examination of single samples finds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue
from ftbias_jax.model.effects.fitting import LEVEL, Samples
from ftbias_jax.model.motion_noise import MotionNoise
from ftbias_jax.types import AXES

Numbers = dict[str, float | list[float] | list[list[float]]]


class Finding(NamedTuple):
    """One sign that is looked for in the samples, whether it is there or not."""

    sign: str
    """What the samples show: one of ``fitting.SIGNS``."""
    detected: bool
    parameters: Numbers
    """In the units of the catalogue; neutral where a channel shows nothing."""
    stderr: Numbers
    nats: float
    """Log-likelihood ratio against a sensor and driver in order; 0 = nothing seen."""
    sentence: str
    """The evidence, for the report."""
    nats_stderr: float | None = None
    """Of ``nats``, from blocks of the log; None = the square root of twice it, as of a chi-square."""
    effect: str = ""
    """The entry of the catalogue that leaves this sign; "" = not looked up (``together``)."""
    doubt: str = ""
    """Why the numbers are not what the entry of the catalogue means by them; "" = they are."""
    remedy: str = ""
    """What to do instead of what the entry says; "" = that."""


class SampleFindings(NamedTuple):
    """All of them, and what they leave for the rest of the diagnosis."""

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
    """What the speeds of the joints add to the variance of a sample, N^2, Nm^2 of six channels, as found or, where the
    setup knows of it, as stated; zeros without joints."""

    @property
    def detected(self) -> tuple[Finding, ...]:
        """The signs that are there."""
        return tuple(one for one in self if isinstance(one, Finding) and one.detected)


def surprise(count: float, expected: float) -> float:
    """Poisson log-likelihood ratio in nats of a count that is larger than expected; 0 if it is not."""
    expected = max(expected, 1e-9)
    return count * np.log(count / expected) - count + expected if count > expected else 0.0


def name_channels(which: np.ndarray) -> str:
    """Names of the channels marked in (6,) bool, for a sentence."""
    if which.all():
        return "all channels"
    return ", ".join(name for name, marked in zip(AXES, which, strict=True) if marked)


def together(logs: Sequence[SampleFindings], catalogue: Catalogue = CATALOGUE) -> tuple[Finding, ...]:
    """Effects that are there in any of several logs of one robot, each from the log that shows it best.

    The level of the noise comes last: what the others leave of themselves raises it. A sign that no effect of the
    catalogue leaves names nothing.
    """
    searches = {effect.name: effect.fit.search for effect in catalogue.values()}
    names = {search.sign: name for name, search in searches.items() if isinstance(search, Samples)}
    best: dict[str, Finding] = {}
    for finding in (finding for log in logs for finding in log.detected if finding.sign in names):
        if finding.sign not in best or finding.nats > best[finding.sign].nats:
            best[finding.sign] = finding._replace(effect=names[finding.sign])
    return tuple(sorted(best.values(), key=lambda finding: finding.sign == LEVEL))
