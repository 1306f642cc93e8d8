"""The verdict for a reader in a hurry."""

from __future__ import annotations

from ftbias_jax.diagnosis.result import Candidate, FoundTerm, Gap
from ftbias_jax.setup.types import Setup

MEAN_GAP = 0.01
"""Noise sigmas by which the error must exceed noise alone for a sentence about it."""


def sentence_of(verdict: str, gap: Gap, causes: tuple[Candidate, ...], terms: tuple[FoundTerm, ...] = ()) -> str:
    """One sentence; errors are held-out rms over all channels."""
    before, after = f"{gap.before_sigmas:.2f}", f"{gap.after_sigmas:.2f} noise sigmas (1 = noise alone)"
    named = " and ".join(" or ".join((cause.effect, *cause.indistinguishable_from)) for cause in causes)
    if verdict == "none":
        return "The log agrees with the setup: nothing beyond the stated model is needed."
    if terms:
        falls = f" The error falls from {before} to {after}." if gap.before_sigmas - 1 > MEAN_GAP else ""
        beside = f"{named}, and beside that what is not in the catalogue: " if causes else "Not in the catalogue: "
        return f"{beside}{'; '.join(term.text for term in terms)}.{falls}"
    if verdict == "unknown":
        seen = f" Seen in single samples: {named}." if causes else ""
        unexplained = (
            f"The error is {before} noise sigmas (1 = noise alone), and no effect of the catalogue explains it."
        )
        return unexplained + seen
    if gap.before_sigmas - 1 < MEAN_GAP:
        return f"{named}: seen in single samples; the mean reading agrees with the setup."
    if verdict == "explained" and gap.shrink == 0:
        return f"{named}: seen in single samples; the mean reading departs from the setup no more than by chance."
    explain = "explains" if len(causes) == 1 else "explain"
    if verdict == "explained":
        return f"{named} {explain} the gap: the error falls from {before} to {after}."
    return f"{named} {explain} {gap.shrink:.0%} of the gap: the error falls from {before} to {after}."


def not_whitened(setup: Setup) -> str:
    """What of the setup's noise the diagnosis does not use, as a further sentence; "" = nothing."""
    if setup.sensor.correlated_std is None or not setup.sensor.correlated_std.any():
        return ""
    return " The setup's correlated noise is not used here: errors are judged against white noise and drift."
