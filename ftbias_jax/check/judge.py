"""Decide which alternative is reported: one that explains what the setup, a small effect or another tool does not."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ftbias_jax.check.regression import BLOCKS, exactly, free_tool, no_tool, without_bias
from ftbias_jax.check.state import PENALTY, Alternative, Result, State
from ftbias_jax.types import Array

BAD = 0.3
"""Residual of the stated model, as a share of the raw variance, above which an alternative is sought: effects of the
catalogue at their typical size leave 0.1 or less."""
BETTER = 0.25
"""Maximum residual of an alternative relative to that of the stated model."""
DOUBTFUL, FAR_BETTER = 0.05, 0.03
"""The same two limits for a stated model with a smaller residual: no effect is explained that well by a mistake. If a
sensor turns about one axis only, it may be mounted wrong while the stated tool still explains most of its reading."""
OF_JOINTS = 0.02
"""Maximum residual of another order, direction or zero of a joint, relative to the raw variance and to the stated
model's residual: there are dozens of these, and one of them may by chance fit a strong cable's pull (residual 0.05)."""
GOOD, GOOD_STRICT = 0.3, 0.1
"""Maximum residual of an alternative as a share of the raw variance; the second one where a fit may trim most bins, and
for another unit in motion, which resembles a controller that subtracts some of the weight."""
SAME = 1.5
"""Maximum residual of an alternative relative to that of a free tool with the setup as stated."""
SLACK = 0.01
"""Share of the raw variance that is added to that limit."""
TIE = 0.35
"""Difference of scores within which two alternatives count as equally good."""
SURE = 3.0
"""Standard errors, over blocks, by which an alternative must be better."""
SHARED = 0.8
"""Share of the bins kept by the better fit that the fit it is compared with must have kept, too."""
ABSENT = 0.2
"""Regression coefficient of the tool's wrench below which it is absent from the reading."""
CLEAR = 3.0
"""Minimum variation of the tool's wrench, in units of the noise of a bin, for its absence to be detectable."""
CLEARLY = 2.0
"""Minimum variation of a reading, in units of the noise of a bin, for any mistake to be detectable."""
BY_EFFECTS = 0.1
"""Share of the raw variance that effects of the catalogue leave when the tool is free."""
TOO_NEAR = 0.06
"""m by which a centre of mass is often stated too close to the sensor."""
LEVER = 0.5
"""m; no tool's centre of mass is farther from the sensor."""


class Share(NamedTuple):
    """Regression coefficient of the reading on the stated tool's wrench."""

    value: float
    stderr: float
    clear: bool
    """Whether the tool's wrench varies by more than the noise."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """How well the setup as stated explains the reading."""

    state: State

    @cached_property
    def raw(self) -> Array:
        """(2,) variance of the reading without bias and drift, force and torque: N^2, Nm^2."""
        return self.without_tool.square + 1e-30

    @cached_property
    def without_tool(self) -> Result:
        """Fit without any tool."""
        return self.state.fit(no_tool())

    @cached_property
    def exact(self) -> Array:
        """(2,) residual variance with the tool exactly as stated, N^2 and Nm^2."""
        return self.state.fit(exactly(self.state.tool)).square

    @cached_property
    def result(self) -> Result:
        """Fit with a tool near the stated one."""
        return self.state.fit()

    @cached_property
    def free(self) -> Result | None:
        """Fit with a free tool; None if the best-fitting tool is physically impossible."""
        free = self.state.fit(free_tool(self.state.tool))
        return free if is_possible(free.fit.theta) else None

    @property
    def left(self) -> Array:
        """(2,) residual of the setup as a share of the raw variance."""
        return self.result.square / self.raw

    @cached_property
    def shares(self) -> tuple[Share, Share]:
        """Regression of force and torque on those of the stated tool, with bias and drift free."""
        state, layout = self.state, self.state.case.layout
        rows = self.without_tool.fit.kept
        rows = rows if layout.touched else rows & self.result.fit.kept
        reading, tool = (without_bias(x, layout)[rows].reshape(-1, 2, 3) for x in (state.wrench, state.of_tool))
        blocks = np.unique(layout.block[rows], return_inverse=True)[1]
        clear = np.sqrt((tool**2).sum(2).mean(0)) > CLEAR * noise_of_bins(state)

        def share(group: int) -> Share:
            above, below = (np.bincount(blocks, (x * tool)[:, group].sum(1)) for x in (reading, tool))
            without = (above.sum() - above) / np.maximum(below.sum() - below, 1e-300)
            stderr = np.sqrt((len(without) - 1) * np.mean((without - without.mean()) ** 2))
            return Share(float(above.sum() / max(below.sum(), 1e-300)), float(stderr), bool(clear[group]))

        return share(0), share(1)

    @cached_property
    def pulled(self) -> Result:
        """Fit of the force alone, with a tool near the stated one and a constant force in the base frame."""
        return self.state.fit_force(pulled=True)


def is_possible(theta: Array) -> bool:
    """Whether a tool of these inertial parameters could exist."""
    return bool(theta[0] > 0 and np.linalg.norm(theta[1:4]) < LEVER * theta[0])


Tried = tuple[Alternative, Result]


def best_alternatives(base: Evidence, alternatives: Iterable[Alternative]) -> list[Tried]:
    """Return the equally good alternatives that are decisively better than the stated model, the most common first."""
    varies = np.sqrt(base.raw) > CLEARLY * noise_of_bins(base.state)
    if not (base.left > DOUBTFUL).any() or not varies.any():  # a reading of noise alone shows no mistake
        return []
    tried = [(alternative, alternative.state.fit()) for alternative in alternatives]
    good = [(a, r) for a, r in tried if _is_named(base, a, r)]
    right_but_for_the_tool = base.free is not None and (base.free.square < BAD * base.raw)[0]
    if not good and not right_but_for_the_tool:  # the tool may be wrong, too
        tried = [(a, a.state.fit(free_tool(a.state.tool))) for a, _ in tried if not a.scale]
        good = [(a, r) for a, r in tried if is_possible(r.fit.theta) and _is_named(base, a, r, any_tool=True)]
    best = max((score(base, result) for _, result in good), default=0.0)
    ties = [(a, r) for a, r in good if score(base, r) > best - TIE]
    return sorted(ties, key=lambda pair: (pair[0].rank, _departure(*pair) if pair[0].scale else 0.0))


def _departure(alternative: Alternative, result: Result) -> float:
    """How far the fitted tool is from the stated one, in semi-axes: of two units, the one that needs no other tool."""
    tool = alternative.state.tool
    return float(np.linalg.norm((result.fit.theta - tool.theta) / np.maximum(tool.reach, 1e-12)))


def slightly(base: Evidence, alternatives: Iterable[Alternative]) -> list[Tried]:
    """Return alternatives that are better by any margin beyond chance, for signs that only a mistake can cause."""
    tried = [(alternative, alternative.state.fit()) for alternative in alternatives]
    enough = score(base, base.result) + TIE
    better = [(a, r) for a, r in tried if score(base, r) > enough and _is_sure(base, a, r)]
    return [(a, r) for a, r in better if a.like_tool or _beats_any_tool(base, a, r)]


def _beats_any_tool(base: Evidence, alternative: Alternative, result: Result) -> bool:
    """Return whether an alternative leaves no more than effects do, and clearly less than the stated or any tool."""
    groups = list(alternative.groups)
    least = base.result.square if base.free is None else np.minimum(base.result.square, base.free.square)
    return bool((result.square < np.minimum(DOUBTFUL * base.raw, BETTER * least))[groups].all())


def noise_of_bins(state: State) -> Array:
    """(2,) standard deviation of the mean force and torque of a bin, N and Nm, all axes together."""
    noise = state.case.setup.sensor.noise_std.reshape(2, 3)
    return np.sqrt((noise**2).sum(1) / np.median(state.case.bins.count))


def much_is_left(base: Evidence) -> bool:
    """Return whether the setup exactly as stated leaves more of the reading than noise and the usual effects do."""
    noise = (CLEARLY * noise_of_bins(base.state)) ** 2
    return bool((base.exact > np.maximum(BY_EFFECTS * base.raw, noise)).any())


def is_pulled(base: Evidence) -> bool:
    """Return whether the stated tool and a constant force in the base frame explain a force that no tool explains.

    A weight balancer exerts such a force: the model is then worse than none although the setup is right. If the tool is
    stated wrong, another tool leaves a small residual instead.
    """
    state = base.state
    raw, free, pulled = state.fit_force(no_tool()), state.fit_force(free_tool(state.tool)), base.pulled
    if free.square[0] < BY_EFFECTS * raw.square[0] or pulled.square[0] > BETTER * free.square[0]:
        return False
    return decisively(free, pulled, (0,), state.case.layout.block)


def score(base: Evidence, result: Result) -> float:
    """Minus the sum of the logarithms of the residual shares of force and torque; larger is better."""
    return float(-np.log(result.square / base.raw + PENALTY).sum())


def decisively(base: Result, better: Result, groups: tuple[int, ...], layout_block: Array) -> bool:
    """Return whether force (group 0) or torque (1) of a fit is significantly better on the held-out blocks (N,)."""
    rows, most = base.fit.kept & better.fit.kept, np.full(2, np.inf)
    if rows.sum() < SHARED * better.fit.kept.sum():
        # Each keeps the bins it explains: compare all, with errors capped at the largest one that the better fit keeps.
        rows, most = np.ones(len(rows), bool), better.errors[better.fit.kept].max(0)
    ratio = []
    for block in np.unique(layout_block[rows]):
        inside = rows & (layout_block == block)
        sums = [sum(np.minimum(r.errors[inside, g], most[g]).mean() for g in groups) for r in (base, better)]
        ratio.append(np.log((sums[0] + 1e-30) / (sums[1] + 1e-30)))
    if len(ratio) < BLOCKS // 4:
        return False
    mean, spread = np.mean(ratio), np.std(ratio) / np.sqrt(len(ratio))
    return bool(mean > SURE * spread)


def _is_named(base: Evidence, alternative: Alternative, result: Result, *, any_tool: bool = False) -> bool:
    groups = list(alternative.groups)
    left, stated = (result.square / base.raw)[groups], base.left[groups]
    absent = alternative.mistake == "base_frame_wrench"  # its weight does not turn, so its variance is small
    bad, doubtful = stated > BAD, stated > DOUBTFUL
    if alternative.mistake == "joint_convention" and not (left < OF_JOINTS * np.minimum(stated, 1)).all():
        return False
    if not ((bad & (left < BETTER * stated)) | (doubtful & (left < FAR_BETTER * stated))).all():
        return False
    if absent:
        return score(base, result) > TIE + float(-np.log(np.ones(2) + PENALTY).sum()) and _is_sure(
            base, alternative, result
        )
    strict = base.state.case.layout.touched or (alternative.scale and base.state.case.moves)
    if not (left < (GOOD_STRICT if strict else GOOD)).all():
        return False
    if not (alternative.like_tool or _beats_any_tool(base, alternative, result)):
        return False
    if groups == [1] and result.square[0] > BAD * base.raw[0]:
        return False  # a mistake in the force is resolved first
    other = [1 - group for group in groups if 1 - group not in groups]
    if other and not any_tool and (result.square > 2 * np.maximum(base.result.square, BAD * base.raw))[other].any():
        return False
    if base.free is not None:
        free = (base.free.square / base.raw)[groups]
        if not (left < SAME * free + SLACK).all() or (any_tool and not (left < BETTER * free).all()):
            return False
        if alternative.scale and (free < BAD).all() and not _is_nearer(base, alternative, result, base.free):
            return False
    return _is_sure(base, alternative, result) and not _is_but_pulled(base, alternative, any_tool)


def _is_nearer(base: Evidence, alternative: Alternative, result: Result, free: Result) -> bool:
    """Return whether changed units bring the fitted tool much nearer to the stated one than the stated units do.

    A wrong unit of torque is indistinguishable from a centre of mass nearer or farther by the same factor: a centre of
    mass that is stated some centimetres too close is more common.
    """

    def sizes(theta: Array) -> tuple[float, float]:
        m = abs(float(theta[0])) + 1e-9
        return m, float(np.linalg.norm(theta[1:4])) / m + 1e-9

    group = alternative.groups[0]
    stated, own = sizes(base.state.tool.theta), sizes(free.fit.theta)
    other = sizes(result.fit.theta)[group] / sizes(alternative.state.tool.theta)[group]
    merely_off = group == 1 and stated[1] < own[1] < stated[1] + TOO_NEAR
    return not merely_off and abs(np.log(other)) < abs(np.log(own[group] / stated[group])) / 2


def _is_but_pulled(base: Evidence, alternative: Alternative, any_tool: bool) -> bool:
    """Return whether the stated axes explain the force better than others once a constant base-frame force is fitted.

    In the sensor's axes such a force turns with the weight, and a rotated sensor partly mimics it. With the force in
    both fits only the axes differ: if the poses differ too little, neither fit is better.
    """
    if alternative.mistake != "sensor_axes":
        return False
    if any_tool:
        stated = base.state.fit_force(free_tool(base.state.tool), pulled=True)
        other = alternative.state.fit_force(free_tool(alternative.state.tool), pulled=True)
    else:
        stated, other = base.pulled, alternative.state.fit_force(pulled=True)
    return bool(stated.square[0] < other.square[0]) and decisively(other, stated, (0,), base.state.case.layout.block)


def _is_sure(base: Evidence, alternative: Alternative, result: Result) -> bool:
    return decisively(base.result, result, alternative.groups, base.state.case.layout.block)
