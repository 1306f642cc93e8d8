"""Public function ``identify_tool``: identifies the tool, and optionally mounting and gravity, from a log."""

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ftbias_jax.calibration.identify import Identified
from ftbias_jax.calibration.identify_poses import PoseReport, identify_poses, pose_lines
from ftbias_jax.calibration.tool.channels import Channels, channels_in_words, find_channels, with_channels
from ftbias_jax.calibration.tool.physical import NAMES, UNITS
from ftbias_jax.calibration.tool.place import identify_with_place
from ftbias_jax.calibration.tool.steady import SteadyBias, steady_bias
from ftbias_jax.calibration.tool.steps import Step, find_steps, is_gained, with_steps
from ftbias_jax.check.check_setup import require_right
from ftbias_jax.errors import LogError, UsageError
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.pipeline import Options
from ftbias_jax.filtering.quality.at_rest import require_motion
from ftbias_jax.filtering.samples import pad, samples_from_log
from ftbias_jax.io import GivenMotion, as_motion
from ftbias_jax.io.cleaning import without_long_pauses
from ftbias_jax.io.log import Log
from ftbias_jax.io.tables.poses import Poses
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.runtime.jax_config import in_float64
from ftbias_jax.runtime.progress import silent
from ftbias_jax.setup import GivenSetup, as_setup
from ftbias_jax.setup.require import NOT_STATED, guessed_parameters, has_open_place, with_guessed_tool
from ftbias_jax.setup.rotations import rotation_from_vector
from ftbias_jax.setup.types import BiasSetup, Setup


@dataclass(frozen=True, eq=False)
class IdentifyResult:
    """A setup with the identified tool, and how well the log determines it."""

    setup: Setup
    """Setup with the identified values; ``save`` writes standard errors beside them."""
    tool: Identified
    """Values and standard errors, and what the motion leaves undetermined."""
    mounting: bool
    """Whether the sensor's rotation on the flange was identified, too."""
    gravity: bool
    """Whether the direction of gravity was identified, too."""
    bias: bool = False
    """Whether the setup holds the identified bias, as the prior of later logs."""
    poses: PoseReport | None = None
    """For static poses, how well each is predicted from the others; None = a log of motion."""
    channels: Channels | None = None
    """Gains of the sensor's channels and crosstalk between them; None = not asked for."""
    steps: tuple[Step, ...] = ()
    """Steps of the reading at which the bias was free to jump."""

    @property
    def converged(self) -> bool:
        """Whether the search found its optimum; if not, there is no result."""
        return self.tool.converged

    def save(self, path: str | os.PathLike[str], by: str = "") -> None:
        """Write the identified setup; raises what ``Setup.save`` raises, too.

        Args:
            path: path of the TOML file.
            by: as for ``Setup.save``.

        Raises:
            LogError: nothing that could be written was identified; no file is touched then.
        """
        remedy = "turn the wrist through all directions of gravity, and keep the tool free of contact"
        if not self.converged:
            raise LogError("the search for the tool did not converge; nothing is written", remedy=remedy)
        channels = self.channels is not None and self.channels.shown
        if all(self.tool.remarks) and not (self.mounting or self.gravity or self.bias or channels):
            raise LogError("determines no parameter of the tool; nothing is written", remedy=remedy)
        self.setup.save(path, by)

    def __str__(self) -> str:
        found = self.tool
        lines = [f"{'':8s}{'value':>14s}{'± 1 sigma':>14s}"]
        table = zip(NAMES, UNITS, found.values, found.stderr, found.remarks, strict=True)
        for name, unit, value, stderr, remark in table:
            shown, error = "-" if np.isnan(value) else f"{value:.6g}", "" if np.isnan(stderr) else f"{stderr:.2g}"
            lines.append(f"{name:8s}{shown:>14s}{error:>14s}  {unit}{f'  {remark}' if remark else ''}")
        if self.mounting:
            turned = with_errors(np.degrees(found.rotation), np.degrees(found.rotation_stderr))
            lines.append(f"sensor turned by {turned} deg")
        if self.gravity:
            lines.append(f"gravity {with_errors(found.gravity, found.gravity_stderr)} m/s^2")
        if found.has_lever:
            what = "turns at a distance" if _is_orientation(self.setup) else "is off its stated place on the flange by"
            axes = "sensor axes" if self.setup.pose is None else "mount's axes"
            lines.append(f"the sensor {what} {with_errors(found.lever, found.lever_stderr)} m, {axes}")
        if self.channels is not None:
            lines += channels_in_words(self.channels)
        beside = [name for name in self.setup.effects if name in CATALOGUE and CATALOGUE[name].stage == "bias"]
        without = f", without the setup's {' and '.join(beside)}" if beside else ""
        lines.append(f"bias at the end{without}: {with_errors(found.bias[:3], found.bias_stderr[:3])} N")
        lines.append(f"                 {with_errors(found.bias[3:], found.bias_stderr[3:])} Nm")
        lines += motion_lines(found, self.steps) if self.poses is None else pose_lines(self.poses)
        if found.unexcited:
            poor = ", ".join(found.unexcited)
            more = "turn the wrist more, or accelerate more" if self.poses is None else "poses at rest show no inertia"
            lines.append(f"this motion does not excite: {poor} ({more})")
        return "\n".join(lines)


@in_float64
def identify_tool(
    setup: GivenSetup,
    log: GivenMotion,
    *,
    mounting: bool = False,
    gravity: bool = False,
    bias: bool = False,
    crosstalk: bool = False,
    translation: bool | None = None,
    unchecked: bool = False,
    progress: Callable[[str], None] = silent,
) -> IdentifyResult:
    """Identify the tool's mass, centre of mass and inertia, physically consistent, jointly with the bias.

    What the motion does not determine keeps the setup's value, and has a remark in ``tool.remarks``. Computes in
    float64, and keeps compiled programs in the user's cache folder (``FTBIAS_CACHE=off`` disables it).

    Args:
        setup: setup with robot, sensor, noise, and a tool to start from, which may be left out; or its path.
        log: log of free motion that turns the wrist, as returned by ``read_log``; or readings at rest, as returned by
            ``read_poses``; or the path of either.
        mounting: also identify the rotation of the sensor on the flange, by any angle.
        gravity: also identify the direction of gravity in the base frame.
        bias: also write the bias, with its standard error, as the prior of logs recorded before the sensor is zeroed: a
            constant one, or that at the end if a drift is clearly likelier and predicts the readings better.
        crosstalk: also identify the gains of the sensor's channels and the crosstalk between them, as effects of the
            setup, if held-out blocks of the log are likelier with them. Not from static poses.
        translation: also identify the place of the sensor on the flange; None = if it is open in a drafted setup.
        unchecked: skip the check whether the setup can be right (``check_setup``).
        progress: called with the name of each stage as it begins.

    Returns:
        the identified setup, with values in kg, m, kg m^2 about the centre of mass, sensor axes.

    Raises:
        SetupError: the log shows that more than the tool is wrong in the setup. UsageError: crosstalk of static poses.
        LogError: the log is in units or frames that no setup states, or of an arm at rest.
    """
    setup = as_setup(setup)
    log = as_motion(log, setup)
    if not isinstance(log, Poses):
        require_motion(setup, log)
    report, channels, steady, steps = None, None, None, tuple[Step, ...]()
    if crosstalk and isinstance(log, Poses):
        remedy = "give a log of motion, or leave it out"
        raise UsageError("gains and crosstalk are not found from static poses", field="crosstalk", remedy=remedy)
    progress("checking the setup")
    require_right(setup, [log], "identify", unchecked, looked_for=("sensor_axes",) if mounting else ())
    translation = (has_open_place(setup) and not _is_orientation(setup)) if translation is None else translation
    given, setup = setup.tool, with_guessed_tool(setup)
    progress("fitting the tool")
    if isinstance(log, Poses):
        found, report = identify_poses(setup, log, mounting, gravity)
    else:
        log = without_long_pauses(log)
        options = Options(joint_model=setup.joints.model)
        params = params_for_log.max_likelihood_params(setup, samples_from_log(log), options)

        def fit(log: Log) -> Identified:
            samples = params_for_log.useful_samples(log, params)
            samples = pad(samples, params_for_log.padded_length(len(log.t)))  # logs of different lengths share programs
            return identify_with_place(params, samples, options, mounting, gravity, translation)

        found = fit(log)
        if jumps := find_steps(log.t, found.left[: len(log.t)]):
            free = fit(with_steps(log, jumps))
            if is_gained(log, found.excess, free.excess):
                found, log, steps = free, with_steps(log, jumps), tuple(jumps)
        of_tool = _with_tool(setup, found, mounting, gravity)
        if crosstalk:
            progress("fitting gains and crosstalk")
            channels = find_channels(of_tool, log)
            setup, of_tool = (with_channels(each, channels) for each in (setup, of_tool))
        if bias or (channels is not None and channels.shown):
            steady = steady_bias(of_tool, log)
            known = np.nan_to_num(found.stderr)
            tool = replace(of_tool.tool, mass_std=known[0], center_of_mass_std=known[1:4])
            found = found._replace(bias=steady.value, bias_stderr=steady.std_with_tool(tool))
    if guessed := guessed_parameters(given, found.remarks):
        remarks = tuple(NOT_STATED if guess else remark for guess, remark in zip(guessed, found.remarks, strict=True))
        found = found._replace(values=np.where(guessed, np.nan, found.values), remarks=remarks)
    comments = {**setup.comments, **_comments(setup, found, mounting, gravity, bias)}
    result = replace(_with_tool(setup, found, mounting, gravity), comments=comments)
    if bias:
        result = replace(result, bias=_prior(result.bias, found, steady))
    return IdentifyResult(result, found, mounting, gravity, bias, report, channels, steps)


def _prior(stated: BiasSetup, found: Identified, steady: SteadyBias | None) -> BiasSetup:
    """The identified bias as the prior of later logs."""
    drift_std = stated.initial_drift_std if steady is None else steady.drift_std
    return replace(
        stated,
        initial=found.bias,
        initial_std=found.bias_stderr,
        initial_drift=np.zeros(6),
        initial_drift_std=drift_std,
    )


def _is_orientation(setup: Setup) -> bool:
    """Whether the setup's logs hold only the orientation of the sensor."""
    return setup.pose is not None and setup.pose.linear != "position"


def _with_tool(setup: Setup, found: Identified, mounting: bool, gravity: bool) -> Setup:
    tool = replace(setup.tool, mass=float(found.values[0]), center_of_mass=found.values[1:4], inertia=found.values[4:])
    if np.isfinite(found.stderr[0]):
        tool = replace(tool, mass_std=float(found.stderr[0]))
    if np.isfinite(found.stderr[1:4]).all():
        tool = replace(tool, center_of_mass_std=found.stderr[1:4])
    sensor, pose = setup.sensor, setup.pose
    if found.has_lever and pose is not None and _is_orientation(setup):
        pose = replace(pose, turns_about=pose.turns_about - found.lever)
    elif found.has_lever:
        lever = found.lever if pose is not None else sensor.rotation @ found.lever
        sensor = replace(sensor, translation=sensor.translation + lever)
    if mounting:
        sensor = replace(sensor, rotation=sensor.rotation @ rotation_from_vector(found.rotation))
    model_std = np.fmax(found.model_stderr, 0.0 if setup.bias.model_std is None else setup.bias.model_std)
    return replace(
        setup,
        tool=tool,
        pose=pose,
        sensor=sensor,
        bias=replace(setup.bias, model_std=model_std) if found.model_stderr.any() else setup.bias,
        robot=replace(setup.robot, gravity=found.gravity) if gravity else setup.robot,
    )


def _comments(setup: Setup, found: Identified, mounting: bool, gravity: bool, bias: bool) -> dict[str, str]:
    """Comments by key of the setup: standard errors of identified values, and why others are kept."""
    comments = {}
    for key, rows in (("mass", slice(0, 1)), ("center_of_mass", slice(1, 4)), ("inertia", slice(4, 10))):
        errors, remarks = found.stderr[rows], [remark for remark in found.remarks[rows] if remark]
        identified = "" if np.isnan(errors).all() else f"identified ± {plain_errors(errors)}"
        if identified or f"tool.{key}" not in setup.comments:  # a value that is kept keeps its origin
            comments[f"tool.{key}"] = "; ".join(x for x in (identified, *dict.fromkeys(remarks)) if x)
    if mounting:
        turned = with_errors(found.rotation, found.rotation_stderr)
        comments["sensor.rotation_rpy"] = f"turned by the identified {turned}"
    if gravity:
        comments["robot.gravity"] = f"identified ± {plain_errors(found.gravity_stderr)}"
    if found.has_lever:
        key = "sensor_pose.turns_about" if _is_orientation(setup) else "sensor.translation"
        comments[key] = f"identified ± {plain_errors(found.lever_stderr)}"
    if bias:
        comments["bias.initial"] = "of the log that the tool was identified from"
    return comments


MUCH = 5.0
"""Innovations this many times larger than the stated noise are not noise."""
SCATTERED = 6.25
"""Dispersion from which standard errors mostly show effects: 2.5 times those of the noise alone."""
NOT_BY_CHANCE = (
    "the errors include that, but what acts all along (a turned sensor, crosstalk, a tool that gives way) may have "
    "moved the tool by several of them: ftbias diagnose names it"
)
NOT_ALL = (
    "do not trust this tool before ftbias diagnose has said what else acts: a part that is carried (identify "
    "--payloads), a base that is not level (--gravity), a turned sensor (--mounting), a hose, contact, a delay, a unit"
)
WHY_IT_JUMPS = "a tare (state sensor.rezeroed_at), a touch, or a load that changed; the bias is free to jump there"


def motion_lines(found: Identified, steps: Sequence[Step]) -> list[str]:
    """Lines about the fit to a log of motion, and about the steps of its reading."""
    lines = [f"likelihood gained: {found.gain:.1f} nats; condition number of the excitation: {found.condition:.0f}"]
    if found.excess > MUCH:
        lines.append(f"what remains is {found.excess:.0f} times the noise stated: {NOT_ALL}")
    elif found.dispersion > SCATTERED:
        times = f"{found.dispersion**0.5:.0f} times"
        lines.append(f"parts of the log disagree {times} more than the noise stated explains, and {NOT_BY_CHANCE}")
    return lines + [f"the reading jumps on {step}: {WHY_IT_JUMPS}" for step in steps]


def plain_errors(values: np.ndarray) -> str:
    """Numbers for a comment in a setup; "-" = none."""
    return " ".join("-" if np.isnan(x) else f"{x:.2g}" for x in values)


def with_errors(values: np.ndarray, stderr: np.ndarray) -> str:
    """Numbers with their standard errors."""
    return ", ".join(f"{x:.4g} ± {e:.2g}" for x, e in zip(values, stderr, strict=True))
