"""Which arrays of a result are written, with which precision, and at which samples."""

import itertools
import json

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given

from ftbias_jax.errors import UsageError
from ftbias_jax.filtering.result import ARRAYS
from ftbias_jax.io.write import save_results
from ftbias_jax.io.write.fields import FIELDS, unit_of
from ftbias_jax.io.write.npz import load_npz
from ftbias_jax.io.write.selection import About, Selection, check_selection, selected, selected_parts

T = 50


def result(t=None):
    rng = np.random.default_rng(0)
    t = np.arange(T) * 0.002 + 1.7e9 if t is None else t
    shapes = {"bias": 6, "wrench_unbiased": 6, "q": 3}
    arrays = {"t": t} | {name: rng.normal(size=(len(t), width)) for name, width in shapes.items()}
    return arrays | {"used": rng.uniform(size=len(t)) < 0.5, "log_likelihood": np.float64(-1234.5678901)}


def test_every_array_of_a_result_has_a_unit_and_a_meaning():
    assert {*ARRAYS} <= FIELDS.keys()
    assert all(field.unit and field.meaning for field in FIELDS.values())


def test_single_precision_keeps_stamps_likelihood_and_flags():
    made, arrays = selected(result()), result()
    for name in ("t", "log_likelihood", "used"):
        np.testing.assert_array_equal(made[name], arrays[name])
        assert made[name].dtype == arrays[name].dtype
    assert made["bias"].dtype == np.float32
    np.testing.assert_array_equal(made["bias"], np.float32(arrays["bias"]))
    assert selected(result(), Selection(precision="double"))["bias"].dtype == np.float64


def test_units_of_force_and_torque_are_those_of_the_column():
    assert [unit_of("bias", i) for i in range(6)] == ["N"] * 3 + ["Nm"] * 3
    assert [unit_of("drift", i) for i in (2, 3)] == ["N/s", "Nm/s"]
    assert (unit_of("t"), unit_of("q", 4), unit_of("unknown")) == ("s", "rad", "")


def test_every_third_sample_of_the_fields_asked_for_and_the_file_says_so(tmp_path):
    arrays, selection = result(), Selection(("bias", "used"), every=3, precision="double")
    save_results(tmp_path / "out.npz", arrays, About(selection=selection))
    made = load_npz(tmp_path / "out.npz")
    about = json.loads(str(made.pop("about")))
    assert list(made) == list(about["fields"]) == ["t", "bias", "used"]
    assert (about["every"], about["rate"]) == (3, None)
    for name, values in made.items():
        np.testing.assert_array_equal(values, [arrays[name][i] for i in range(0, T, 3)])


def test_a_rate_keeps_the_first_sample_after_each_tick():
    """500 Hz to 100 Hz keeps every fifth sample, also with stamps since 1970, which are no multiples of 2 ms."""
    made = selected(result(), Selection(rate=100.0))
    np.testing.assert_array_equal(made["t"], result()["t"][::5])


def test_a_rate_above_that_of_the_log_keeps_all_and_a_gap_costs_no_sample():
    t = np.r_[0, 0.01, 0.02, 5.0, 5.01, 5.02]
    assert len(selected(result(t), Selection(rate=1000.0))["t"]) == 6
    np.testing.assert_array_equal(selected(result(t), Selection(rate=50.0))["t"], [0, 0.02, 5.0, 5.02])


@given(st.lists(st.integers(0, 20), min_size=1, max_size=6), st.sampled_from([1, 2, 3, 7]), st.booleans())
def test_where_one_part_ends_makes_no_difference(lengths, every, by_rate):
    total = sum(lengths)
    t = np.cumsum(np.random.default_rng(1).uniform(0.001, 0.01, total))
    arrays = {"t": t, "bias": np.arange(total * 6.0).reshape(total, 6)}
    ends = np.cumsum([0, *lengths])
    parts = [{name: x[a:b] for name, x in arrays.items()} for a, b in itertools.pairwise(ends)]
    selection = Selection(rate=500 / every) if by_rate else Selection(every=every)
    whole = selected(arrays, selection)
    made = list(selected_parts(parts, selection))
    for name, values in whole.items():
        np.testing.assert_array_equal(np.concatenate([part[name] for part in made]), values)


@pytest.mark.parametrize(
    ("selection", "words"),
    [
        (Selection(("bais",)), "there is no field 'bais' .did you mean 'bias'"),
        (Selection(precision="half"), "'half' is no precision .choose from single, double"),
        (Selection(every=0), "0 samples"),
        (Selection(rate=np.inf), "inf Hz"),
        (Selection(every=2, rate=10.0), "both given"),
        (Selection(("bias_smooth",)), "the result has no 'bias_smooth' .smooth the log"),
    ],
)
def test_what_means_nothing_is_refused(selection, words):
    with pytest.raises(UsageError, match=words):
        selected(result(), selection)


def test_a_field_that_will_not_be_there_is_refused_before_anything_is_computed():
    check_selection(Selection(("bias_smooth", "used")), smooth=True, adapt=True)
    with pytest.raises(UsageError, match=r"'bias_smooth' will not be in the result .add --smooth"):
        check_selection(Selection(("bias_smooth",)), smooth=False)
    with pytest.raises(UsageError, match=r"'contact_wrench' will not be in the result .leave out --as-stated"):
        check_selection(Selection(("contact_wrench",)), adapt=False)


def test_ten_minutes_at_500_hz_stay_below_130_megabytes(tmp_path):
    """All arrays of a Panda; a tenth of the log is written, because each number has the same size."""
    count = 30_000
    widths = {name: 7 if name in ("q", "dq", "ddq", "ddq_std") else 6 for name in ARRAYS if "smooth" not in name}
    arrays = {name: np.ones((count, width)) for name, width in widths.items()}
    arrays |= {name: np.ones(count) for name in ("t", "nis")} | {"log_likelihood": np.float64(0)}
    arrays |= {name: np.ones(count, bool) for name in ("used", "in_contact")}
    save_results(tmp_path / "all.npz", arrays)
    assert 10 * (tmp_path / "all.npz").stat().st_size < 130e6
    few = Selection(("bias", "bias_std", "wrench_unbiased"), rate=100.0)
    save_results(tmp_path / "few.npz", {**arrays, "t": np.arange(count) * 0.002}, About(selection=few))
    assert 10 * (tmp_path / "few.npz").stat().st_size < 5e6
