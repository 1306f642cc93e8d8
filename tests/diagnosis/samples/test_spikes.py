import numpy as np
import pytest

from ftbias_jax.diagnosis.samples.spikes import find_spikes

COUNT = 1000


def rising(slope):
    return np.random.default_rng(0).normal(size=(COUNT, 6)) + slope * np.arange(COUNT)[:, None]


@pytest.mark.parametrize("slope", [0.0, 3.0])
@pytest.mark.parametrize("row", [0, 1, 500, COUNT - 2, COUNT - 1])
def test_a_spike_is_found_wherever_it_is(row, slope):
    signal, hit = rising(slope), np.zeros((COUNT, 6), bool)
    floor = np.zeros((COUNT, 6))
    assert not find_spikes(signal, floor).hit.any()
    signal[row, 1] += 30.0
    hit[row, 1] = True
    np.testing.assert_array_equal(find_spikes(signal, floor).hit, hit)


def test_a_short_log_has_spikes_too():
    signal = np.random.default_rng(1).normal(size=(5, 6))
    assert find_spikes(signal, np.zeros((5, 6))).hit.shape == (5, 6)
