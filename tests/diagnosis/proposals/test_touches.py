"""Times of contacts, on synthetic innovations."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.diagnosis.hypothesis import Event, Hypothesis, Shaped
from ftbias_jax.diagnosis.problem import Part, Problem
from ftbias_jax.diagnosis.proposals.touches import (
    follows_a_joint,
    is_seen,
    is_short,
    merge,
    parts_of,
    pushes,
    robust_rest,
)
from ftbias_jax.filtering.method.look import Touched
from ftbias_jax.filtering.noise.contact import Contact

BINS = 400


@pytest.mark.parametrize(
    ("matter", "expected"),
    [
        ([4, 5, 6], [(3.0, 7.0)]),
        ([0, 1], [(0.0, 2.0)]),
        ([3, 4, 6], [(2.0, 7.0)]),  # one quiet tent function is still contact
        ([2, 3, 8], [(1.0, 4.0), (7.0, 9.0)]),
        ([], [(0.0, 10.0)]),
    ],
)
def test_an_event_is_what_matters_of_it(matter, expected):
    nats = np.zeros(11)
    nats[matter] = 5000.0
    parts = parts_of(Event(2, 0.0, 10.0), nats)
    assert [log for log, *_ in parts] == [2] * len(expected)
    np.testing.assert_allclose([part[1:] for part in parts], expected)


def test_what_columns_leave_shows_the_bins_they_cannot_explain():
    """Least squares would spread the contact over the whole log; with a low weight it stays in its bins."""
    rng = np.random.default_rng(0)
    columns, noise = rng.normal(size=(8, BINS, 6)), rng.normal(size=(BINS, 6))
    contact = np.zeros((BINS, 6))
    contact[100:120] = 80.0 * rng.normal(size=6)
    columns[:, 100:120] += 2.0  # a part that the columns could explain
    error = np.tensordot(rng.normal(size=8) * 20, columns, 1) + noise + contact
    rest = robust_rest(columns, error)
    np.testing.assert_allclose(rest, noise + contact, atol=1.0)
    flat = columns.reshape(8, -1).T
    plain = error - (flat @ np.linalg.lstsq(flat, error.ravel(), rcond=None)[0]).reshape(error.shape)
    assert np.abs(plain - noise - contact).max() > 2.0


def test_without_columns_the_innovations_stay():
    error = np.ones((BINS, 6))
    np.testing.assert_array_equal(robust_rest(np.zeros((0, BINS, 6)), error), error)


def test_overlapping_events_are_one():
    """Only events within one log are merged."""
    events = [Event(0, 5.0, 6.0), Event(0, 1.0, 1.4), Event(0, 5.5, 6.5), Event(1, 6.0, 7.0)]
    np.testing.assert_allclose(merge(events), [(0, 0.66, 1.74), (0, 4.3, 7.2), (1, 5.3, 7.7)])
    assert merge([]) == []


@pytest.mark.parametrize(
    ("events", "merged"),
    [
        ([(0, 1.0, 2.0), (0, 5.0, 6.0)], 2),
        ([(0, 1.0, 2.0), (0, 3.0, 4.0)], 1),  # each is widened by 0.1 s and six tenths of its length
        ([(0, 1.0, 2.0), (0, 3.5, 4.5)], 2),
        ([(0, 1.0, 2.0), (1, 1.0, 2.0)], 2),
        ([(0, 1.0, 9.0), (0, 4.0, 4.1)], 1),
    ],
)
def test_what_is_one_event(events, merged):
    assert len(merge([Event(*event) for event in events])) == merged


@pytest.mark.parametrize(
    ("lengths", "short"),
    [
        ((1.0,), True),
        ((4.9,), True),
        ((5.1,), False),  # too long for an event
        ((2.0, 2.0, 2.0), True),
        ((2.5, 2.5, 2.5), False),  # more than a third of the log
    ],
)
def test_what_lasts_is_no_event(lengths, short):
    shaped = tuple(Shaped(Event(0, 5.0 * i, 5.0 * i + length), 4) for i, length in enumerate(lengths))
    assert is_short(Hypothesis("contact", detail=shaped), 20.0) is short


@pytest.mark.parametrize(
    ("event", "contacts", "seen"),
    [
        ((0, 1.0, 4.5), [(1.0, 4.3)], True),  # more than half of the log's 6 s, found by the filter as well
        ((0, 1.0, 4.5), [(1.0, 2.0), (2.1, 4.3)], True),
        ((0, 1.0, 4.5), [(1.0, 2.0)], False),
        ((0, 1.0, 4.5), [], False),
        ((1, 1.0, 4.5), [(1.0, 4.3)], False),  # of another log
        ((0, 1.0, 12.5), [(1.0, 12.0)], True),  # a tool that presses for long
        ((0, 0.5, 15.0), [(0.5, 15.0)], False),  # little free motion is left
    ],
)
def test_contact_may_take_much_of_a_log_if_a_filter_finds_it_too(event, contacts, seen):
    found = tuple(Contact(start, end, np.zeros(6)) for start, end in contacts)
    problem = touched_logs(np.zeros((201, 2)), found, ())
    h = Hypothesis("contact", detail=(Shaped(Event(*event), 4),))
    assert is_seen(h, problem) is seen
    assert not is_seen(Hypothesis("gain"), problem)


def touched_logs(dq, *contacts):
    """Logs of 20 s with joint velocities dq (201, n), and the contacts that a filter found in each."""
    signals = SimpleNamespace(t=np.linspace(0, 20, 201), dq=dq)
    parts = (Part(*[None] * 5)._replace(touched=Touched(some), signals=signals, used=201) for some in contacts)
    return Problem(tuple(parts), *[None] * 5, (20.0,), None, {})


@pytest.mark.parametrize(("late", "friction"), [(0.0, True), (0.3, True), (2.0, False)])
def test_what_lasts_while_one_joint_moves_one_way_is_friction(late, friction):
    times = [(2.0, 5.0), (8.0, 11.0), (14.0, 17.0)]
    t = np.linspace(0, 20, 201)
    way = np.where(np.any([(a <= t) & (t <= b) for a, b in times], 0), 1.0, -1.0)
    dq = np.stack([np.sin(t), 0.3 * way], 1)
    found = [(a + late, b + late) for a, b in times]
    problem = touched_logs(dq, tuple(Contact(a, b, np.zeros(6)) for a, b in found))
    h = Hypothesis("contact", detail=tuple(Shaped(Event(0, a, b), 4) for a, b in found))
    assert follows_a_joint(h, problem) is friction
    assert is_seen(h, problem) is not friction


@pytest.mark.parametrize(
    ("sizes", "levers", "expected"),
    [
        ([2.0, 3.0], [0.0, 0.0], []),  # may be an arm that stops and goes
        ([2.0, 3.0], [0.0, 0.05], [0, 1]),
        ([2.0, 0.5], [0.05, 0.05], [0]),  # accelerations may reach ten standard deviations
        ([2.0, 0.5], [0.0, 0.05], []),
        ([2.0], [0.02], []),  # within the uncertainty of the centre of mass
    ],
)
def test_a_push_is_none_of_accelerations_that_nobody_recorded(sizes, levers, expected):
    """Forces act at the centre of mass, offset by a lever perpendicular to them."""
    center, along, events = (
        np.array([0.01, -0.02, 0.09]),
        np.array([1.0, 0.0, 0.0]),
        [Event(0, k, k + 0.5) for k in (1, 5)],
    )
    events = events[: len(sizes)]
    wrenches = [
        np.outer([0.5, 1.0, 0.5], size * np.r_[along, np.cross(center + np.array([0, lever, 0]), along)])
        for size, lever in zip(sizes, levers, strict=True)
    ]
    assert pushes(events, wrenches, center, 0.1) == [events[k] for k in expected]
