"""Repetition, with the whole logs, of the steps that a calibration kept."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ftbias_jax.calibration.identify_tool import identify_tool
from ftbias_jax.commissioning.drafted import as_uncertain, larger, loosened
from ftbias_jax.commissioning.events import other_causes, same_causes
from ftbias_jax.commissioning.logs import longest
from ftbias_jax.commissioning.result import CHANNELS, FIRST, NOISE, TERMS, TOOL, Step
from ftbias_jax.diagnosis.apply import with_causes
from ftbias_jax.diagnosis.diagnose import diagnose
from ftbias_jax.errors import FtbiasError
from ftbias_jax.io.log import Log
from ftbias_jax.model.effects.terms.parse import TERM
from ftbias_jax.setup.types import Setup
from ftbias_jax.types import Array


def repeat(
    steps: Sequence[Step],
    start: Setup,
    reached: Setup,
    logs: Sequence[Log],
    names: Sequence[str],
    first_tool: bool,
    mounting: bool = False,
) -> Setup | None:
    """Repeat, with the whole logs, the steps that were kept; None if these do not show the same causes.

    Args:
        steps: steps of the calibration; those that were refused are left out.
        start: setup at the start of the calibration.
        reached: setup at its end, from parts of the logs.
        logs: whole logs, as they were given.
        names: names of the logs.
        first_tool: take the tool as it was identified last, whatever causes changed in it.
        mounting: identify the rotation of the sensor with the tool.
    """
    setup, looked_for, kept = start, set[str](), [step for step in steps if step.kept]
    beside: Mapping[str, Array] = {}
    try:
        for step, later in zip(kept, [*(step.kind for step in kept[1:]), ""], strict=True):
            if step.kind in (FIRST, TOOL, CHANNELS):
                place = False if step.kind == FIRST else None
                crosstalk, log = step.kind == CHANNELS, longest(logs)
                found = identify_tool(
                    setup, log, mounting=mounting, crosstalk=crosstalk, translation=place, unchecked=True
                ).setup
                setup = loosened(found, setup) if step.kind == FIRST else as_uncertain(found, beside)
            elif step.kind == NOISE:
                setup = replace(setup, pose=reached.pose)
            else:
                looked_for |= {TERM} if step.kind == TERMS else {*step.parts}
                if later != TERMS:
                    named = diagnose(setup, logs, names, other_causes(setup, looked_for), unchecked=True)
                    setup, looked_for = with_causes(setup, named.causes, named.terms, named.model_stderr), set()
                    beside = larger(beside, named.tool_stderr)
    except FtbiasError:
        return None
    if first_tool:
        setup = as_uncertain(replace(setup, tool=found.tool), beside)
    return setup if same_causes(setup, reached, start) else None
