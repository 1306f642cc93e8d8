"""A gate that keeps out most of a log: then its first readings were the odd ones, and the bias begins elsewhere.

The gate takes for contact what is off its prediction, and the prediction rests on the readings that passed before. A
few odd ones at the start are enough: with little noise the gate does not open for the rest of a short log, and the bias
would be wrong with narrow error bars.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

import jax.numpy as jnp
import numpy as np

from ftbias_jax.filtering.adapt.blocks import Blocks, unmeasured_axes
from ftbias_jax.filtering.adapt.contact import in_contact
from ftbias_jax.filtering.adapt.log_noise import BEGUN_AGAIN, LogNoise, useless
from ftbias_jax.filtering.recorded.prepare import Prepared
from ftbias_jax.filtering.result import Filtered
from ftbias_jax.io.log import Repair, Repairs
from ftbias_jax.model.params import Params
from ftbias_jax.types import Array

LEAST_USED = 0.5
"""Share of the samples free of contact that the gate must let through; contacts are found before, and do not count."""
MAD = 1.4826
"""Standard deviations of normal numbers in their median absolute deviation."""

Run = Callable[[Params], Iterator[Filtered]]
"""Filters the log with these parameters."""


def filter_or_begin_again(
    params: Params, noise: LogNoise, blocks: Blocks, parts: Iterable[Prepared], run: Run
) -> tuple[Params, LogNoise, list[Filtered]]:
    """Filter a log, and once more from its median if the gate kept out most of it.

    Args:
        params: of the filter, with the noise of the log.
        noise: of the log.
        blocks: of the whole log.
        parts: the log.
        run: filters it.

    Returns:
        the parameters and the noise with what was done, and the result part by part: of the two the one that uses more.
    """
    free = sum(_free(part, noise) for part in parts)
    found = list(run(params))
    used = _used(found)
    if used >= LEAST_USED * free:
        return params, noise, found
    moved = from_median(params, noise, blocks)
    again = list(run(moved))
    if _used(again) > used:
        params, noise, found, used = moved, noise._replace(begun_again=True), again, _used(again)
    share = 1 - used / free
    return params, noise._replace(kept_out=share if share > 1 - LEAST_USED else 0.0), found


def _free(part: Prepared, noise: LogNoise) -> int:
    """How many samples there are to be used."""
    return int(np.count_nonzero(np.isfinite(part.samples.wrench).any(1) & ~useless(part.log.t, noise)))


def _used(found: list[Filtered]) -> int:
    return sum(int(np.count_nonzero(part.used)) for part in found if part.used is not None)


@unmeasured_axes()
def from_median(params: Params, noise: LogNoise, blocks: Blocks) -> Params:
    """Parameters whose bias begins at the median of the log's free blocks, as uncertain as these scatter about it."""
    measured = np.where(in_contact(blocks.t, list(noise.contacts))[:, None], np.nan, blocks.mean)
    median = np.nanmedian(measured, axis=0)
    scatter = MAD * np.nanmedian(np.abs(measured - median), axis=0)
    bias, seen = params.bias, np.isfinite(median)

    def begin(prior: Array, found: Array) -> Array:
        return jnp.asarray(prior).at[:6].set(np.where(seen, found, np.asarray(prior)[:6]))

    mean, std = begin(bias.prior_mean, median), begin(bias.prior_std, scatter)
    return params._replace(bias=bias._replace(prior_mean=mean, prior_std=std))


def remark_of_gate(noise: LogNoise) -> Repairs:
    """What the owner should know about a gate that kept out most of the log; () as a rule."""
    told = (Repair(BEGUN_AGAIN),) if noise.begun_again else ()
    if not noise.kept_out:
        return told
    what = f"the gate keeps out {noise.kept_out:.0%} of the log, wherever the bias begins: do not trust the bias"
    return (*told, Repair(f"{what}, and look for the cause by ftbias diagnose", lost=True))
