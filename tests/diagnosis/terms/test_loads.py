"""What touches a load while it is handed over counts little, and nothing else counts less."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ftbias_jax.diagnosis.terms.grid import make_term
from ftbias_jax.diagnosis.terms.loads import without_touches


class Bins(NamedTuple):
    t: np.ndarray
    variance: np.ndarray

    def louder(self, added):
        return self._replace(variance=self.variance + added)


def test_only_what_stands_out_beside_a_handover_is_louder():
    bins = Bins(np.arange(100) / 10, np.full((100, 6), 4.0))
    load = make_term("acceleration", "payload", "base", "force", parameters={"time": [2.0, 7.0], "takes": 0.1})
    load = replace(load, coefficients=np.array([0.3]))
    error = np.ones((100, 6))
    error[[21, 68, 45], 2] = 10, -10, 10  # pushed while it is gripped, while it is let go, and once in between
    louder = without_touches(bins, load, error).variance
    changed = np.argwhere(louder != bins.variance).tolist()
    assert changed == [[21, 2], [68, 2]]
    np.testing.assert_allclose(louder[21, 2], 4 + 100 * 4)  # what is left is now one standard deviation
