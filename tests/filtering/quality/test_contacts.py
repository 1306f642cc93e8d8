"""The wrench of each contact, against sums over the whole result and for any partition into parts."""

import itertools
import json
from dataclasses import replace

import by_params
import numpy as np
import pytest

from ftbias_jax.filtering.noise.contact import Contact, in_contact
from ftbias_jax.filtering.quality import contacts
from ftbias_jax.filtering.result import ARRAYS, Filtered

START = 100.0
CONTACTS = [Contact(1.0, 2.0, np.zeros(6)), Contact(3.005, 3.5, np.zeros(6)), Contact(9.0, 9.5, np.zeros(6))]
"""The last contact is after the end of the log."""


@pytest.fixture(scope="module")
def filtered():
    rng = np.random.default_rng(0)
    t = np.arange(400) * 0.01
    wrench = rng.normal(size=(400, 6))
    wrench[120:130, 2] = np.nan
    wrench[:, 4] = np.nan
    empty = dict.fromkeys(ARRAYS)
    std = rng.uniform(0.1, 0.2, (400, 6))
    touched = in_contact(t, CONTACTS)
    values = {"t": START + t, "contact_wrench": wrench, "contact_wrench_std": std, "in_contact": touched}
    return Filtered(**{**empty, **values})


def intervals(filtered, found, start):
    return contacts.finish(contacts.add(contacts.start(found), found, filtered, start))


def test_the_wrench_of_a_contact_is_that_of_its_samples(filtered):
    found = intervals(filtered, CONTACTS, START)
    assert [contact.samples for contact in found] == [100, 49]
    for contact, (first, last) in zip(found, [(100, 199), (301, 349)], strict=True):
        rows = slice(first, last + 1)
        assert (contact.start, contact.end) == (filtered.t[first], filtered.t[last])
        with np.errstate(invalid="ignore"), pytest.warns(RuntimeWarning, match="empty slice"):
            mean = np.nanmean(filtered.contact_wrench[rows], 0)
        np.testing.assert_allclose(contact.wrench, mean)
        for axis in (0, 1, 2, 3, 5):
            values = filtered.contact_wrench[rows, axis]
            seen = np.isfinite(values)
            assert contact.peak[axis] == max(values[seen], key=abs)
            std = filtered.contact_wrench_std[rows, axis][seen]
            assert contact.std[axis] == pytest.approx(np.sqrt(np.mean(std**2)))
        assert np.isnan(contact.peak[4])


def test_parts_make_no_difference(filtered):
    sums = contacts.start(CONTACTS)
    for first, last in itertools.pairwise([0, 0, 150, 151, 301, 400]):
        part = by_params.part_of(filtered, slice(first, last))
        sums = contacts.add(sums, CONTACTS, part, START)
    for one, other in zip(contacts.finish(sums), intervals(filtered, CONTACTS, START), strict=True):
        for name in one._fields:
            np.testing.assert_allclose(getattr(one, name), getattr(other, name), err_msg=name)


def test_what_a_file_says_of_it_is_json_without_nan(filtered):
    (first, _) = (contact.plain() for contact in intervals(filtered, CONTACTS, START))
    assert json.loads(json.dumps(first, allow_nan=False)) == first
    assert first["wrench"][4] is None


def test_a_result_without_contact_wrench_has_no_intervals(filtered):
    stated = replace(filtered, contact_wrench=None, contact_wrench_std=None)
    assert intervals(stated, CONTACTS, START) == ()
    assert intervals(filtered, [], START) == ()
