from functools import partial

import numpy as np
import one_line
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ftbias_jax.io.check import check_log, relative_seconds

T = 4


def arrays():
    values = np.random.default_rng(0)
    return {
        "t": 100 + np.arange(T) * 0.5,
        "q": values.normal(size=(T, 2)),
        "wrench": values.normal(size=(T, 6)),
        "dq": values.normal(size=(T, 2)),
        "temperature": np.full(T, 25.0),
    }


def fails(setup, changes, field, *words):
    call = partial(check_log, **{**arrays(), **changes}, setup=setup, file="log.npz")
    one_line.fails(call, f"log.npz: {field}", *words)


def test_single_precision_and_integers_become_float64(setup):
    changes = {"q": np.ones((T, 2), np.int16), "wrench": np.ones((T, 6), np.float32)}
    log = check_log(**{**arrays(), **changes}, setup=setup)
    assert log.q.dtype == log.wrench.dtype == np.float64


@given(st.lists(st.integers(1, 10**12), min_size=1, max_size=20), st.integers(0, 2 * 10**18))
def test_steps_of_integer_stamps_are_exact_from_any_origin(steps, origin):
    t = np.cumsum([origin, *steps])
    np.testing.assert_array_equal(relative_seconds(t)[0], (t - origin) * 1e-9)


def put(name, index, value):
    changed = arrays()[name]
    changed[index] = value
    return {name: changed}


@pytest.mark.parametrize(
    ("changes", "field", "what", "remedy"),
    [
        (put("t", 2, np.nan), "t", "NaN time: t[2] is nan", "finite stamp"),
        (put("t", 1, np.inf), "t", "NaN time: t[1] is inf", "finite stamp"),
        (put("t", 3, 99), "t", "time does not increase: t[3] = 99.0 after t[2] = 101.0", "sort the samples"),
        ({"t": np.zeros((T, 2))}, "t", "has shape (4, 2) and type float64", "one list of numbers"),
        ({"t": np.array(["0", "1"])}, "t", "type <U1", "one list of numbers"),
        ({"t": np.array([1.0])}, "t", "has 1 samples", "at least 2"),
        ({"t": np.array([])}, "t", "has 0 samples", "at least 2"),
        ({"q": np.zeros((T, 3))}, "q", "has shape (4, 3), expected (4, 2)", "number of joints"),
        ({"q": np.zeros((T + 1, 2))}, "q", "has shape (5, 2), expected (4, 2)", "(samples, joints)"),
        ({"q": np.zeros(T)}, "q", "has shape (4,), expected (4, 2)", "(samples, joints)"),
        ({"dq": np.zeros((T, 1))}, "dq", "has shape (4, 1), expected (4, 2)", "(samples, joints)"),
        ({"wrench": np.zeros((6, T))}, "wrench", "has shape (6, 4), expected (4, 6)", "samples first"),
        ({"temperature": np.zeros((T, 1))}, "temperature", "has shape (4, 1), expected (4,)", "samples first"),
        ({"q": np.full((T, 2), "x")}, "q", "has type <U1", "real numbers"),
        ({"wrench": np.zeros((T, 6), complex)}, "wrench", "has type complex128", "real numbers"),
        ({"q": np.full((T, 2), np.nan)}, "q", "no motion data: joint 'base'", "record its position"),
        (put("q", (slice(None), 1), np.nan), "q", "no motion data: joint 'elbow'", "joints of the setup"),
        ({"wrench": np.full((T, 6), np.nan)}, "wrench", "no wrench data", "record the sensor's wrench"),
        (put("wrench", (3, 2), np.inf), "wrench", "wrench[3, 2] is infinite", "mark missing samples as NaN"),
        (put("dq", (1, 0), -np.inf), "dq", "dq[1, 0] is infinite", "mark missing samples as NaN"),
        (put("temperature", 1, np.inf), "temperature", "temperature[1] is infinite", "mark missing samples as NaN"),
    ],
)
def test_logs_that_cannot_be_filtered_are_refused(setup, changes, field, what, remedy):
    fails(setup, changes, field, what, remedy)


def test_a_wrong_shape_is_told_though_stamps_are_repeated(setup):
    fails(setup, {**put("t", 2, 100.5), "q": np.zeros((T + 1, 2))}, "q", "has shape (5, 2)", "one sample")
