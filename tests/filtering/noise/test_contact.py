"""Contacts that were added to synthetic series are found, and nothing else is."""

import jax
import numpy as np
import pytest
from made_series import STD, blocks_of, free_motion, gauss_markov, made_blocks, stamps

from ftbias_jax.filtering.method.look import contacts_in
from ftbias_jax.filtering.noise.blocks import LEAST_BLOCKS, Layout, to_samples
from ftbias_jax.filtering.noise.contact import (
    SETTLED,
    Contact,
    Contacts,
    find_contacts,
    in_contact,
    listed,
)
from ftbias_jax.filtering.noise.levels import mean_std, slow_std
from ftbias_jax.io.log import Log

FORCE = np.array([-5.0, 0, 0, 0, 0.2, 0])
"""N, Nm: change of the measured bias by a contact."""


def contacts_of(t, y, rezeroed_at=()):
    """Contacts of a series, found as in a diagnosis."""
    nothing = np.full((len(t), 6), np.nan)
    log = Log(t, nothing, nothing, -y, nothing[:, 0], rezeroed_at=rezeroed_at)
    return list(contacts_in(log, 0 * y, np.zeros((len(t), 2)), np.broadcast_to(STD**2, y.shape)).contacts)


def pushed(t, y, *times, force=FORCE):
    """The series with a contact between each pair of times."""
    touched = np.zeros(len(t), bool)
    for start, end in times:
        touched |= (t >= start) & (t < end)
    return y + touched[:, None] * force


def slow_sines(rng, t, std):
    """(T, 6) smooth errors of a model in motion: four sines of 10 to 50 s."""
    phase = 2 * np.pi * (t[:, None, None] * rng.uniform(0.02, 0.1, (4, 6)) + rng.random((4, 6)))
    return std * np.sin(phase).sum(1) / np.sqrt(2)


def block_means(rng, seconds=30.0, slow=0.0):
    """Blocks of free motion at 500 Hz, generated directly as blocks, which is quick."""
    t = stamps(seconds, 20)
    std = STD / 5  # of the mean of 25 samples
    return made_blocks(t, free_motion(rng, t, std) + slow_sines(rng, t, slow * STD), STD**2)


@pytest.mark.parametrize("slow", [0.0, 1.0, 10.0])
def test_free_motion_has_no_contact(slow):
    """White noise, a drift, and slow errors, in 200 logs."""
    layout = Layout(25, 0.05)
    find = jax.jit(lambda blocks: find_contacts(blocks, layout, slow_std(blocks, layout)).inside.any())
    assert not any(find(block_means(np.random.default_rng(seed), slow=slow)) for seed in range(200))


@pytest.mark.parametrize(("std", "time"), [(3.0, 0.3), (1.0, 0.05), (3.0, 3.0), (3.0, 30.0)])
def test_correlated_noise_is_no_contact(std, time):
    t = stamps(60, 200)
    for seed in range(10):
        rng = np.random.default_rng(seed)
        assert contacts_of(t, free_motion(rng, t) + gauss_markov(rng, t, std * STD, time)) == []


@pytest.mark.parametrize("rate", [250, 500, 1000])
def test_a_contact_of_a_second_is_found_to_a_tenth_of_one(rate):
    """This holds wherever it begins in a block, whose mean must not shift the level from which contact is judged."""
    t = stamps(20, rate)
    for seed in range(25):
        rng = np.random.default_rng(seed)
        start = rng.uniform(5, 15)
        (contact,) = contacts_of(t, pushed(t, free_motion(rng, t), (start, start + 1)))
        assert contact.start == pytest.approx(start, abs=0.1)
        assert contact.end == pytest.approx(start + 1, abs=0.1)
        np.testing.assert_allclose(contact.force, FORCE, rtol=0.1, atol=2 * STD.max())


def test_a_contact_is_found_on_top_of_slow_errors():
    """The slow errors have changed when the contact ends."""
    t = stamps(40, 250)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        y = free_motion(rng, t) + slow_sines(rng, t, 5 * STD)
        (contact,) = contacts_of(t, pushed(t, y, (17.3, 18.9), force=3 * FORCE))
        assert (contact.start, contact.end) == pytest.approx((17.3, 18.9), abs=0.1)


def after_a_hole(t, y):
    return np.where(((t > 5) & (t < 9))[:, None], np.nan, y)


CALM = {
    "two are two": (lambda t, y: y, (6.0, 7.5), (20.0, 20.4)),
    "one at the end lasts to the end": (lambda t, y: y, (57.0, np.inf)),
    "one after a bias that jumps and stays": (lambda t, y: y + 4.0 * (t > 20)[:, None], (40.0, 41.0)),
    "one beside axes that were never measured": (
        lambda t, y: np.where(np.isin(np.arange(6), [1, 5]), np.nan, y),
        (8, 9),
    ),
    "one after a hole in the wrench": (after_a_hole, (12.0, 13.0)),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("case", CALM)
def test_what_is_no_contact_hides_none(case):
    change, *times = CALM[case]
    t = stamps(60, 250)
    y = change(t, free_motion(np.random.default_rng(2), t))
    assert contacts_of(t, y) == []
    found = contacts_of(t, pushed(t, y, *times, force=3 * FORCE))
    expected = np.minimum(times, t[-1])
    np.testing.assert_allclose([(contact.start, contact.end) for contact in found], expected, atol=0.1)
    assert np.isfinite([contact.force for contact in found]).all()


def test_a_long_push_that_moves_is_one_contact_and_what_is_slow_is_none():
    t = stamps(20, 200)
    error = STD * np.random.default_rng(0).normal(size=(len(t), 6))
    error[:, 2] += 0.3 * np.sin(0.5 * t)
    fx = np.eye(6)[0]
    assert contacts_of(t, error + 3.0 * np.sin(0.4 * t)[:, None] * fx) == []
    (contact,) = contacts_of(t, pushed(t, error, (5, 13), force=(8 + 4 * np.sin(3 * t))[:, None] * fx))
    assert (contact.start, contact.end) == pytest.approx((5, 13), abs=0.1)


def test_a_long_push_ends_although_the_bias_has_drifted_meanwhile():
    """The offset that is left is within what free motion shows in as long a time, and small against the push."""
    t = stamps(60, 250)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        drifts = free_motion(rng, t) + 0.02 * t[:, None] * np.sign(rng.normal(size=6)) * STD / STD[0]
        force = (1 + 0.1 * np.sin(2 * np.pi * 0.3 * t))[:, None] * 3 * FORCE
        (contact,) = contacts_of(t, pushed(t, drifts, (20, 35), force=force))
        assert (contact.start, contact.end) == pytest.approx((20, 35), abs=0.1)


def test_a_tool_that_grinds_is_in_contact_and_a_bias_that_jumps_is_not():
    """Chatter scatters the reading within a block as much as its force varies from one block to the next."""
    t = stamps(60, 250)
    for seed in range(5):
        rng = np.random.default_rng(seed)
        force = 4 * FORCE * (1 + 0.15 * np.sin(2 * np.pi * 0.3 * t))[:, None] + rng.normal(size=(len(t), 6)) * 10 * STD
        (contact,) = contacts_of(t, pushed(t, free_motion(rng, t), (20, 35), force=force))
        assert (contact.start, contact.end) == pytest.approx((20, 35), abs=0.2)
        assert contacts_of(t, pushed(t, free_motion(rng, t), (20, np.inf), force=4 * FORCE)) == []


def test_a_sensor_that_is_zeroed_is_not_touched():
    t = stamps(20, 200)
    y = pushed(t, free_motion(np.random.default_rng(3), t), (11.0, 13.0))
    assert len(contacts_of(t, y)) == 1
    assert contacts_of(t, y, rezeroed_at=(10.9975, 12.9975)) == []


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("count", [1, 2, 3, 10, LEAST_BLOCKS - 1])
def test_logs_of_a_few_blocks_have_none(count):
    t = stamps(count * 0.05, 500)
    assert contacts_of(t, pushed(t, free_motion(np.random.default_rng(8), t), (0.5, 1.0))) == []


def test_what_takes_most_of_a_log_is_not_trusted():
    t = stamps(60, 250)
    y = free_motion(np.random.default_rng(5), t)
    share = SETTLED * 0.7
    half = [(start, start + share) for start in np.arange(5.0, 55.0, 2 * share)]
    most = [(start, start + share) for start in np.arange(5.0, 58.0, 1.25 * share)]
    found = contacts_of(t, pushed(t, y, *half))
    assert len(found) == len(half)
    assert contacts_of(t, pushed(t, y, *most)) == []


def presses(rng, t, share, *, begins=False, chatter=0.1, apart=0.2):
    """Pushes of about 1.5 s that differ from each other and vary, for a share of a log, and when there is one.

    With ``begins`` the log starts within one.
    """
    edges, force = [-1.0 if begins else 2.0], np.zeros((len(t), 6))
    while edges[-1] < t[-1]:
        edges.append(edges[-1] + rng.uniform(1, 2) * (share if len(edges) % 2 else 1 - share) / 0.5)
    for start, end in zip(edges[::2], edges[1::2], strict=False):
        size = 1 + apart * rng.normal() + chatter * gauss_markov(rng, t, np.ones(6), 0.2)[:, :1]
        force += ((t >= start) & (t < end))[:, None] * size * FORCE
    return force, force.any(1)


@pytest.mark.parametrize("begins", [False, True])
@pytest.mark.parametrize("share", [0.4, 0.6, 0.75])
def test_what_the_reading_returns_to_is_free_however_much_of_a_log_is_touched(share, begins):
    """A log that begins in contact is not taken the wrong way round."""
    t = stamps(60, 250)
    right = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        force, touched = presses(rng, t, share, begins=begins)
        found = in_contact(t, contacts_of(t, free_motion(rng, t) + force))
        right.append(found[touched].mean() > 0.9 and found[~touched].mean() < 0.2)
    assert np.mean(right) >= 0.85


def test_two_levels_that_are_as_calm_as_each_other_are_told_apart_by_nothing():
    """Friction that changes its sign with the motion looks like a contact of constant force; so does the opposite."""
    layout = Layout(25, 0.05)
    find = jax.jit(lambda blocks: find_contacts(blocks, layout, slow_std(blocks, layout)))
    for seed in range(8):
        rng = np.random.default_rng(seed)
        force, touched = presses(rng, t := stamps(60, 20), 0.5, chatter=0, apart=0)
        y = free_motion(rng, t, STD / 5) + force
        found = find(made_blocks(t, y, STD**2))
        right = np.asarray(found.inside)[touched].mean() > 0.9
        assert right or (np.asarray(found.undecided)[0] > 0.8 * abs(FORCE[0]))
        assert np.asarray(found.undecided).any()


def test_an_error_that_follows_the_motion_is_no_contact():
    """Point to point, a wrong model has another error at each rest, and moves from one to the next in a second."""
    t = stamps(60, 250)
    for seed in range(8):
        rng = np.random.default_rng(seed)
        rests = 0.2 * rng.normal(size=(40, 6)) * FORCE
        k, part = np.divmod(t / 3.0, 1.0)
        part = np.clip(part * 3.0, 0, 1)  # moves for 1 s, rests for 2 s
        ramp = (part**3 * (10 - 15 * part + 6 * part**2))[:, None]
        error = rests[k.astype(int)] * (1 - ramp) + rests[k.astype(int) + 1] * ramp
        touched = in_contact(t, contacts_of(t, free_motion(rng, t) + error))
        assert touched.mean() < 0.25


def test_the_usual_spread_is_measured_in_the_calm_part():
    """The spread is the same with contacts in a third of the log as without."""
    t = stamps(60, 250)
    y = free_motion(np.random.default_rng(9), t)
    (calm, layout), (touched, _) = (blocks_of(t, x) for x in (y, pushed(t, y, *[(s, s + 2) for s in range(3, 60, 6)])))
    np.testing.assert_allclose(slow_std(touched, layout), slow_std(calm, layout), rtol=1.0)
    free = ~in_contact(np.asarray(calm.t), [Contact(s, s + 2, FORCE) for s in range(3, 60, 6)], 0.1)
    np.testing.assert_allclose(*(np.median(mean_std(x, layout)[free], 0) for x in (touched, calm)), rtol=0.3)


def test_samples_in_contact_and_beside_one():
    t = np.arange(10.0)
    contacts = [Contact(2.0, 4.0, FORCE), Contact(7.0, 7.5, FORCE)]
    np.testing.assert_array_equal(np.flatnonzero(in_contact(t, contacts)), [2, 3, 7])
    np.testing.assert_array_equal(np.flatnonzero(in_contact(t, contacts, 1.0)), [1, 2, 3, 4, 6, 7, 8])
    assert not in_contact(t, []).any()


def test_what_is_inside_a_contact_and_beside_it_by_blocks_and_by_samples():
    first = np.array([-1, -1, -1, -1, 1, -1, -1, 6, -1])
    inside = np.isin(np.arange(9), [1, 2, 3, 6])
    departure = np.zeros((9, 6))
    departure[2, 0], departure[3, 4] = -5, 2
    contacts, layout = Contacts(first, inside, departure, np.zeros(6)), Layout(10, 0.1)
    np.testing.assert_array_equal(np.flatnonzero(contacts.near), [0, 1, 2, 3, 4, 5, 6, 7])
    np.testing.assert_array_equal(np.flatnonzero(to_samples(layout, inside, 95)), [*range(10, 40), *range(60, 70)])
    one, two = listed(contacts, 0.1 * np.arange(9) + 0.05, layout)
    assert (one.start, one.end, two.start, two.end) == pytest.approx((0.1, 0.4, 0.6, 0.7))
    np.testing.assert_array_equal(one.force, [-5, 0, 0, 0, 2, 0])
