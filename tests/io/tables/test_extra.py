"""Columns that the setup names in addition to those of every log."""

import numpy as np
import pytest
from log_files import SUFFIXES, write
from stated import PANDA

from ftbias_jax.errors import LogError, SetupError
from ftbias_jax.filtering.samples import pad, samples_from_log
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Log
from ftbias_jax.io.parts import open_log
from ftbias_jax.setup import dump_setup, parse_setup

STATED = PANDA | {"log": {"columns": {"spindle_current": "I_spindle"}}}
T = 12
CURRENT = np.where(np.arange(T) % 3 == 1, np.nan, np.arange(T) ** 2.0)


@pytest.fixture
def setup():
    return parse_setup(STATED)


def arrays():
    rng = np.random.default_rng(0)
    q = np.cumsum(rng.normal(size=(T, 7)), 0)
    return {"t": 100.0 + 0.01 * np.arange(T), "q": q, "wrench": rng.normal(size=(T, 6)), "I_spindle": CURRENT}


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_named_column_is_read_from_every_table_and_its_gaps_are_bridged(tmp_path, setup, suffix):
    log = read_log(write(tmp_path / f"log{suffix}", arrays()), setup, raw=True)
    column = log.columns["spindle_current"]
    known = np.isfinite(CURRENT)
    np.testing.assert_allclose(column.t, 0.01 * np.arange(T)[known], atol=1e-9)
    np.testing.assert_array_equal(column.values, CURRENT[known])
    np.testing.assert_allclose(column.at(log.t)[1], (CURRENT[0] + CURRENT[2]) / 2)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"I_spindle": None}, "I_spindle: log.columns of the setup names this column, but it is not there"),
        ({"I_spindle": CURRENT[:-1]}, "has shape"),
        ({"I_spindle": np.full(T, np.nan)}, "was never measured"),
        ({"I_spindle": np.full(T, np.inf)}, "is infinite"),
    ],
)
def test_a_column_that_is_not_there_or_no_numbers_is_told(tmp_path, setup, change, message):
    content = {name: values for name, values in (arrays() | change).items() if values is not None}
    with pytest.raises(LogError, match=message):
        read_log(write(tmp_path / "log.npz", content), setup)


def test_a_missing_column_of_a_csv_is_told(tmp_path):
    setup = parse_setup(STATED | {"log": {"columns": {"spindle_current": "I_spindel"}}})
    with pytest.raises(LogError, match=r"I_spindel.*did you mean 'I_spindle'"):
        read_log(write(tmp_path / "log.csv", arrays()), setup)


def test_a_name_that_is_nearly_a_known_one_is_a_mistake():
    with pytest.raises(SetupError, match=r"temprature.*did you mean 'temperature'"):
        parse_setup(STATED | {"log": {"columns": {"temprature": "T"}}})


def test_the_setup_keeps_the_name(setup):
    assert 'spindle_current = "I_spindle"' in dump_setup(setup)


def test_columns_reach_the_filter_padded_with_their_last_value(tmp_path, setup):
    log = read_log(write(tmp_path / "log.npz", arrays()), setup, raw=True)
    samples = pad(samples_from_log(log), T + 4)
    got = np.asarray(samples.columns["spindle_current"])
    np.testing.assert_allclose(got[:T], log.columns["spindle_current"].at(log.t))
    np.testing.assert_allclose(got[T:], got[T - 1])


def test_parts_of_a_log_keep_the_columns_of_the_whole(tmp_path, setup):
    opened = open_log(write(tmp_path / "log.npz", arrays()), setup)
    parts = list(opened.parts(5))
    assert [len(part.t) for part in parts] == [5, 5, 2]
    assert all(len(part.columns["spindle_current"].t) == np.isfinite(CURRENT).sum() for part in parts)


def test_arrays_in_memory_have_columns_too(setup):
    content = arrays()
    log = Log.from_arrays(
        setup, content["t"], content["q"], content["wrench"], columns={"spindle_current": CURRENT}, raw=True
    )
    np.testing.assert_array_equal(log.columns["spindle_current"].values, CURRENT[np.isfinite(CURRENT)])
