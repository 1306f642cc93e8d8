"""Public function ``identify_payloads``: when a tool carries a part, how heavy the part is, and where."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.apply import with_causes
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.diagnosis.result import FoundTerm
from ftbias_jax.diagnosis.terms.phrases import intervals_in_words
from ftbias_jax.diagnosis.thresholds import SURE
from ftbias_jax.errors import LogError
from ftbias_jax.io import GivenLog
from ftbias_jax.model.effects.statements import value_words
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import GivenSetup, Setup, as_setup


class Payloads(NamedTuple):
    """The parts that a tool carries in one log."""

    setup: Setup
    """Setup with a term for each part at the times of this log, so that a filter of this log knows of them."""
    parts: tuple[FoundTerm, ...]
    """Parts with values in kg, m in the sensor frame and s since the first sample, with standard errors."""

    def __str__(self) -> str:
        return "\n".join(map(_in_words, self.parts))


def identify_payloads(
    setup: GivenSetup, log: GivenLog, *, unchecked: bool = False, progress: Callable[[str], None] = silent
) -> Payloads:
    """Find when the tool takes up and puts down a part, the part's mass, and its place in the hand.

    They are the payload terms that ``diagnose`` finds; its other results are not used.

    Args:
        setup: setup with robot, sensor, and the tool without the part; or its path.
        log: log as recorded (``read_log(..., raw=True)``), or its path, with motion with the part and without.
        unchecked: skip the check whether the setup can be right (``check_setup``).
        progress: called with the name of each stage as it begins.

    Raises:
        SetupError: the log shows that the setup is wrong.
        LogError: the log shows no part that is taken up or put down, or one that is lighter than nothing.
    """
    setup = as_setup(setup)
    found = diagnose(setup, log, unchecked=unchecked, progress=progress)
    parts = tuple(term for term in found.terms if term.form == "payload")
    if not parts:
        remedy = "look at what ftbias diagnose says, or leave out --payloads"
        raise LogError(f"shows no load that is taken up or put down: {found.sentence}", field="wrench", remedy=remedy)
    for part in parts:
        mass, stderr = (float(np.asarray(x["kg"])) for x in (part.coefficients, part.stderr))
        if mass < -SURE * stderr:
            message = f"shows a {_in_words(part)}: the tool that the setup states is not the one without the part"
            remedy = "identify the tool from a log in which it carries nothing, and give that setup"
            raise LogError(message, field="wrench", remedy=remedy)
    return Payloads(with_causes(setup, (), parts), parts)


def _in_words(part: FoundTerm) -> str:
    """Such as ``load of 0.48 ± 0.01 kg at (60 ± 1, -70 ± 1, 120 ± 2) mm, from 10.27 to 21.83 s (times ± 0.004 s)``."""
    mass = value_words(*(float(np.asarray(x["kg"])) for x in (part.coefficients, part.stderr)))
    point, errors = 1e3 * np.array(part.point), 1e3 * np.array(part.parameters_stderr["point"])
    place = ", ".join(map(value_words, point.tolist(), errors.tolist()))
    late = float(np.max(part.parameters_stderr["time"]))
    when = intervals_in_words(np.array(part.parameters["time"]))
    return f"load of {mass} kg at ({place}) mm, {when} (times ± {late:.1g} s)"
