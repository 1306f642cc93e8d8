"""Without a stated tool the signs, axes and frames of a setup are checked all the same."""

import numpy as np
import pytest
from small_checks import checked, right_log


def without_tool(tables):
    for key in ("mass", "center_of_mass"):
        del tables["tool"][key]


def test_a_right_setup_without_a_tool_is_right():
    tables, arrays = right_log(seed=3)
    without_tool(tables)
    assert checked(tables, arrays).ok


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
