"""Which alternative is named: one that explains what neither the setup nor a small effect nor another tool does."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ftbias_jax.check.regression import BLOCKS, exactly, free_tool, no_tool, without_bias
from ftbias_jax.check.state import PENALTY, Alternative, Result, State
from ftbias_jax.types import Array

BAD = 0.3
"""Share of the raw variance that the stated model must leave before another is looked for: effects of the catalogue at
their typical size leave 0.1 and less."""
BETTER = 0.25
"""Share of what the stated model leaves that an alternative may leave."""
DOUBTFUL, FAR_BETTER = 0.05, 0.03
"""The same two where the stated model leaves less: no effect is explained that well by a mistake. A sensor that turns
about one axis may be mounted wrong, and the stated tool still explains most of its reading."""
OF_JOINTS = 0.02
"""Share of the raw variance, and of what the stated model leaves, that another order, direction or zero of a joint may
leave: there are dozens, and one of them may lie where a strong cable pulls (0.05)."""
GOOD, GOOD_TOUCHED = 0.3, 0.1
"""Share of the raw variance that it may leave, and where most bins are left out, so that it may choose its own."""
SAME = 1.5
"""Factor within which another tool does as well as an alternative."""
SLACK = 0.01
"""Share of the raw variance that is added to that."""
TIE = 0.35
"""Difference of scores within which two alternatives do equally well."""
SURE = 3.0
"""Standard errors over blocks by which an alternative must be better."""
SHARED = 0.8
"""Of the bins that an alternative explains, the share that the fit it is compared with must have kept, too."""
ABSENT = 0.2
"""Coefficient of the tool's wrench below which it is not in the reading."""
CLEAR = 3.0
"""Times the noise of a bin that the tool's wrench must vary to be missed."""
CLEARLY = 2.0
"""Times the noise of a bin that a reading must vary to show anything."""
BY_EFFECTS = 0.1
"""Share of the raw variance that effects of the catalogue leave where the tool is free."""
TOO_NEAR = 0.06
"""m by which a centre of mass is often stated too near to the sensor."""
LEVER = 0.5
"""m: no tool's centre of mass is farther off."""


class Share(NamedTuple):
    """How much of the tool's wrench is in the reading."""

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
        """With none at all."""
        return self.state.fit(no_tool())

    @cached_property
    def exact(self) -> Array:
        """(2,) with the tool as stated."""
        return self.state.fit(exactly(self.state.tool)).square

    @cached_property
    def result(self) -> Result:
        """With a tool near the stated one."""
        return self.state.fit()

    @cached_property
    def free(self) -> Result | None:
        """With any tool that could exist; None if the best one could not."""
        free = self.state.fit(free_tool(self.state.tool))
        return free if is_possible(free.fit.theta) else None

    @property
    def left(self) -> Array:
        """(2,) share of the raw variance that the setup leaves."""
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
        """Of the force alone, with a tool near the stated one and a steady force along axes of the base."""
        return self.state.fit_force(pulled=True)


def is_possible(theta: Array) -> bool:
    """Whether a tool of these inertial parameters could exist."""
    return bool(theta[0] > 0 and np.linalg.norm(theta[1:4]) < LEVER * theta[0])


Tried = tuple[Alternative, Result]


def best_alternatives(base: Evidence, alternatives: Iterable[Alternative]) -> list[Tried]:
    """The alternatives that are decisively better than the stated model and do equally well, the most common first."""
    varies = np.sqrt(base.raw) > CLEARLY * noise_of_bins(base.state)
    if not (base.left > DOUBTFUL).any() or not varies.any():  # nothing but noise shows nothing
        return []
    tried = [(alternative, alternative.state.fit()) for alternative in alternatives]
    good = [(a, r) for a, r in tried if _is_named(base, a, r)]
    right_but_for_the_tool = base.free is not None and (base.free.square < BAD * base.raw)[0]
    if not good and not right_but_for_the_tool:  # the tool may be wrong, too
        tried = [(a, a.state.fit(free_tool(a.state.tool))) for a, _ in tried if not a.scale]
        good = [(a, r) for a, r in tried if is_possible(r.fit.theta) and _is_named(base, a, r, any_tool=True)]
    best = max((score(base, result) for _, result in good), default=0.0)
    return sorted(((a, r) for a, r in good if score(base, r) > best - TIE), key=lambda pair: pair[0].rank)


def slightly(base: Evidence, alternatives: Iterable[Alternative]) -> list[Tried]:
    """The alternatives that are better at all, by more than chance: for what only a mistake can have brought about."""
    tried = [(alternative, alternative.state.fit()) for alternative in alternatives]
    enough = score(base, base.result) + TIE
    return [(a, r) for a, r in tried if score(base, r) > enough and _is_sure(base, a, r)]


def noise_of_bins(state: State) -> Array:
    """(2,) standard deviation of the mean force and torque of a bin, N and Nm, all axes together."""
    noise = state.case.setup.sensor.noise_std.reshape(2, 3)
    return np.sqrt((noise**2).sum(1) / np.median(state.case.bins.count))


def is_pulled(base: Evidence) -> bool:
    """Whether the stated tool and a steady force along axes of the base explain a force that no tool explains.

    A weight balancer pulls like this: it makes the model worse than nothing, but the setup is right. A tool that is
    stated wrong leaves little with another tool.
    """
    state = base.state
    raw, free, pulled = state.fit_force(no_tool()), state.fit_force(free_tool(state.tool)), base.pulled
    if free.square[0] < BY_EFFECTS * raw.square[0] or pulled.square[0] > BETTER * free.square[0]:
        return False
    return decisively(free, pulled, (0,), state.case.layout.block)


def score(base: Evidence, result: Result) -> float:
    """Logarithm of the share that is left, force and torque; larger is better."""
    return float(-np.log(result.square / base.raw + PENALTY).sum())


def decisively(base: Result, better: Result, groups: tuple[int, ...], layout_block: Array) -> bool:
    """Whether force (group 0) or torque (1) of a fit is better on blocks (N,) held out, by more than chance."""
    rows, most = base.fit.kept & better.fit.kept, np.full(2, np.inf)
    if rows.sum() < SHARED * better.fit.kept.sum():
        # Each keeps what it explains: all bins count, and what the better fit takes for contact is as bad for both.
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
    absent = alternative.mistake == "base_frame_wrench"  # its weight does not turn, so that little variance is there
    bad, doubtful = stated > BAD, stated > DOUBTFUL
    if alternative.mistake == "joint_convention" and not (left < OF_JOINTS * np.minimum(stated, 1)).all():
        return False
    if not ((bad & (left < BETTER * stated)) | (doubtful & (left < FAR_BETTER * stated))).all():
        return False
    if absent:
        return score(base, result) > TIE + float(-np.log(np.ones(2) + PENALTY).sum()) and _is_sure(
            base, alternative, result
        )
    touched = base.state.case.layout.touched
    if not (left < (GOOD_TOUCHED if touched else GOOD)).all():
        return False
    if groups == [1] and result.square[0] > BAD * base.raw[0]:
        return False  # what is wrong with the force comes first
    other = [1 - group for group in groups if 1 - group not in groups]
    if other and not any_tool and (result.square > 2 * np.maximum(base.result.square, base.raw))[other].any():
        return False
    if base.free is not None:
        free = (base.free.square / base.raw)[groups]
        if not (left < SAME * free + SLACK).all() or (any_tool and not (left < BETTER * free).all()):
            return False
        if alternative.scale and (free < BAD).all() and not _is_nearer(base, alternative, result, base.free):
            return False
    return _is_sure(base, alternative, result) and not _is_but_pulled(base, alternative, any_tool)


def _is_nearer(base: Evidence, alternative: Alternative, result: Result, free: Result) -> bool:
    """Whether in other units the tool is much nearer to what is stated than the tool that needs no other unit.

    Any unit explains a torque with a centre of mass that is as much nearer or farther: a centre of mass that is stated
    some centimetres too near is more common.
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
    """Whether, with a steady force along axes of the base, the stated axes explain more of the force than others do.

    Such a force turns with the weight in the sensor's axes, and a sensor that is turned imitates it in part. With the
    force in both fits only the axes differ: where poses differ too little to tell, neither is better.
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
