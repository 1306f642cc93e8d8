"""Contacts that a filter detects: their ends to the sample, and bins that a contact leaves with little information."""

from collections.abc import Sequence

import numpy as np

from ftbias_jax.diagnosis.samples.spikes import NORMAL_MEDIAN
from ftbias_jax.diagnosis.thresholds import CHATTER, LEAST_CHATTER, NEAR_END, TOUCH_BEGINS, TOUCH_SHARE
from ftbias_jax.filtering.noise.contact import Contact, in_contact

BEND_OF_WHITE = 6.0
"""Variance of a second difference of white noise of variance one."""


def with_exact_ends(t: np.ndarray, error: np.ndarray, contacts: Sequence[Contact]) -> tuple[Contact, ...]:
    """The contacts with the ends where their force begins and ceases, where the samples beside them show it.

    A sudden end that is a few bins off would leave more error than all else of the contact.

    Args:
        t: (T,) s.
        error: (T, 6) N, Nm, the model's prediction minus the wrench, NaN = not measured.
        contacts: as a filter detects them.
    """
    return tuple(_with_exact_ends(t, error[:, :3], contact) for contact in contacts)


def _with_exact_ends(t: np.ndarray, error: np.ndarray, contact: Contact) -> Contact:
    first, last = np.searchsorted(t, [contact.start - NEAR_END, contact.end + NEAR_END])
    rows = first + np.flatnonzero(np.isfinite(error[first:last]).all(1))
    near, force = t[rows], error[rows]
    inside = (near > contact.start) & (near < contact.end)
    ends = [contact.start, contact.end]
    for side, free in enumerate((near < contact.start - NEAR_END / 2, near > contact.end + NEAR_END / 2)):
        if free.sum() < LEAST_CHATTER or not inside.any():
            continue
        push = np.linalg.norm(force - np.median(force[free], 0), axis=1)
        least = max(TOUCH_BEGINS * np.median(push[free]), TOUCH_SHARE * np.median(push[inside]))
        there = np.flatnonzero((push > least) & ~free)
        if len(there):
            ends[side] = float(near[there[-1 if side else 0]])
    return contact._replace(start=ends[0], end=ends[1]) if ends[0] < ends[1] else contact


def variance_in_contact(
    t: np.ndarray, error: np.ndarray, variance: np.ndarray, contacts: Sequence[Contact]
) -> np.ndarray:
    """Variance (U, 6) N^2, Nm^2 of bins beyond that of their noise, in contact.

    A tool that grinds or scrapes chatters; this is measured by second differences, to which smooth forces hardly
    contribute. The mean of a bin in which a contact begins or ends suddenly may be anything between.

    Args:
        t: (U,) s, of bins.
        error: (U, 6) N, Nm, the model's prediction minus the wrench.
        variance: (U, 6) N^2, Nm^2, of the noise.
        contacts: with their exact ends.
    """
    more = np.zeros_like(error)
    step = np.median(np.diff(t))
    for contact in contacts:
        inside = in_contact(t, [contact])
        bend = np.nan_to_num(np.diff(error, 2, axis=0)[inside[2:] & inside[:-2]])  # missing readings count as quiet
        if len(bend) >= LEAST_CHATTER:
            usual = np.median(variance[inside], axis=0)
            excess = (np.median(np.abs(bend), axis=0) / NORMAL_MEDIAN) ** 2 / BEND_OF_WHITE - usual
            more[inside] += np.where(excess > CHATTER * usual, excess, 0.0)
        for end in (contact.start, contact.end):
            at = np.flatnonzero(np.abs(t - end) <= step)
            if len(at) > 1:
                more[at] += np.ptp(error[max(at[0] - 1, 0) : at[-1] + 2], axis=0) ** 2
    return np.nan_to_num(more)
