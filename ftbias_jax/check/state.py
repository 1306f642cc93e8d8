"""Model of the logs as one bundle, of which each alternative changes one item."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ftbias_jax.check.bins import Bins, join_bins
from ftbias_jax.check.motion import SensorMotion, arm_motion, body_motion, data_matrices, in_sensor
from ftbias_jax.check.regression import Fit, Layout, Tool, fit, free_tool, make_layout, stated_tool
from ftbias_jax.setup.require import orientation_alone, with_guessed_tool
from ftbias_jax.setup.types import Setup, ToolSetup
from ftbias_jax.types import Array

MOST = 900
"""Maximum number of bins that are fitted; of more, evenly spread segments are."""
SEGMENT_BINS = 100
"""Bins per segment."""
FEWEST, FEWEST_POSES = 24, 12
"""Minimum number of bins, and of poses at rest, for any finding."""
HALF = 0.5
"""Share of the best axis's bins; an axis with fewer counts as not measured."""
LIGHTEST, FARTHEST = 0.01, 1.0
"""kg and m; a fitted tool that is lighter, or whose centre of mass is farther away, is discarded."""
STRONGEST = 100.0
"""N; no weight balancer that is missing from a setup pulls harder."""
PENALTY = 2e-3
"""Share of the raw variance below which a smaller residual is no evidence."""


@dataclass(frozen=True, eq=False)
class Case:
    """Bins of all logs, with their setup and layout."""

    setup: Setup
    bins: Bins
    log: Array
    """(N,) number of the log, or of a piece of it between two times at which the sensor was set to zero."""
    layout: Layout
    center_is_measured: bool = True
    """Whether the tool's centre of mass is stated by its owner, and not estimated from the wrench."""

    @property
    def wrench(self) -> Array:
        """(N, 6) N, Nm; zeros in axes that were not measured."""
        return np.where(self.layout.axes, self.bins.wrench, 0)

    @property
    def moves(self) -> bool:
        """Whether there is motion; otherwise these are poses at rest."""
        return bool(self.bins.dq.any() or self.bins.ddq.any())

    def trimmed(self, share: float) -> Case:
        """Return the case with this share of the bins trimmed in every fit."""
        return replace(self, layout=self.layout._replace(trim=share))


@dataclass(frozen=True, eq=False)
class State:
    """Model of the logs: motion, gravity, interpretation of the reading, and tool."""

    case: Case
    motion: SensorMotion
    gravity: Array
    wrench: Array
    """(N, 6) N, Nm, sensor frame, on the tool: the reading, corrected for the mistakes of this state."""
    tool: Tool
    unit: Array
    """(2,) factors by which the readings of force and torque were divided."""
    swapped: bool = False
    specific_force: Array | None = None
    """(N, 3) m/s^2, sensor frame."""
    delay: float = 0.0
    """s by which the wrench is stamped later than the motion."""
    lag: float = 0.0
    """s by which a low-pass filter on the wrench delays slow signals."""
    order: int = 1
    """Order of that low-pass filter: 1, or 2 for a Butterworth filter."""

    def but(self, **changes: Any) -> State:
        """Return the state with some fields changed."""
        return replace(self, **changes)

    @cached_property
    def data(self) -> Array:
        """Data matrix D (N, 6, 10), delayed and filtered like the wrench."""
        return self._stamped(data_matrices(self.motion, self.gravity, self.specific_force))

    @cached_property
    def of_tool(self) -> Array:
        """(N, 6) N, Nm, wrench of the nominal tool."""
        return self.data @ self.tool.theta

    def _stamped(self, values: Array) -> Array:
        """Delay and filter values (N, ...) like the wrench."""
        if self.delay:
            values = delayed(self.case, values, self.delay)
        return lagged(self.case, values, self.lag, self.order) if self.lag else values

    def fit(self, tool: Tool | None = None) -> Result:
        """Fit this tool, or the nominal one, by least squares."""
        done = fit(self.data, self.wrench, self.tool if tool is None else tool, self.case.layout)
        square = done.square * self.unit**2
        errors = done.errors * self.unit**2
        order = [1, 0] if self.swapped else [0, 1]
        return Result(done, square[order], errors[:, order])

    def fit_force(self, tool: Tool | None = None, *, pulled: bool = False) -> Result:
        """Fit the force alone, in the units of ``wrench``.

        If ``pulled``, a constant force in the base frame is fitted besides the tool, such as that of a weight balancer
        on a trolley.
        """
        force = np.arange(6) < 3
        D, tool = self.data, self.tool if tool is None else tool
        if pulled:
            pull = np.zeros((len(D), 6, 3))
            pull[:, :3] = self._stamped(self.motion.rotation.transpose(0, 2, 1))
            D = np.concatenate([D, pull], 2)
            reach = np.inf if np.isinf(tool.reach).all() else STRONGEST
            tool = Tool(np.append(tool.theta, np.zeros(3)), np.append(tool.reach, np.full(3, reach)))
        layout = self.case.layout
        done = fit(D, self.wrench * force, tool, layout._replace(axes=layout.axes & force))
        return Result(done, done.square, done.errors)


@dataclass(frozen=True, eq=False)
class Result:
    """A fit in the units and the order of the reading."""

    fit: Fit
    square: Array
    """(2,) mean squared error of force and torque, N^2 and Nm^2."""
    errors: Array
    """(N, 2) squared errors of every bin."""


@dataclass(frozen=True, eq=False)
class Alternative:
    """A state that differs from the stated one by one mistake."""

    mistake: str
    remedy: str
    state: State
    rank: float
    """Of equally good alternatives, the one with the lowest rank is reported."""
    groups: tuple[int, ...] = (0,)
    """What the alternative must explain: force (0), torque (1)."""
    setup: Mapping[str, Any] | None = None
    scale: bool = False
    """Whether it only scales the wrench or the tool."""
    like_tool: bool = True
    """Whether another tool may change the reading alike; if not, a free tool must be clearly worse."""


def case_of_bins(setup: Setup, parts: Sequence[Bins], are_poses: bool = False) -> Case | None:
    """Build the case of several logs from the bins of each; None if there are too few."""
    setup = orientation_alone(setup) if are_poses else setup
    bins = join_bins(parts)
    log = np.repeat(np.arange(len(parts)), [len(part.t) for part in parts])
    if bins.piece is not None:  # each piece between two tares has its own bias
        log = np.unique(np.stack([log, bins.piece]), axis=1, return_inverse=True)[1].reshape(-1)
    read = np.isfinite(bins.wrench)
    axes = read.sum(0) > HALF * max(read.sum(0).max(initial=0), 1)
    rows = np.flatnonzero(read[:, axes].all(1)) if axes.any() else np.zeros(0, int)
    if len(rows) < (FEWEST if bins.dq.any() or bins.ddq.any() else FEWEST_POSES):
        return None
    if len(rows) > MOST:
        starts = np.linspace(0, len(rows) - SEGMENT_BINS, MOST // SEGMENT_BINS).astype(int)
        rows = rows[np.unique((starts[:, None] + np.arange(SEGMENT_BINS)).ravel())]
    bins = Bins(*(None if x is None else x[rows] for x in bins))
    measured = not setup.tool.unknown and not setup.tool.has_errors(("center_of_mass",))
    case = Case(setup, bins, log[rows], make_layout(bins.t, log[rows], axes), measured)
    return _with_likeliest_tool(case) if setup.tool.unknown else case


def _with_likeliest_tool(case: Case) -> Case:
    """Return the case with a tool fitted to the logs, with either sign, where the setup does not state one."""
    guessed = with_guessed_tool(case.setup)
    state = stated(replace(case, setup=guessed))
    m, *moment = state.fit(free_tool(state.tool)).fit.theta[:4]
    center = np.array(moment) / m if abs(m) > LIGHTEST else np.full(3, np.inf)
    if np.linalg.norm(center) > FARTHEST:
        return replace(case, setup=guessed)
    tool = replace(guessed.tool, mass=abs(float(m)), center_of_mass=center)
    return replace(case, setup=replace(guessed, tool=tool))


def stated(case: Case) -> State:
    """Return the state as the setup states it."""
    setup, bins = case.setup, case.bins
    joints, specific_force = (bins.q, bins.dq, bins.ddq), None
    motion = arm_motion(setup.robot, setup.sensor, *joints) if setup.pose is None else motion_of_pose(setup, *joints)
    if bins.acceleration is not None:
        specific_force = in_sensor(motion, bins.acceleration - setup.robot.gravity)
    tool, gravity = stated_tool(known_tool(setup)), setup.robot.gravity
    delay = float(setup.effects.get("time_delay", {}).get("delay", 0.0))
    return State(case, motion, gravity, case.wrench, tool, np.ones(2), specific_force=specific_force, delay=delay)


def motion_of_pose(setup: Setup, q: Array, dq: Array, ddq: Array, *, in_body: bool = False) -> SensorMotion:
    """Motion of a sensor whose pose was recorded; arguments as for ``motion.body_motion``."""
    assert setup.pose is not None
    lever = setup.pose.lever(setup.sensor.translation)
    return body_motion(setup.sensor, lever, q, dq, ddq, in_body=in_body)


def known_tool(setup: Setup) -> ToolSetup:
    """Tool with the mass and centre of mass of [effects], where these state them."""
    mass = setup.effects.get("tool_mass", {}).get("mass", setup.tool.mass)
    center = setup.effects.get("tool_com", {}).get("center_of_mass", setup.tool.center_of_mass)
    return replace(setup.tool, mass=float(mass), center_of_mass=np.asarray(center, float))


def delayed(case: Case, values: Array, delay: float) -> Array:
    """Interpolate values (N, ...) of bins at ``delay`` s earlier, separately for each log."""
    flat, result = values.reshape(len(values), -1), np.empty((len(values), values[0].size))
    for number in np.unique(case.log):
        rows = case.log == number
        t = case.bins.t[rows]
        result[rows] = np.stack([np.interp(t - delay, t, column) for column in flat[rows].T], 1)
    return result.reshape(values.shape)


def lagged(case: Case, values: Array, time: float, order: int = 1) -> Array:
    """Filter values (N, ...) of bins by a first-order low pass, or a Butterworth filter, that delays by ``time``, s."""
    step = float(np.median(np.diff(case.bins.t)))
    x = np.clip(np.arange(-0.5, 5 * time / step + 1) * step / time, 0, None)
    # Step response after x delays.
    passed = 1 - np.exp(-x) if order == 1 else 1 - np.sqrt(2) * np.exp(-x) * np.sin(x + np.pi / 4)
    kernel = np.diff(passed) / passed[-1]
    flat = values.reshape(len(values), -1)
    padded = np.concatenate([np.repeat(flat[:1], len(kernel) - 1, 0), flat])
    return np.stack([np.convolve(column, kernel, "valid") for column in padded.T], 1).reshape(values.shape)
