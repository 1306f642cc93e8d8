"""Mistakes are named from static poses, too, with stamps and without."""

import numpy as np
import pytest
from small_checks import checked_poses, static_poses

import ftbias_jax as ft
from ftbias_jax.io.pose import quaternions_of
from ftbias_jax.setup.rotations import rotation_from_vector


def reads(matrix=None, columns=(0, 1, 2, 3, 4, 5), scale=1.0):
    P = np.eye(3) if matrix is None else np.array(matrix, float)

    def change(tables, arrays):
        turned = np.concatenate([arrays["wrench"][:, :3] @ P.T, arrays["wrench"][:, 3:] @ P.T], 1)
        arrays["wrench"] = scale * turned[:, columns]

    return change


CHANGES = {
    "sign": reads(scale=-1.0),
    "gravity": lambda tables, arrays: tables["robot"].update(gravity=[9.81, 0.0, 0.0]),
    "wrench_units": reads(scale=1 / 9.80665),
    "tool_units": lambda tables, arrays: tables["tool"].update(mass=800.0),
    "angle_units": lambda tables, arrays: arrays.update(q=np.degrees(arrays["q"])),
    "force_torque_swapped": reads(columns=[3, 4, 5, 0, 1, 2]),
    "sensor_axes": reads(np.diag([-1, -1, 1])),
}


def stamped(arrays, seed=0):
    """Poses that were recorded by hand at irregular times."""
    return {**arrays, "t": 1.7e9 + np.cumsum(np.random.default_rng(seed).uniform(4, 60, len(arrays["q"])))}


@pytest.mark.parametrize("mistake", CHANGES)
@pytest.mark.parametrize("count", [17, 100])
def test_a_mistake_is_named_from_static_poses(mistake, count):
    tables, arrays = static_poses(1, count)
    CHANGES[mistake](tables, arrays)
    for given in (arrays, stamped(arrays)):
        assert checked_poses(tables, given).findings[0].mistake == mistake


@pytest.mark.parametrize("gravity", [[0.0, 0.0, -9.81], [0.0, 9.81, 0.0], [4.0, -5.0, -7.43]])
def test_right_poses_are_not_suspected_however_the_arm_is_mounted(gravity):
    for seed, count in enumerate((12, 17, 60)):
        tables, arrays = static_poses(seed, count)
        robot = {**tables["robot"], "gravity": gravity}
        tables, arrays = static_poses(seed, count, robot=robot)
        for given in (arrays, stamped(arrays)):
            found = checked_poses(tables, given)
            assert found.ok, str(found)


def test_any_direction_of_gravity_is_found_from_static_poses():
    robot = {**static_poses()[0]["robot"], "gravity": [4.0, -5.0, -7.43]}
    tables, arrays = static_poses(2, 20, robot=robot)
    tables["robot"] = {**robot, "gravity": [0.0, 0.0, 9.81]}
    (first,) = checked_poses(tables, arrays).findings
    assert first.mistake == "gravity"
    np.testing.assert_allclose(first.setup["robot.gravity"], robot["gravity"], atol=0.4)


@pytest.mark.parametrize(
    "change",
    [lambda x: x[:, [3, 0, 1, 2]], lambda x: x * [-1, -1, -1, 1]],
    ids=["in the other order", "conjugate"],
)
def test_a_quaternion_that_is_read_wrong_is_named_from_static_poses(change):
    rng = np.random.default_rng(0)
    R = np.stack([rotation_from_vector(rng.uniform(-2, 2, 3)) for _ in range(20)])
    weight = 9.81 * 0.8 * R[:, 2]
    wrench = np.concatenate([weight, np.cross([0.01, 0, 0.06], weight)], 1) + rng.normal(size=(20, 6)) * 0.01
    tables = {
        "sensor_pose": {"linear": "position"},
        "sensor": {"noise_std": [0.1, 0.004]},
        "tool": {"mass": 0.8, "center_of_mass": [0.01, 0, 0.06]},
    }
    quaternion = quaternions_of(R)[:, [1, 2, 3, 0]]
    assert checked_poses(tables, {"orientation": quaternion, "wrench": wrench}).ok
    (first,) = checked_poses(tables, {"orientation": change(quaternion), "wrench": wrench}).findings
    assert first.mistake == "quaternion_convention"


def test_a_sensor_that_is_set_to_zero_between_poses_is_told_by_the_number_of_the_pose():
    tables, arrays = static_poses(3, 40)
    arrays["wrench"][20:] -= arrays["wrench"][20]
    found = checked_poses(tables, stamped(arrays))
    (first,) = found.findings
    assert first.evidence == {"poses": [21]}
    assert "just before pose 21" in first.remedy


def test_a_few_poses_show_nothing():
    tables, arrays = static_poses(count=8)
    found = checked_poses(tables, {**arrays, "wrench": -arrays["wrench"]})
    assert found.ok
    assert {kind.mistake for kind in found.undetermined} >= set(CHANGES)


def test_poses_and_logs_are_not_mixed():
    tables, arrays = static_poses()
    setup = ft.parse_setup(tables)
    poses = ft.Poses.from_arrays(setup, **arrays)
    log = ft.Log.from_arrays(setup, t=np.arange(24.0) / 10, **arrays)
    with pytest.raises(ft.UsageError, match="not checked together"):
        ft.check_setup(setup, [poses, log])
