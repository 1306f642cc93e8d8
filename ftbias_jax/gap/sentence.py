"""The verdict for a reader in a hurry."""

from __future__ import annotations

import numpy as np

from ftbias_jax.gap.types import Candidate, Gap


def sentence_of(verdict: str, gap: Gap, causes: tuple[Candidate, ...]) -> str:
    """One sentence; the gap is what the innovations have beyond the noise."""
    size = float(np.sqrt(gap.before_sigmas**2 - 1))
    left = float(np.sqrt(gap.after_sigmas**2 - 1))
    named = " and ".join(" or ".join((cause.effect, *cause.indistinguishable_from)) for cause in causes)
    if verdict == "none":
        return "The log agrees with the setup: nothing beyond the stated model is needed."
    if verdict == "unknown":
        return f"There is a gap of {size:.2f} noise sigmas that no effect of the catalogue explains."
    if verdict == "explained":
        return f"{named} explains the gap: {size:.2f} noise sigmas before, {left:.2f} after."
    return f"{named} explains {gap.shrink:.0%} of the gap; {left:.2f} of {size:.2f} noise sigmas remain unexplained."
