import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from validation.rules import Share, has_mean_gap, is_named, is_right, left_out, share

MASS, DELAY, SLOSH = {"tool_mass": {}}, {"time_delay": {}}, {"slosh": {}}


@given(st.integers(0, 300), st.integers(1, 300))
def test_wilsons_interval_ends_where_the_count_would_be_1_96_standard_deviations_off(hits, of):
    hits = min(hits, of)
    p = hits / of
    for end in Share(hits, of).interval():
        assert 0 <= end <= 1
        np.testing.assert_allclose(abs(p - end), 1.959964 * np.sqrt(end * (1 - end) / of), atol=1e-7)
    low, high = Share(hits, of).interval()
    assert low <= p + 1e-12
    assert high >= p - 1e-12


def test_a_share_of_nothing_says_nothing():
    assert share([]).plain() == {"hits": 0, "of": 0, "share": None, "low": 0.0, "high": 1.0}
    assert str(share([])).strip() == "0/0"
    assert str(share([True, False])).split() == ["1/2", "50%", "(9%", "to", "91%)"]


@pytest.mark.parametrize(
    ("effects", "verdict", "causes", "right"),
    [
        ({}, "none", [], True),
        ({}, "unknown", [], False),
        ({}, "explained", ["gain"], False),
        (MASS, "explained", ["tool_mass"], True),
        (MASS, "partly_explained", ["tool_mass", "gain"], True),
        (MASS, "explained", ["gain", "tool_mass"], False),  # named, but not first
        (MASS, "explained", [("gain", "tool_mass")], True),
        (MASS, "explained", [("gain", "a", "b", "tool_mass")], True),
        (MASS, "explained", [("gain", "a", "b", "c", "tool_mass")], False),  # more than three twins
        (MASS, "none", [], False),
        (MASS, "failed", [], False),
        (SLOSH, "unknown", [], True),
        (SLOSH, "partly_explained", ["gain"], True),
        (SLOSH, "described", [], True),
        (SLOSH, "explained", ["gain"], False),
        (SLOSH, "none", [], False),
        ({**MASS, **SLOSH}, "unknown", [], True),
        ({**MASS, **DELAY}, "explained", ["time_delay", "tool_mass"], True),
        ({**MASS, **DELAY}, "explained", [("low_pass", "time_delay"), "tool_mass"], True),
        ({**MASS, **DELAY}, "explained", ["tool_mass"], False),
    ],
)
def test_what_counts_as_right(make_label, make_said, effects, verdict, causes, right):
    assert is_right(make_label(effects), make_said(verdict, *causes)) is right


def test_one_of_a_pair(make_label, make_said):
    pair = make_label({**MASS, **DELAY})
    assert is_named(pair, make_said("explained", "gain", ("low_pass", "time_delay"))) == [False, True]


def test_faint_effects_are_a_group_of_their_own_unless_single_samples_show_them(make_label):
    assert make_label(MASS, 0.29).group == "faint"
    assert make_label(MASS, 0.3).group == "single"
    assert make_label({"quantisation": {}}, 0.0).group == "single"
    assert make_label({**MASS, **DELAY}, 0.1).group == "pair"


def test_only_effects_on_the_mean_reading_can_be_shrunk(make_label):
    assert has_mean_gap(make_label(MASS))
    assert has_mean_gap(make_label({**MASS, "outliers": {}}))
    assert not has_mean_gap(make_label({"outliers": {}}))
    assert not has_mean_gap(make_label(MASS, 0.1))
    assert not has_mean_gap(make_label(SLOSH))
    assert not has_mean_gap(make_label({}))


@pytest.mark.parametrize(
    ("verdict", "causes", "outcome"),
    [
        ("unknown", [], "unknown"),
        ("none", [], "none"),
        ("described", [], "described"),
        ("failed", [], "failed"),
        ("partly_explained", ["cable"], "partly_explained"),
        ("explained", ["gain"], "twin"),
        ("explained", [("cable", "gain")], "twin"),
        ("explained", ["cable"], "wrong"),
        ("explained", ["gain", "cable"], "wrong"),
    ],
)
def test_what_becomes_of_a_log_whose_effect_is_left_out(make_said, verdict, causes, outcome):
    assert left_out("tool_mass", make_said(verdict, *causes)) == outcome


def test_an_effect_that_declares_the_other_as_its_twin_is_a_twin_too(make_said):
    """Crosstalk declares tool_com as a twin; tool_com does not declare crosstalk."""
    assert left_out("tool_com", make_said("explained", "crosstalk")) == "twin"
