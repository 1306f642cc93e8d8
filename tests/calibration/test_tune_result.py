"""What the result of a tuning prints."""

from types import SimpleNamespace

import numpy as np
import pytest

from ftbias_jax.calibration.judgement import Predicted
from ftbias_jax.calibration.tune_result import TuneResult

ONES = np.ones(6)


@pytest.mark.parametrize(
    ("constant", "words"),
    [
        ([0.8, 1.0, 0.7, 1, 1, 1], "10 s ahead on fx, fz: `ftbias identify --crosstalk --bias`"),
        ([0.96, 1.0, 2.0, 0.5, 1, 1], None),  # differences due to chance, and in torques alone
        ([np.nan] * 6, None),  # nothing was measured from which to take the constant
    ],
)
def test_a_constant_bias_that_predicts_better_is_told(constant, words):
    after = [Predicted(1.0, ONES, ONES, ONES), Predicted(10.0, ONES, ONES, np.array(constant))]
    of_white_noise = SimpleNamespace(sensor=SimpleNamespace(correlated_std=None, correlated_time=None))
    printed = str(TuneResult(of_white_noise, {}, (), predicted=tuple(after)))
    assert ("constant bias" in printed) is (words is not None)
    assert words is None or words in printed
