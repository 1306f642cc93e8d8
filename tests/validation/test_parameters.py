import numpy as np
import pytest

from validation.parameters import compare


def cause(effect, parameters, stderr):
    return {"effect": effect, "parameters": parameters, "stderr": stderr}


def test_three_standard_errors_are_the_limit(make_label, make_said):
    """Each number of a vector is judged; a vector is inside if all its numbers are."""
    mine = make_label({"gain": {"gain": [1.0, 1.1, 1.0, 1.0, 1.0, 1.0]}})
    fitted = cause("gain", {"gain": [1.0, 1.13, 1.0, 1.0, 1.0, 1.031]}, {"gain": [0.0101] * 6})
    (found,) = compare(mine, make_said("explained", fitted))
    assert (found.effect, found.parameter) == ("gain", "gain")
    np.testing.assert_allclose(found.error, [0, 0.03, 0, 0, 0, 0.031])
    assert found.inside.tolist() == [True, True, True, True, True, False]


def test_numbers_without_an_error_bar_or_a_truth_are_not_compared(make_label, make_said):
    mine = make_label({"saturation": {"limits": [5.0] * 6}}, saturation="force_only")
    fitted = cause(
        "saturation", {"limits": [5.0, None, 5.0, 1.0, 1.0, 1.0]}, {"limits": [0.1, 0.1, 0.0, 0.1, 0.1, 0.1]}
    )
    (found,) = compare(mine, make_said("explained", fitted))
    assert found.error.tolist() == [0.0]
    assert compare(mine, make_said("explained", cause("saturation", {"limits": [None] * 6}, {}))) == []


def test_a_twins_parameters_are_not_compared(make_label, make_said):
    mine = make_label({"tool_mass": {"mass": 1.0}})
    assert compare(mine, make_said("explained", cause("gain", {"gain": [1.0] * 6}, {"gain": [0.1] * 6}))) == []


@pytest.mark.parametrize(("joint", "inside"), [(3, [True]), (4, [False])])
def test_the_offset_of_another_joint_is_a_miss(make_label, make_said, joint, inside):
    mine = make_label({"encoder_offset": {"joint": 3, "offset": 0.02}})
    fitted = cause("encoder_offset", {"joint": joint, "offset": 0.02}, {"joint": 0.0, "offset": 0.001})
    (found,) = compare(mine, make_said("explained", fitted))
    assert found.inside.tolist() == inside


def test_contacts_are_matched_by_the_time_they_share(make_label, make_said):
    """Events are fitted in another order; one is not found, and one did not exist."""
    events = [[1.0, 1.0, [1.0, 0, 0], [0, 0, 0], "decay"], [5.0, 1.0, [0, 2.0, 0], [0, 0, 0], "decay"]]
    events.append([9.0, 0.5, [0, 0, 3.0], [0, 0, 0], "decay"])
    fitted = {
        "start": [5.1, 0.9, 7.0],
        "end": [6.0, 2.5, 7.5],
        "force": [[0.0, 2.0, 0.0], [1.5, 0.0, 0.0], [9.0, 9.0, 9.0]],
    }
    stderr = {"start": [0.1] * 3, "end": [0.1] * 3, "force": [[0.1] * 3] * 3}
    mine = make_label({"contact": {"events": events, "frame": "base"}})
    found = {one.parameter: one for one in compare(mine, make_said("explained", cause("contact", fitted, stderr)))}
    np.testing.assert_allclose(found["start"].error, [-0.1, 0.1])
    assert found["end"].inside.tolist() == [False, True, False]  # 0.5 s late, right, not found
    assert found["force"].inside.tolist() == [False, True, True, True, True, True, False]
    turning = make_label({"contact": {"events": events, "frame": "tool"}})
    (start, end) = compare(turning, make_said("explained", cause("contact", fitted, stderr)))
    assert (start.parameter, end.parameter) == ("start", "end")


def test_contacts_of_which_none_was_found_are_all_missed(make_label, make_said):
    mine = make_label({"contact": {"events": [[1.0, 1.0, [1.0, 0, 0], [0, 0, 0], "decay"]], "frame": "tool"}})
    fitted = cause("contact", {"start": [4.0], "end": [5.0]}, {"start": [0.1], "end": [0.1]})
    for found in compare(mine, make_said("explained", fitted)):
        assert found.inside.tolist() == [False]
