"""Events of any shape in time, such as contacts: when something pushed the tool, and with which wrench."""

from collections.abc import Collection, Sequence

import numpy as np

from ftbias_jax.diagnosis import thresholds
from ftbias_jax.diagnosis.hypothesis import Event, Found, Hypothesis, penalty, searched_by
from ftbias_jax.diagnosis.problem import Problem
from ftbias_jax.diagnosis.proposals.series import Dictionary
from ftbias_jax.diagnosis.regression.design_matrix import step_and_gain
from ftbias_jax.diagnosis.regression.evaluate import whitened_series
from ftbias_jax.diagnosis.regression.fit import Fit, projection
from ftbias_jax.diagnosis.regression.series import shaped, shaped_events
from ftbias_jax.model.effects.fitting import Touches
from ftbias_jax.model.wrench.inertia import center_of_mass

SHAPES, SHAPES_IF_SEEN = (4, 8, 16, 32), (2, 8, 32, 128)
"""Maximum numbers of tent basis functions of an event of any shape, and of a contact that a filter detects."""
TRIMS, TRIM_TENTS = 3, 32
REWEIGHTINGS = 4


def touches(
    problem: Problem, dictionary: Dictionary, accepted: Fit, taken: Collection[str], smooth: np.ndarray
) -> list[Found]:
    """Events that stand out, as one hypothesis with wrenches of any shape, with its gain; for every such effect.

    They are detected, but not judged, in the residual of ``smooth`` (M, U, 6), derivatives of other possible causes.
    """
    names = [effect.name for effect in searched_by(problem, taken, Touches)]
    if not names or not dictionary.events:
        return []
    alone, found = robust_rest(smooth, accepted.error), list[Found]()
    # A long contact is detected more reliably by its sudden ends, as a filter does, than as a sum of pulses, of which
    # other causes would absorb a part.
    seen = [Event(log, one.start, one.end) for log, part in enumerate(problem.parts) for one in part.touched.contacts]
    origins = ((_pursue(dictionary, alone), alone), (seen, accepted.error))
    for name in names:
        ways = [(_trimmed(problem, name, error, merge(events)), error, SHAPES) for events, error in origins if events]
        ways += [(seen, accepted.error, SHAPES_IF_SEEN)] if seen else []
        strong = [(_beyond_motion(problem, name, error, events), tents) for events, error, tents in ways]
        shapes = [
            shaped_events(problem, name, events, most)
            for events, tents in strong
            for most in tents
            if events and (most == tents[0] or most * len(events) <= thresholds.MOST_TENTS)
        ]
        gains = [
            (_gain(accepted, whitened_series(problem, h.shapes)), h)
            for h in shapes
            if is_short(h, problem.duration) or is_seen(h, problem)
        ]
        found += sorted(gains, key=lambda one: one[0] - penalty(one[1]))[-1:]
    return found


def _gain(accepted: Fit, series: np.ndarray) -> float:
    """nats that linear series (E, U, 6) gain together, with a coefficient for every channel."""
    whole = accepted.columns._replace(series=np.concatenate([accepted.columns.series, series]))
    return step_and_gain(whole, accepted.error)[1]


def _pursue(dictionary: Dictionary, error: np.ndarray) -> list[Event]:
    """Pulses that gain most on innovations (U, 6), found one after the other."""
    white, events = dictionary.events_white, list[Event]()
    power = np.maximum(np.square(white).sum(2), 1e-6)
    left = error.T.astype(white.dtype)
    for _ in range(thresholds.MOST_EVENTS):
        along = (white @ left[:, :, None])[..., 0]
        gain = (along**2 / power / 2).sum(0)
        best = int(gain.argmax())
        if gain[best] < thresholds.LEAST_EVENT:
            break
        left = left - (along[:, best] / power[:, best])[:, None] * white[:, best]
        events.append(dictionary.events[best])
    return events


def is_short(h: Hypothesis, duration: float) -> bool:
    """Whether events are short, each and together, in logs of this duration in s."""
    lengths = _lengths(h)
    return bool(lengths.max() < thresholds.LONGEST_EVENT and lengths.sum() < thresholds.MOST_OF_LOG * duration)


def is_seen(h: Hypothesis, problem: Problem) -> bool:
    """Whether a filter's contact detection confirms the events: sudden at both ends, with free motion beside them.

    Friction that is there while a joint moves one way is sudden, too.
    """
    lengths, inside = _lengths(h), 0.0
    if not len(lengths) or follows_a_joint(h, problem):
        return False
    for (log, start, end), *_ in shaped(h):
        for contact in problem.parts[log].touched.contacts:
            inside += max(0.0, min(end, contact.end) - max(start, contact.start))
    return bool(
        lengths.sum() < thresholds.MOST_OF_LOG_IF_SEEN * problem.duration and inside > thresholds.SEEN * lengths.sum()
    )


def follows_a_joint(h: Hypothesis, problem: Problem) -> bool:
    """Whether the events last while one joint moves one way, and only then."""
    inside, ways = list[np.ndarray](), list[np.ndarray]()
    for log, part in enumerate(problem.parts):
        t = np.asarray(part.signals.t)[: part.used]
        events = [one for (number, *one), *_ in shaped(h) if number == log]
        inside.append(np.any([(start <= t) & (t <= end) for start, end in events], 0) if events else t != t)
        ways.append(np.sign(np.asarray(part.signals.dq)[: part.used]))
    touched, way = np.concatenate(inside), np.concatenate(ways)
    if touched.all() or not touched.any():
        return False
    apart = np.abs(way[touched].mean(0) - way[~touched].mean(0)) / 2
    return bool((apart > thresholds.ONE_WAY).any())


def takes_most(h: Hypothesis, problem: Problem) -> bool:
    """Whether events are confirmed as contact and leave little free motion to compare them with."""
    return is_seen(h, problem) and bool(_lengths(h).sum() >= thresholds.MOST_OF_LOG * problem.duration)


def doubt(problem: Problem, found: Fit, h: Hypothesis) -> str:
    """Why events may be something else: only short ones are certain."""
    short = bool(_lengths(h).max() < thresholds.SURELY_EVENT)
    return "" if short else "; or something that is not in the catalogue, because it lasted long"


def _lengths(h: Hypothesis) -> np.ndarray:
    """(E,) s, durations of the events."""
    return np.array([one.event.end - one.event.start for one in shaped(h)])


def robust_rest(columns: np.ndarray, error: np.ndarray) -> np.ndarray:
    """(U, 6) residual of innovations after columns (M, U, 6), with outlying bins downweighted; single precision."""
    flat, whole = columns.reshape(len(columns), error.size).astype(np.float32), error.astype(np.float32)
    rest = whole
    for _ in range(REWEIGHTINGS if len(columns) else 0):
        size = (rest**2).sum(1)
        weight = np.repeat(1 / np.sqrt(1 + size / max(np.median(size), 6.0)), 6)
        weighted = flat * weight
        normal = (weighted @ weighted.T).astype(float) + np.eye(len(flat)) / thresholds.PRIOR_STD**2
        step = np.linalg.solve(normal, (weighted @ (whole.ravel() * weight)).astype(float))
        rest = whole - (step.astype(np.float32) @ flat).reshape(error.shape)
    return rest


def _trimmed(problem: Problem, effect: str, error: np.ndarray, events: list[Event]) -> list[Event]:
    """Events with start and end determined by innovations (U, 6)."""
    for _ in range(TRIMS):
        coefficients, white, ends = _tents(problem, effect, error, events, TRIM_TENTS)
        nats = ((coefficients[:, None] * white) ** 2).sum((1, 2)) / 2
        by_event = np.split(nats, ends)
        trimmed = [part for event, nats in zip(events, by_event, strict=True) for part in parts_of(event, nats)]
        if trimmed == events:
            break
        events = trimmed
    return events


def _beyond_motion(problem: Problem, effect: str, error: np.ndarray, events: list[Event]) -> list[Event]:
    """Events in innovations (U, 6) that unrecorded accelerations cannot cause."""
    unseen = max(part.unseen[:3].max() for part in problem.parts)
    if not unseen or not events:
        return events
    coefficients, _, ends = _tents(problem, effect, error, events, SHAPES[0])
    center = np.asarray(center_of_mass(problem.parts[0].signals.model.theta))
    return pushes(events, np.split(coefficients, ends), center, unseen)


def pushes(events: list[Event], wrenches: list[np.ndarray], center: np.ndarray, unseen: float) -> list[Event]:
    """Events that push more than accelerations do; none if all push at the tool's centre of mass, as accelerations do.

    The wrenches (H, 6) N, Nm belong to each event's tent basis functions, in sensor axes; the centre of mass is (3,) m;
    ``unseen`` is the standard deviation in N of the tool's force due to accelerations.
    """
    strong, aside = list[Event](), False
    for event, wrench in zip(events, wrenches, strict=True):
        force, torque = wrench[:, :3], wrench[:, 3:]
        if np.abs(force).max() > thresholds.CREST_FACTOR * unseen:
            about_center = np.linalg.norm(torque - np.cross(center, force))
            strong.append(event)
            aside |= bool(about_center > thresholds.LEAST_LEVER * np.linalg.norm(force))
    return strong if aside else []


def _tents(
    problem: Problem, effect: str, error: np.ndarray, events: list[Event], tents: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Wrenches (H, 6) N, Nm of tent basis functions by innovations (U, 6), whitened series, boundaries of events."""
    h = shaped_events(problem, effect, events, tents)
    white = whitened_series(problem, h.shapes)
    coefficients, _ = projection(white)(error[None])
    return coefficients.reshape(-1, 6), white, np.cumsum([one.series for one in shaped(h)])[:-1]


def parts_of(event: Event, nats: np.ndarray) -> list[Event]:
    """Event without the tent basis functions with little gain (H,) nats, at its ends or between its parts."""
    log, start, end = event
    matter = np.flatnonzero(nats > max(thresholds.LEAST_TENT, thresholds.LEAST_SHARE_OF_TENT * nats.max()))
    if not len(matter):
        return [event]
    width, last = (end - start) / (len(nats) - 1), len(nats) - 1
    pieces = np.split(matter, np.flatnonzero(np.diff(matter) > thresholds.CLEAR_TENTS) + 1)
    least = min(thresholds.LEAST_EVENT, max(nats[p].sum() for p in pieces) / 2)
    pieces = [p for p in pieces if nats[p].sum() > least]
    return [Event(log, start + max(p[0] - 1, 0) * width, start + min(p[-1] + 1, last) * width) for p in pieces]


def merge(events: Sequence[Event]) -> list[Event]:
    """Merge overlapping events of a log, widened for what the pulses that found them do not cover."""
    merged: list[Event] = []
    for log, start, end in sorted(events):
        margin = thresholds.MARGIN + thresholds.MARGIN_SHARE * (end - start)
        start, end = start - margin, end + margin
        if merged and merged[-1].log == log and start < merged[-1].end:
            merged[-1] = Event(log, merged[-1].start, max(end, merged[-1].end))
        else:
            merged.append(Event(log, start, end))
    return merged
