"""Error of a corrected simulator on recordings that were not used to correct it, before and after, by channel."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ftbias_jax.diagnosis.evidence.gap import excess, excess_by_channel
from ftbias_jax.diagnosis.problem import Problem, make_problem
from ftbias_jax.diagnosis.regression import fit as fits
from ftbias_jax.diagnosis.thresholds import BLOCK_SECONDS
from ftbias_jax.io.atomic import plain
from ftbias_jax.io.cleaning import clean
from ftbias_jax.io.log import Log
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup.mjcf import Mjcf
from ftbias_jax.setup.types import Setup
from ftbias_jax.simulators.mended import OF_THE_ROBOT, without_drag
from ftbias_jax.simulators.replay import against, joint_states, replay
from ftbias_jax.simulators.sensor_model import EFFECTS
from ftbias_jax.types import Array


class Distance(NamedTuple):
    """Error of a simulator against recordings, beyond noise and beyond bias and drift."""

    rms: Array
    """(6,) N, Nm: root mean square error."""
    rms_stderr: Array
    """(6,) N, Nm: standard error, from the scatter of blocks of the logs."""
    sigmas: float
    """Root mean square over the channels, in standard deviations of the noise."""
    sigmas_stderr: float


class Validation(NamedTuple):
    """Errors of a simulator before and after its correction."""

    before: Distance
    after: Distance
    shrink: float
    """1 - (after / before)^2, of ``sigmas``: the share of the mean square gap that is gone; negative if it grew."""
    shrink_stderr: float
    left_out: tuple[str, ...] = ()
    """Effects that were found, but that neither the scene nor a sensor model can express."""

    def plain(self) -> dict[str, Any]:
        """Plain dicts, lists and numbers for JSON."""
        return dict(plain(self._asdict() | {"before": self.before._asdict(), "after": self.after._asdict()}))

    def __str__(self) -> str:
        lines = ["channel  before              after"]
        pairs = zip(("fx N", "fy N", "fz N", "tx Nm", "ty Nm", "tz Nm"), range(6), strict=True)
        for name, k in pairs:
            cells = (f"{d.rms[k]:.3g} \u00b1 {d.rms_stderr[k]:.1g}" for d in (self.before, self.after))
            lines.append(f"{name:7s}  " + "  ".join(f"{cell:18s}" for cell in cells))
        without = f", without {', '.join(self.left_out)}, which the files cannot express" if self.left_out else ""
        shrink = f"{100 * self.shrink:.0f} \u00b1 {100 * self.shrink_stderr:.2g} %"
        return "\n".join([*lines, f"the gap shrinks by {shrink}{without}"])


@in_float64
def validate(
    setup: Setup,
    mended: Setup,
    logs: Sequence[Log],
    scenes: tuple[Mjcf, Mjcf],
    progress: Callable[[str], None] = silent,
) -> Validation:
    """Replay recordings in the original scene and in the corrected one, there with the sensor errors that were found.

    What neither the scene nor the sensor model can express, such as contact and most terms, is not counted.

    The logs are not those of the diagnosis; ``progress`` is called with the name of each stage as it begins.
    """
    progress("replaying the logs")
    of_sensor = {name: x for name, x in mended.effects.items() if name in EFFECTS}
    left_out = tuple(name for name in without_drag(mended.effects) if name not in (*EFFECTS, *OF_THE_ROBOT))
    whole = [clean(log) for log in logs]
    times, states = [log.t for log in whole], [joint_states(setup, log) for log in whole]
    found = []
    for one, scene in ((setup, scenes[0]), (replace(setup, effects={**setup.effects, **of_sensor}), scenes[1])):
        beside = [
            against(setup, log, t, replay(scene, t, state), state)
            for log, t, state in zip(logs, times, states, strict=True)
        ]
        progress("comparing")
        problem, _ = make_problem(one.with_effects(setup.own_effects), beside)
        found.append(distance(problem, fits.base(problem).error))
    before, after = found
    if before.sigmas == 0:
        return Validation(before, after, 0.0, 1.0, left_out)
    left = (after.sigmas / before.sigmas) ** 2
    of_after, of_before = (2 * x.sigmas * x.sigmas_stderr / before.sigmas**2 for x in (after, before))
    return Validation(before, after, 1 - left, float(np.hypot(of_after, left * of_before)), left_out)


def distance(problem: Problem, error: Array) -> Distance:
    """Size in N and Nm of innovations (U, 6), in standard deviations, beyond their expectation from noise."""
    mean = excess_by_channel(problem, error)
    weight = np.where(problem.samples > 0, (problem.noise_std**2 / problem.variance) ** 2, 0)
    scaled = weight / np.maximum(weight.sum(0), 1e-300) * (excess(problem, error) - mean)
    sums = np.stack([np.bincount(problem.block(BLOCK_SECONDS), x) for x in scaled.T])
    stderr, total = np.sqrt((sums**2).sum(1)), float(np.maximum(mean, 0).mean())
    of_total = float(np.sqrt((sums.mean(0) ** 2).sum()))
    size = np.sqrt(np.maximum(mean, 0))
    return Distance(
        rms=problem.noise_std * size,
        rms_stderr=problem.noise_std * stderr / (2 * np.maximum(size, np.sqrt(np.maximum(stderr, 1e-300)))),
        sigmas=float(np.sqrt(total)),
        sigmas_stderr=of_total / (2 * max(np.sqrt(total), np.sqrt(of_total), 1e-300)),
    )
