"""What is found in one log is applied to another."""

from dataclasses import replace
from functools import partial

import pytest

from ftbias_jax.setup import load_setup
from validation import runs
from validation.generator.make import Limits, make_log
from validation.generator.plan import Job


@pytest.mark.slow
def test_the_true_effect_closes_the_gap_of_a_log_and_half_of_it_three_quarters(tmp_path):
    job = Job(("tool_mass",), ("point_at_com",), 2)
    _, label = make_log(0, job, 1, Limits((8.0, 8.0), (100.0,), True), tmp_path)
    log, setup = tmp_path / "log_000.npz", load_setup(tmp_path / "log_000.toml")
    true = label["effects"]["tool_mass"]["mass"]

    def mended(share):
        return replace(setup, effects={"tool_mass": {"mass": setup.tool.mass + share * (true - setup.tool.mass)}})

    shrink = partial(runs.shrink_of, log, setup)
    assert shrink(mended(1.0)) == pytest.approx(1.0, abs=0.02)
    assert shrink(mended(0.5)) == pytest.approx(0.75, abs=0.03)
    assert shrink(mended(-1.0)) == 0.0
    assert shrink(setup) == 0.0
