"""Faults in recorded streams, one test per row of the table of faults: a typed error, or a counted repair.

Every recording has 60 wrenches at 100 Hz and 30 joint states at 50 Hz; faults are put into its messages.
"""

import log_files
import numpy as np
import pytest
import recordings
from recordings import SECOND, START, Joints, Wrench

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.log import Repair

N = 60


def read(tmp_path, setup, published, kind="ros1"):
    log = read_log(recordings.write(tmp_path, kind, published), setup)
    assert not np.isinf(np.column_stack([log.q, log.dq, log.wrench])).any()
    assert (np.diff(log.t) > 0).all()
    return log, [repair.what for repair in log.repairs], any(repair.lost for repair in log.repairs)


def changed(change, kind=(Joints, Wrench)):
    """The messages after a function of (index, message) has been applied to those of a kind; None = dropped."""
    count, result = 0, []
    for message in recordings.messages():
        if isinstance(message, kind):
            message, count = change(count, message), count + 1
        if message is not None:
            result.append(message)
    return result


def measured(log):
    return int((~np.isnan(log.wrench).any(1)).sum()), int((~np.isnan(log.q).any(1)).sum())


def with_axis(value):
    return lambda i, m: m._replace(wrench=(*m.wrench[:2], value, *m.wrench[3:])) if i == 7 else m


def test_nan_in_one_axis_is_a_missing_axis(tmp_path, setup):
    log, repairs, _ = read(tmp_path, setup, changed(with_axis(np.nan), Wrench))
    assert np.isnan(log.wrench[7]).tolist() == [False, False, True, False, False, False]
    assert not repairs


def test_infinity_in_one_axis_is_refused(tmp_path, setup):
    with pytest.raises(LogError, match=r"wrench: wrench\[7, 2\] is infinite \(mark missing"):
        read(tmp_path, setup, changed(with_axis(np.inf), Wrench))


def test_empty_velocities_are_not_measured(tmp_path, setup):
    log, _, _ = read(tmp_path, setup, changed(lambda i, m: m._replace(velocity=()), Joints))
    assert np.isnan(log.dq).all()
    assert measured(log) == (N, N // 2)


def test_a_nan_position_is_not_measured(tmp_path, setup):
    log, _, _ = read(tmp_path, setup, changed(lambda i, m: m._replace(position=(np.nan, 1.0)) if i == 3 else m, Joints))
    assert np.isnan(log.q[6]).tolist() == [True, False]


def test_random_drops_leave_the_rest(tmp_path, setup):
    keep = np.random.default_rng(0).random(N) > 0.3
    log, repairs, _ = read(tmp_path, setup, changed(lambda i, m: m if keep[i] else None, Wrench))
    assert measured(log) == (keep.sum(), N // 2)
    assert not repairs


def test_repeated_stamps_are_left_out_and_counted(tmp_path, setup):
    twice = [m for message in recordings.messages() for m in [message] * (2 if isinstance(message, Wrench) else 1)]
    log, repairs, lost = read(tmp_path, setup, twice)
    np.testing.assert_array_equal(log.wrench, recordings.arrays()["wrench"])
    assert repairs == ["60 of the samples of /wrench left out: their stamps are repeated"]
    assert lost


def write_table(path, t, q, wrench):
    """A merged timeline in a format other than ROS."""
    return log_files.write(path, {"t": t, "q": q, "wrench": wrench})


every_table = pytest.mark.parametrize("name", [f"log{suffix}" for suffix in log_files.SUFFIXES])


def rows():
    """60 rows at 100 Hz."""
    rng = np.random.default_rng(0)
    return 5 + 0.01 * np.arange(N), rng.normal(size=(N, 2)), rng.normal(size=(N, 6))


TWICE, AGAIN = np.repeat(np.arange(N), 2), np.arange(2 * N)[:, None] % 2
LATE = np.arange(N).reshape(-1, 4)[:, ::-1].ravel()  # by 0.03 s at most
MENDED = {
    "repeated stamps are left out": (
        lambda t, q, wrench: (t[TWICE], q[TWICE], wrench[TWICE] + AGAIN),
        (Repair(f"{N} of the samples left out: their stamps are repeated", lost=True),),
    ),
    "late rows are put in order": (
        lambda t, q, wrench: (t[LATE], q[LATE], wrench[LATE]),
        (Repair(f"{3 * N // 4} of the samples came late: put in order"),),
    ),
    "joints and wrench in two rows of one stamp become one": (
        lambda t, q, wrench: (t[TWICE], np.where(AGAIN, np.nan, q[TWICE]), np.where(AGAIN, wrench[TWICE], np.nan)),
        (),
    ),
}


@every_table
@pytest.mark.parametrize("what", MENDED)
def test_rows_of_tables_are_mended_and_counted_too(tmp_path, setup, name, what):
    t, q, wrench = rows()
    spoil, repairs = MENDED[what]
    write_table(tmp_path / name, *spoil(t, q, wrench))
    log = read_log(tmp_path / name, setup)
    np.testing.assert_array_equal(np.hstack([log.q, log.wrench]), np.hstack([q, wrench]))
    assert log.repairs == repairs


@every_table
def test_a_clock_of_tables_that_was_set_back_is_refused(tmp_path, setup, name):
    t, q, wrench = rows()
    t[30:] -= 0.25
    write_table(tmp_path / name, t, q, wrench)
    with pytest.raises(LogError, match=r"t: time does not increase: t\[30\] = .*cut the log where its clock was set"):
        read_log(tmp_path / name, setup)


def test_late_messages_are_put_in_order_and_counted(tmp_path, setup):
    published = recordings.messages()
    for i in range(0, 80, 8):  # 0.03 s late at most
        published[i : i + 4] = published[i : i + 4][::-1]
    log, repairs, lost = read(tmp_path, setup, published, "sqlite")
    np.testing.assert_array_equal(log.wrench, recordings.arrays()["wrench"])
    assert [what.split(" ", 1)[1] for what in repairs] == [
        f"of the samples of {topic} came late: put in order" for topic in ("/joint_states", "/wrench")
    ]
    assert not lost


def back(message, logged):
    """From the middle on, the clock is set back by 0.25 s."""
    if message.stamp < START + 30 * SECOND // 100:
        return message
    stamp = message.stamp - SECOND // 4
    return message._replace(stamp=stamp, logged=message.stamp if logged else stamp)


def test_a_clock_set_back_in_the_headers_gives_way_to_the_recorders(tmp_path, setup):
    log, repairs, _ = read(tmp_path, setup, changed(lambda i, m: back(m, True)))
    assert measured(log) == (N, N // 2)
    assert repairs[0].startswith(
        "the headers' clock jumps back: times of the recorder used; /joint_states was recorded"
    )


def test_a_clock_set_back_everywhere_splits_the_log_in_segments(tmp_path, setup):
    log, repairs, _ = read(tmp_path, setup, changed(lambda i, m: back(m, False)), "sqlite")
    assert repairs == ["the clock jumps back (1 in all): what follows is put 1 s after what was before"]
    assert measured(log) == (N, N // 2)
    np.testing.assert_allclose(np.diff(log.t).max(), 1.0)


def test_a_clock_set_back_is_refused_in_files_that_are_written_on_purpose(tmp_path, setup):
    log = recordings.arrays()
    log["t_wrench"] = np.r_[log["t_wrench"][:30], log["t_wrench"][30:] - SECOND // 4]
    np.savez(tmp_path / "log.npz", **log)
    with pytest.raises(LogError, match="t_wrench: time does not increase"):
        read_log(tmp_path / "log.npz", setup)


def test_a_gap_of_an_hour_stays(tmp_path, setup):
    late = changed(lambda i, m: m._replace(stamp=m.stamp + 3600 * SECOND) if m.stamp > START + SECOND // 3 else m)
    log, repairs, _ = read(tmp_path, setup, late)
    assert np.diff(log.t).max() == pytest.approx(3600.01)
    assert not repairs


def test_zero_stamps_give_way_to_the_recorders_times(tmp_path, setup):
    zero = changed(lambda i, m: m._replace(stamp=0, logged=m.stamp + 5))
    log, repairs, lost = read(tmp_path, setup, zero)
    assert log.start == pytest.approx(START * 1e-9)
    assert repairs[0].endswith("times of the recorder used; /joint_states has no stamps, /wrench has no stamps")
    assert not lost


def test_zero_stamps_of_one_stream_move_both_to_the_recorders_times(tmp_path, setup):
    zero = changed(lambda i, m: m._replace(stamp=0, logged=m.stamp + SECOND), Wrench)
    late = [m._replace(logged=m.stamp + SECOND) if isinstance(m, Joints) else m for m in zero]
    log, repairs, _ = read(tmp_path, setup, late)
    np.testing.assert_array_equal(log.wrench, recordings.arrays()["wrench"])
    assert "/joint_states was recorded 1 s after its stamps, /wrench has no stamps" in repairs[0]


def test_a_few_zero_stamps_are_left_out_and_counted(tmp_path, setup):
    published = changed(lambda i, m: m._replace(stamp=0, logged=m.stamp) if i == 5 else m, Wrench)
    _, repairs, lost = read(tmp_path, setup, published)
    assert repairs == ["1 of the samples of /wrench left out: they have no stamp"]
    assert lost


def test_epoch_stamps_keep_their_nanoseconds(tmp_path, setup):
    uneven = changed(lambda i, m: m._replace(stamp=m.stamp + i))
    log, _, _ = read(tmp_path, setup, uneven)
    expected = np.unique([m.stamp - uneven[0].stamp for m in uneven])
    np.testing.assert_array_equal(log.t, expected * 1e-9)


@pytest.mark.parametrize(
    "t",
    [
        *(np.arange(N) / rate * unit for rate in (500.0, 1000.0) for unit in (1e3, 1e6, 1e9)),
        *(np.arange(N) * step for step in (1, 2, 2000)),  # whole numbers are taken for nanoseconds
    ],
)
def test_a_wrong_unit_of_time_is_named_by_its_implausible_rate(tmp_path, setup, t):
    np.savez(tmp_path / "log.npz", t=t, q=np.zeros((N, 2)), wrench=np.ones((N, 6)))
    with pytest.raises(LogError, match=r"t: the wrench has a rate of [\d.e+-]+ Hz, which is implausible \(give"):
        read_log(tmp_path / "log.npz", setup)


def test_shuffled_joints_are_matched_by_name(tmp_path, setup):
    def shuffle(i, m):
        return m._replace(names=m.names[::-1], position=m.position[::-1], velocity=m.velocity[::-1]) if i % 3 else m

    log, _, _ = read(tmp_path, setup, changed(shuffle, Joints), "mcap")
    np.testing.assert_array_equal(log.q[::2], recordings.arrays()["q"])


def test_a_missing_joint_is_named(tmp_path, setup):
    base = changed(lambda i, m: m._replace(names=("base",), position=(0.0,), velocity=(0.0,)), Joints)
    with pytest.raises(LogError, match="joint 'elbow' is never measured"):
        read(tmp_path, setup, base)


def test_extra_joints_are_left_out(tmp_path, setup):
    def extra(i, m):
        return m._replace(names=("x", *m.names), position=(9.0, *m.position), velocity=(9.0, *m.velocity))

    log, _, _ = read(tmp_path, setup, changed(extra, Joints))
    np.testing.assert_array_equal(log.q[::2], recordings.arrays()["q"])


def test_joints_of_another_robot_are_listed(tmp_path, setup):
    with pytest.raises(LogError, match=r"none of the setup's joints base, elbow is recorded .*/joint_states has a, b"):
        read(tmp_path, setup, changed(lambda i, m: m._replace(names=("a", "b")), Joints))


@pytest.mark.parametrize("velocity", [(1.0,), (1.0, 2.0, 3.0)])
def test_messages_of_unequal_lengths_are_refused_or_counted(tmp_path, setup, velocity):
    published = changed(lambda i, m: m._replace(velocity=velocity) if i == 4 else m, Joints)
    with pytest.raises(LogError, match=r"message 5 of /joint_states has 2 names, but \d numbers \(--salvage"):
        read(tmp_path, setup, published)
    reading = read_log(tmp_path / "log.bag", setup, salvage=True)
    assert measured(reading) == (N, N // 2 - 1)
    assert [repair.lost for repair in reading.repairs] == [True, False]


def test_streams_that_do_not_overlap_are_refused(tmp_path, setup):
    hour = 3600 * SECOND
    with pytest.raises(LogError, match="the streams do not overlap in time"):
        read(tmp_path, setup, changed(lambda i, m: m._replace(stamp=m.stamp + hour, logged=m.stamp + hour), Wrench))


def test_streams_of_different_clocks_give_way_to_the_recorders_times(tmp_path, setup):
    log, repairs, _ = read(
        tmp_path, setup, changed(lambda i, m: m._replace(stamp=m.stamp % SECOND + 1, logged=m.stamp), Wrench)
    )
    assert measured(log) == (N, N // 2)
    assert "different clocks" in repairs[0]
    assert "/wrench was recorded 1.7e+09 s after its stamps" in repairs[0]
