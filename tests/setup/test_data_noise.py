"""The section [data_noise] read, refused and written."""

import tomllib

import numpy as np
import pytest

from ftbias_jax.errors import SetupError
from ftbias_jax.setup import dump_setup, parse_setup


def with_noise(**values):
    return {
        "robot": {"model": "panda"},
        "sensor": {"noise_std": [0.1, 0.004]},
        "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
        "data_noise": values,
    }


def test_one_number_stands_for_three_axes_and_what_is_left_out_is_zero():
    noise = parse_setup(with_noise(linear_acceleration=0.2, angular_velocity=[0.01, 0.02, 0.03])).data_noise
    np.testing.assert_array_equal(noise.linear_acceleration, [0.2] * 3)
    np.testing.assert_array_equal(noise.angular_velocity, [0.01, 0.02, 0.03])
    np.testing.assert_array_equal(noise.gravity_direction, np.zeros(3))
    assert noise.entries is None


@pytest.mark.parametrize("values", [{}, {"linear_acceleration": 0}, {"entries": [0] * 36}])
def test_nothing_or_zeros_are_none(values):
    assert parse_setup(with_noise(**values)).data_noise is None


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"linear": 1}, "data_noise.linear: unknown key"),
        ({"linear_acceleration": -1}, "data_noise.linear_acceleration: got -1 (give one number or 3 numbers"),
        ({"gravity_direction": [1, 2]}, "data_noise.gravity_direction: has 2 numbers"),
        ({"entries": [1] * 35}, "data_noise.entries: has 35 numbers (give 36 numbers, each 0 or more"),
        ({"entries": [1] * 36, "angular_velocity": 1}, "excluded by data_noise.entries (remove one of the two"),
    ],
)
def test_mistakes_are_named(values, words):
    with pytest.raises(SetupError) as caught:
        parse_setup(with_noise(**values))
    assert words in str(caught.value)


def test_it_is_written_with_its_units():
    text = dump_setup(parse_setup(with_noise(linear_acceleration=0.2, angular_acceleration=[1, 2, 3])))
    assert "linear_acceleration = 0.2  # m/s^2, standard deviation" in text
    assert "angular_acceleration = [1.0, 2.0, 3.0]  # rad/s^2, standard deviation" in text
    entries = np.linspace(0, 1, 36)
    again = parse_setup(tomllib.loads(dump_setup(parse_setup(with_noise(entries=list(entries))))))
    np.testing.assert_array_equal(again.data_noise.entries, entries)
