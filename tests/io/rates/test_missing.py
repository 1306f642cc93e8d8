import numpy as np
import pytest

from ftbias_jax.io.rates import missing_readings

T = np.arange(2000) / 100


def told(kept, t=T):
    return missing_readings("the wrench is", t[kept], T)


def test_a_stream_without_gaps_is_not_told():
    assert told(T >= 0) == ()
    assert told(np.arange(2000) % 50 != 7) == ()  # a row now and then
    slow = np.arange(2000) % 4 == 0
    assert missing_readings("the joints are", (T + 1e-3)[slow], T) == ()  # of its own clock, as a merge has it
    assert missing_readings("the wrench is", T[:0], T) == ()


@pytest.mark.parametrize(
    ("begin", "end", "words"),
    [(10, 20, "10.0 to 20.0 s"), (-1, 5, "0.0 to 5.0 s"), (3, 9.5, "3.0 to 9.5 s")],
)
def test_a_stretch_without_readings_is_told_with_its_times(begin, end, words):
    (repair,) = told((begin > T) | (end < T))
    assert repair.lost
    assert words in repair.what


def test_of_many_stretches_the_first_are_told_one_by_one():
    (repair,) = told(T % 4 < 2)
    assert repair.what.endswith("2.0 to 4.0 s, 6.0 to 8.0 s, 10.0 to 12.0 s, 2 times more")


def test_rows_without_a_reading_are_lost_where_no_slower_sensor_explains_them():
    (slower,) = told(np.arange(2000) % 2 == 0)
    assert slower.what == "the wrench is measured in 1000 of 2000 rows: taken as a stream of 50 Hz"
    assert not slower.lost
    (lost,) = told(np.random.default_rng(0).random(2000) < 0.5)
    assert "the others are missing" in lost.what
    assert lost.lost


def test_a_pause_of_both_streams_is_no_gap():
    pause = (T < 5) | (T > 15)
    assert missing_readings("the wrench is", T[pause], T[pause]) == ()
