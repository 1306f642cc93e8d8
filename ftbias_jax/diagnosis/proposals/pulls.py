"""Candidate anchors of a cable, as starting points of its fit, because its likelihood has many maxima.

The vector from the near to the far end is affine in the anchor, so many anchors cost no more than four.
"""

from collections.abc import Collection

import numpy as np

from ftbias_jax.diagnosis.evidence.estimates import parameters
from ftbias_jax.diagnosis.hypothesis import Found, Hypothesis, at_values, neutral_of, places_of, search_of, searched_by
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.regression.evaluate import readings, sensor_axes, whitened, whitened_single
from ftbias_jax.diagnosis.regression.fit import Fit
from ftbias_jax.diagnosis.regression.score_test import PreparedFit, gain_of_each, gains
from ftbias_jax.diagnosis.thresholds import FARTHEST, LONGEST_CABLE, PULLS_FITTED, UNDETERMINED
from ftbias_jax.model.effects.catalogue import Catalogue
from ftbias_jax.model.effects.fitting import Pull
from ftbias_jax.model.effects.types import Effect, Signals
from ftbias_jax.runtime.kept_programs import keep_program
from ftbias_jax.types import Array

ANCHORS = 40
"""Number of random anchors tried for each link."""
FOREARM = (2, 3, 4)
"""Links that may carry the far end, counted back from the last."""
SLACK = (0.0, 0.6, 0.9)
"""Rest lengths that are tried, as shares of the shortest distance."""
APART = 0.25
"""m; anchors nearer to each other lead to the same maximum."""


def pulls(problem: Problem, prepared_fit: PreparedFit, taken: Collection[str]) -> list[Found]:
    """Most promising anchors of every elastic pull, with their gains in nats over a fit."""
    wanted = searched_by(problem, taken, Pull)
    return [found for effect in wanted for found in _anchors(problem, prepared_fit, effect)]


def _anchors(problem: Problem, prepared_fit: PreparedFit, effect: Effect) -> list[Found]:
    search, model = search_of(effect, Pull), problem.parts[0].signals.model
    n, reach = problem.joints, max(float(np.linalg.norm(model.arm.zero_position)), 0.5)
    attachment = neutral_of(problem, effect, search.attachment)
    rng = np.random.default_rng(0)
    found: list[tuple[float, float, float, np.ndarray, int]] = []
    for link in dict.fromkeys((0, *(max(n - back, 0) for back in FOREARM))):
        spans = _spans(problem, effect, link, attachment)
        near = rng.uniform(0.2, 0.9, (ANCHORS, 1)) * np.asarray(model.arm.zero_position) if link else 0.0
        anchors = near + rng.uniform(-1, 1, (ANCHORS, 3)) * (0.3 if link else 0.7 * reach)
        linear = whitened(problem, _on_tool(spans, attachment))
        anchors = np.concatenate([anchors, _without_slack(prepared_fit, linear)])
        columns, rests = _pulls(problem, spans, linear, anchors, attachment)
        gain, stiffness = gain_of_each(prepared_fit, columns)
        gain = np.where(stiffness > 0, gain, 0)  # a cable never pushes
        every = zip(gain.tolist(), stiffness.tolist(), rests, np.repeat(anchors, len(SLACK), 0), strict=True)
        found += [(*one, link) for one in every]
    chosen: list[Found] = []
    kept: list[tuple[np.ndarray, int]] = []
    for gain_of, k, rest, anchor, link in sorted(found, key=lambda one: -one[0]):
        if all(other != link or np.linalg.norm(anchor - place) > APART for place, other in kept):
            values: dict[str, np.ndarray | float] = {search.stiffness: k, search.rest_length: rest}
            values |= {search.anchor: anchor, search.attachment: attachment}
            fixed = tuple(places_of(problem, effect, **{search.link: float(link)}).items())
            chosen.append((gain_of, at_values(problem, effect, **values)._replace(fixed=fixed, group=len(chosen))))
            kept.append((anchor, link))
        if len(chosen) == PULLS_FITTED:
            break
    return chosen


@keep_program("name", "catalogue")
def _span(signals: Signals, anchor: Array, attachment: Array, link: Array, *, name: str, catalogue: Catalogue) -> Array:
    search = search_of(catalogue[name], Pull)
    return search.span({search.anchor: anchor, search.attachment: attachment, search.link: link}, signals)


def _spans(problem: Problem, effect: Effect, link: int, attachment: np.ndarray) -> np.ndarray:
    """(4, U, 3) m, sensor frame: near end to the link's origin at q = 0, and changes per metre of the anchor's axes."""
    corners = np.concatenate([np.zeros((1, 3)), np.eye(3)])
    fixed, what = (attachment, np.asarray(float(link))), {"name": effect.name, "catalogue": problem.catalogue}
    parts = []
    for part in problem.parts:
        signals = part.signals._replace(motion=part.nominal)
        ends = [_span(signals, corner, *fixed, **what) for corner in corners]
        parts.append(np.stack([np.asarray(span)[: part.used] for span in ends]))
    spans = np.concatenate(parts, axis=1)
    spans[1:] -= spans[0]
    return spans


def _pulls(
    problem: Problem, spans: np.ndarray, linear: np.ndarray, anchors: np.ndarray, attachment: np.ndarray
) -> tuple[np.ndarray, list[float]]:
    """Cables of 1 N/m from A anchors, each with every slack: whitened changes of the reading, and rest lengths in m.

    Only the unit vectors along a cable are whitened for each anchor. The rest of its pull is linear in the anchor and
    given in ``linear`` (4, U, 6), whitened. Returns (A S, U, 6) in single precision, S = slacks, and A S lengths.
    """
    linear, anchors, spans = (x.astype(np.float32) for x in (linear, anchors, spans))
    span = spans[0] + np.tensordot(anchors, spans[1:], 1)
    length = np.maximum(np.sqrt(np.einsum("aui,aui->au", span, span)), 1e-6)
    along = whitened_single(problem, list(_on_tool(span / length[:, :, None], attachment)))
    rests = np.outer(length.min(1), SLACK).astype(np.float32)
    taut = linear[0] + np.tensordot(anchors, linear[1:], 1)
    columns = taut[:, None] - rests[:, :, None, None] * along[:, None]
    return columns.reshape(-1, *taut.shape[1:]), rests.ravel().tolist()


def _on_tool(force: np.ndarray, attachment: np.ndarray) -> np.ndarray:
    """(..., 3) N -> (..., 6) N, Nm: change of the reading by a force on the tool at the attachment (3,) m."""
    arm = np.concatenate([np.eye(3), np.cross(attachment, np.eye(3))], 1)
    return -force @ arm.astype(force.dtype)


def _without_slack(prepared_fit: PreparedFit, linear: np.ndarray) -> np.ndarray:
    """(0 or 1, 3) m: best anchor of a cable without rest length, which is linear in k and k times the anchor."""
    best = gains(prepared_fit, linear).coefficients(list(range(4)))  # k, then k times the anchor
    anchor = best[None, 1:] / max(float(best[0]), 1e-12)
    return anchor[(np.abs(anchor).max(1) < FARTHEST) & (best[0] > 0)]


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why a cable may be something else: a long, soft one makes nearly any force, so that force is reported."""
    values, stderr = parameters(problem, found, h)
    search, arm = search_of(problem.catalogue[h.effect], Pull), problem.parts[0].signals.model.arm
    apart = float(np.linalg.norm(np.asarray(values[search.anchor]) - np.asarray(arm.zero_position)))
    far = apart > FARTHEST or float(np.max(values[search.rest_length])) > LONGEST_CABLE
    loose = max(np.max(stderr[search.anchor]), np.max(stderr[search.rest_length])) > UNDETERMINED
    if not (far or loose):
        return ""
    why = "such a cable is not plausible" if far else "its length and anchor are not determined"
    mean, varies = equivalent_force(problem, found, h)
    size = ", ".join(f"{x:.2g}" for x in mean)
    force = f"({size}) N in base axes on the tool, varying by {varies:.2g} N"
    return f"; {why}, and any similar force explains the log as well: {force}"


def equivalent_force(problem: Problem, found: Fit, h: Hypothesis) -> tuple[np.ndarray, float]:
    """Mean (3,) N on the tool, base axes, of the pull of a fit, and its standard deviation in N."""
    stiffness = search_of(problem.catalogue[h.effect], Pull).stiffness
    z = np.stack([found.z, found.z])
    z[1, problem.layout.slices[h.effect, stiffness]] = 0
    with_it, without = readings(problem, z)
    force = -np.einsum("tij,tj->ti", sensor_axes(problem), (with_it - without)[:, :3])
    return force.mean(0), float(np.sqrt(force.var(0).sum()))
