"""A setup need not state the tool to be checked: the tool fitted to the log, of either sign, replaces it."""

import made_weights as made
import numpy as np
import pytest
from small_checks import checked, right_log

from ftbias_jax.check.bins import bins_of
from ftbias_jax.check.check_setup import check_setup
from ftbias_jax.check.state import case_of_bins
from ftbias_jax.io.log import Log
from ftbias_jax.setup import parse_setup


def case(sign=1.0, **sensor):
    t, q, wrench = made.arm_log("ur5e", samples=1500, sign=sign)
    setup = parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": [0.05, 0.002], **sensor}})
    return setup, Log.from_arrays(setup, t, q, wrench)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_tool_is_the_one_that_the_log_shows(sign):
    setup, log = case(sign)
    tool = case_of_bins(setup, [bins_of(log, setup)]).setup.tool
    assert abs(tool.mass - made.MASS) < 0.02
    np.testing.assert_allclose(tool.center_of_mass, made.CENTER, atol=5e-3)


def test_a_wrong_sign_is_found_without_a_tool():
    setup, log = case()
    assert check_setup(setup, [log]).ok
    setup, log = case(sign=-1.0)
    found = check_setup(setup, [log])
    assert [finding.mistake for finding in found.findings] == ["sign"]
    stated, log = case(sign=-1.0, reports="wrench_on_sensor")
    assert check_setup(stated, [log]).ok


def test_a_log_that_shows_no_tool_is_checked_with_a_guess():
    setup, log = case()
    noise = np.random.default_rng(0).normal(size=log.wrench.shape) * [0.05, 0.05, 0.05, 0.002, 0.002, 0.002]
    checked = check_setup(setup, [log._replace(wrench=noise)])
    assert [finding.mistake for finding in checked.findings] in ([], ["compensated"], ["worse_than_raw"])


def without_tool(tables):
    for key in ("mass", "center_of_mass"):
        del tables["tool"][key]


@pytest.mark.parametrize(
    ("mistake", "columns", "sign"),
    [
        ("sign", [0, 1, 2, 3, 4, 5], [-1.0] * 6),
        ("force_torque_swapped", [3, 4, 5, 0, 1, 2], [1.0] * 6),
        ("sensor_axes", [1, 0, 2, 4, 3, 5], [-1.0, 1, 1, -1, 1, 1]),
    ],
)
def test_mistakes_are_named_without_a_tool(mistake, columns, sign):
    tables, arrays = right_log(seed=3)
    without_tool(tables)
    arrays["wrench"] = np.asarray(sign) * arrays["wrench"][:, columns]
    assert [finding.mistake for finding in checked(tables, arrays).findings] == [mistake]
