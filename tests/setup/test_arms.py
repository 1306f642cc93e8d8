"""The arms of arms.toml against forward kinematics from independent parameters: the manufacturers' tables."""

import tempfile
from pathlib import Path

import numpy as np
import pinocchio
import pytest

from ftbias_jax.setup.robots import BUILT_IN, built_in_robot, describe_robot
from ftbias_jax.setup.urdf import load_urdf, urdf_robot

HALF = np.pi / 2

# (alpha, a, d, offset of theta) of each joint, as the manufacturer prints them: standard Denavit-Hartenberg, where
# alpha and a of a row come last, or modified (Craig), where they come first.
UR_TWIST = (HALF, 0, 0, HALF, -HALF, 0)


def ur(d1, a2, a3, d4, d5, d6):
    lengths, offsets = (0, a2, a3, 0, 0, 0), (d1, 0, 0, d4, d5, d6)
    return [(*row, 0) for row in zip(UR_TWIST, lengths, offsets, strict=True)]


def kuka(base, upper):
    twists = (-HALF, HALF, HALF, -HALF, -HALF, HALF, 0)
    return [(twist, 0, d, 0) for twist, d in zip(twists, (base, 0, upper, 0, 0.4, 0, 0.126), strict=True)]


SHIN = np.arctan(284.5 / 53.5)  # xArm 6: angle between its second link and the line of the table
STANDARD = {
    "ur3": ur(0.1519, -0.24365, -0.21325, 0.11235, 0.08535, 0.0819),
    "ur5": ur(0.089159, -0.425, -0.39225, 0.10915, 0.09465, 0.0823),
    "ur10": ur(0.1273, -0.612, -0.5723, 0.163941, 0.1157, 0.0922),
    "ur3e": ur(0.15185, -0.24355, -0.2132, 0.13105, 0.08535, 0.0921),
    "ur5e": ur(0.1625, -0.425, -0.3922, 0.1333, 0.0997, 0.0996),
    "ur10e": ur(0.1807, -0.6127, -0.57155, 0.17415, 0.11985, 0.11655),
    "ur16e": ur(0.1807, -0.4784, -0.36, 0.17415, 0.11985, 0.11655),
    "ur20": ur(0.2363, -0.8620, -0.7287, 0.2010, 0.1593, 0.1543),
    "iiwa7": kuka(0.34, 0.4),
    "iiwa14": kuka(0.36, 0.42),
    "lbr_med7": kuka(0.34, 0.4),
    "lbr_med14": kuka(0.36, 0.42),
    "xarm6": [
        (-HALF, 0, 0.267, 0),
        (0, np.hypot(0.2845, 0.0535), 0, -SHIN),
        (-HALF, 0.0775, 0, SHIN),
        (HALF, 0, 0.3425, 0),
        (-HALF, 0.076, 0, 0),
        (0, 0, 0.097, 0),
    ],
    "xarm7": [
        (-HALF, 0, 0.267, 0),
        (HALF, 0, 0, 0),
        (HALF, 0.0525, 0.293, 0),
        (HALF, 0.0775, 0, 0),
        (HALF, 0, 0.3425, 0),
        (-HALF, 0.076, 0, 0),
        (0, 0, 0.097, 0),
    ],
    "gen3": [
        (np.pi, 0, 0, None),  # the fixed base
        (HALF, 0, -(0.15643 + 0.12838), 0),
        (HALF, 0, -(0.005375 + 0.006375), np.pi),
        (HALF, 0, -(0.21038 + 0.21038), np.pi),
        (HALF, 0, -(0.006375 + 0.006375), np.pi),
        (HALF, 0, -(0.20843 + 0.10593), np.pi),
        (HALF, 0, -(0.00017505 + 0.00017505), np.pi),
        (np.pi, 0, -(0.10593 + 0.061525), np.pi),
    ],
}
FRANKA = [
    (0, 0, 0.333, 0),
    (-HALF, 0, 0, 0),
    (HALF, 0, 0.316, 0),
    (HALF, 0.0825, 0, 0),
    (-HALF, -0.0825, 0.384, 0),
    (HALF, 0, 0, 0),
    (HALF, 0.088, 0, 0),
    (0, 0, 0.107, None),
]
MODIFIED = {
    "panda_link8": FRANKA,
    "fr3_link8": FRANKA,
    "meca500": [
        (0, 0, 0.135, 0),
        (-HALF, 0, 0, -HALF),
        (0, 0.135, 0, 0),
        (-HALF, 0.038, 0.120, 0),
        (HALF, 0, 0, 0),
        (-HALF, 0, 0.070, np.pi),
    ],
}


def turn(axis, angle):
    """(4, 4) rotation about a coordinate axis."""
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    matrix = np.eye(4)
    matrix[[i, j], [i, j]] = np.cos(angle)
    matrix[i, j], matrix[j, i] = -np.sin(angle), np.sin(angle)
    return matrix


def slide(x, y, z):
    matrix = np.eye(4)
    matrix[:3, 3] = x, y, z
    return matrix


def denavit_hartenberg(rows, q, *, modified=False):
    angles, pose = iter(q), np.eye(4)
    for alpha, a, d, offset in rows:
        joint = turn(2, 0.0 if offset is None else next(angles) + offset) @ slide(0, 0, d)
        twist = turn(0, alpha) @ slide(a, 0, 0)
        pose = pose @ (twist @ joint if modified else joint @ twist)
    assert next(angles, None) is None
    return pose


def forward(robot, q):
    """(4, 4) by matrix exponentials of the screws."""
    from scipy.linalg import expm

    pose = np.eye(4)
    for (vx, vy, vz, wx, wy, wz), angle in zip(robot.screws, q, strict=True):
        twist = np.array([[0, -wz, wy, vx], [wz, 0, -wx, vy], [-wy, wx, 0, vz], [0, 0, 0, 0]])
        pose = pose @ expm(twist * angle)
    flange = np.eye(4)
    flange[:3, :3], flange[:3, 3] = robot.flange_rotation, robot.flange_translation
    return pose @ flange


def poses(name, count=5):
    robot = built_in_robot(name)
    rng = np.random.default_rng(len(name))
    return robot, [np.zeros(len(robot.joint_names)), *rng.uniform(-3, 3, (count, len(robot.joint_names)))]


@pytest.mark.parametrize("name", [*STANDARD, *MODIFIED])
def test_arms_stand_where_the_manufacturers_table_says(name):
    robot, configurations = poses(name)
    for q in configurations:
        expected = denavit_hartenberg(STANDARD.get(name) or MODIFIED[name], q, modified=name in MODIFIED)
        np.testing.assert_allclose(forward(robot, q), expected, atol=1e-9)


def test_the_yumi_stands_where_its_axes_and_lengths_say():
    """Axes z y z y x y x, lengths of the product manual, forearm forwards at zero."""
    robot, configurations = poses("yumi")
    upper = [(-0.03, 0, 0.166), (0.03, 0, 0.2515), (0.0405, 0, 0)]
    steps = [*upper, (0.265, 0, 0.0405), (0, 0, -0.027), (0, 0, 0.027), (0.036, 0, 0)]
    for q in configurations:
        expected = np.eye(4)
        for axis, angle, step in zip((2, 1, 2, 1, 0, 1, 0), q, steps, strict=True):
            expected = expected @ turn(axis, angle) @ slide(*step)
        expected = expected @ turn(1, HALF)
        np.testing.assert_allclose(forward(robot, q), expected, atol=1e-9)


# Joint, origin (xyz; rpy) and axis of published URDFs: those that arms.toml names; of the YuMi's arms with the
# lengths of the product manual, where the published one rounds differently.
YUMI = [
    ((0.03, 0, 0.1), (HALF, 0, 0)),
    ((-0.03, 0.17283, 0), (-HALF, 0, 0)),
    ((-0.0405, 0, 0.2515 - 0.17283), (HALF, -HALF, 0)),
    ((0.0405, 0.16461, 0), (-HALF, 0, 0)),
    ((-0.027, 0, 0.265 - 0.16461), (HALF, 0, 0)),
    ((0.027, 0.029, 0), (-HALF, 0, 0)),
]
NONE = (0, 0, 0)
JACO = [((0, 0, 0.15675), (0, np.pi, 0), "0 0 1"), ((0, 0.0016, -0.11875), (-HALF, 0, np.pi), "0 0 1")]
PALM = ((0, 0, -0.16), (np.pi, 0, 0), None)
CURVED = ((0, -0.03703, -0.06414), (np.pi / 3, 0, np.pi), "0 0 1")
TOOL0 = (NONE, (0, HALF, 0), None)  # of the ROS-Industrial descriptions: z points out of the flange


def techman(base, upper, fore, offset):
    return [
        ((0, 0, base), NONE, "0 0 1"),
        (NONE, (-HALF, -HALF, 0), "0 0 1"),
        ((upper, 0, 0), NONE, "0 0 1"),
        ((fore, 0, offset), (0, 0, HALF), "0 0 1"),
        ((0, -0.106, 0), (HALF, 0, 0), "0 0 1"),
        ((0, -0.11315, 0), (HALF, 0, 0), "0 0 1"),
    ]


def doosan(base, shoulder, upper, fore):
    return [
        ((0, 0, base), NONE, "0 0 1"),
        ((0, shoulder, 0), (0, -1.571, -1.571), "0 0 1"),
        ((upper, 0, 0), (0, 0, 1.571), "0 0 1"),
        ((0, -fore, 0), (1.571, 0, 0), "0 0 1"),
        (NONE, (-1.571, 0, 0), "0 0 1"),
        ((0, -0.121, 0), (1.571, 0, 0), "0 0 1"),
    ]


def abb(base, upper, elbow, fore, wrist, tool):
    joints = [base, NONE, upper, elbow, fore, (tool, 0, wrist)]
    axes = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")
    return [*[(xyz, NONE, axis) for xyz, axis in zip(joints, axes, strict=True)], TOOL0]


URDF = {
    "sawyer": (
        [
            ((0, 0, 0.08), NONE, "0 0 1"),
            ((0.081, 0.05, 0.237), (-HALF, HALF, 0), "0 0 1"),
            ((0, -0.14, 0.1425), (HALF, 0, 0), "0 0 1"),
            ((0, -0.042, 0.26), (-HALF, 0, 0), "0 0 1"),
            ((0, -0.125, -0.1265), (HALF, 0, 0), "0 0 1"),
            ((0, 0.031, 0.275), (-HALF, 0, 0), "0 0 1"),
            ((0, -0.11, 0.1053), (-HALF, -0.17453, 3.1416), "0 0 1"),
            ((0, 0, 0.0245), (0, 0, HALF), None),
        ],
        NONE,
        2e-5,  # the published angles are rounded
    ),
    "lwr4+": (
        [
            ((0, 0, 0.11), NONE, "0 0 1"),
            ((0, 0, 0.2005), NONE, "0 -1 0"),
            ((0, 0, 0.2), NONE, "0 0 1"),
            ((0, 0, 0.2), NONE, "0 1 0"),
            ((0, 0, 0.2), NONE, "0 0 1"),
            ((0, 0, 0.19), NONE, "0 -1 0"),
            ((0, 0, 0.078), NONE, "0 0 1"),
        ],
        NONE,
        1e-9,
    ),
    "jaco2": (
        [
            *JACO,
            ((0, -0.41, 0), (0, np.pi, 0), "0 0 1"),
            ((0, 0.2073, -0.0114), (-HALF, 0, np.pi), "0 0 1"),
            CURVED,
            CURVED,
            PALM,
        ],
        NONE,
        1e-4,  # published to 10 um a link
    ),
    "tm5-700": (techman(0.1452, 0.329, 0.3115, -0.1223), NONE, 1e-9),
    "tm5-900": (techman(0.1452, 0.429, 0.4115, -0.1223), NONE, 1e-9),
    "tm12": (techman(0.1652, 0.6361, 0.5579, -0.1563), NONE, 1e-9),
    "m0609": (doosan(0.1, 0.0062, 0.411, 0.368), NONE, 2e-3),  # right angles are published rounded, as 1.571
    "m1013": (doosan(0.1525, 0.0345, 0.62, 0.559), NONE, 2e-3),
    "crx10ia": (
        [
            ((0, 0, 0.245), NONE, "0 0 1"),
            (NONE, NONE, "0 1 0"),
            ((0, 0, 0.54), NONE, "0 -1 0"),
            (NONE, NONE, "-1 0 0"),
            ((0.54, 0, 0), NONE, "0 -1 0"),
            ((0, -0.15, 0), NONE, "-1 0 0"),
            ((0.16, 0, 0), (np.pi, -HALF, 0), None),
        ],
        NONE,
        1e-9,
    ),
    "gofa": (abb((0, 0, 0.265), (0, 0, 0.444), (0, 0, 0.11), (0.47, 0, 0), 0.08, 0.101), NONE, 1e-9),
    "irb120": (
        [((0, 0, 0.29), NONE, None), *abb(NONE, (0, 0, 0.27), (0, 0, 0.07), (0.302, 0, 0), 0, 0.072)],
        NONE,
        1e-9,
    ),
    "vs060": (
        [
            ((0, 0, 0.1815), NONE, "0 0 1"),
            ((0, 0, 0.1635), NONE, "0 1 0"),
            ((0, 0, 0.305), NONE, "0 1 0"),
            ((-0.01, 0, 0.1645), NONE, "0 0 1"),
            ((0, 0, 0.1355), NONE, "0 1 0"),
            ((0, 0, 0.07), NONE, "0 0 1"),
        ],
        NONE,
        1e-9,
    ),
    "yumi_left": (
        [(xyz, rpy, "0 0 1") for xyz, rpy in [((0.05355, 0.0725, 0.41492), (0.9781, -0.5716, 2.3180)), *YUMI]],
        (0, 0, 0.007),
        2e-6,  # the mounting is stored in degrees, with four digits
    ),
    "yumi_right": (
        [(xyz, rpy, "0 0 1") for xyz, rpy in [((0.05355, -0.0725, 0.41492), (-0.9795, -0.5682, -2.3155)), *YUMI]],
        (0, 0, 0.007),
        2e-6,
    ),
}


def written_urdf(rows, tip):
    def words(values):
        return " ".join(repr(float(x)) for x in values)

    parts = ['<robot name="arm"><link name="l0"/>']
    for i, (xyz, rpy, axis) in enumerate([*rows, (tip, (0, 0, 0), None)], 1):
        kind = "fixed" if axis is None else "continuous"
        parts.append(
            f'<link name="l{i}"/><joint name="j{i}" type="{kind}"><parent link="l{i - 1}"/><child link="l{i}"/>'
            f'<origin xyz="{words(xyz)}" rpy="{words(rpy)}"/><axis xyz="{axis or "0 0 1"}"/></joint>'
        )
    return "".join([*parts, "</robot>"])


@pytest.mark.parametrize("name", list(URDF))
def test_arms_stand_where_pinocchio_puts_a_published_urdf(name):
    """The same holds for an arm that is read from that URDF."""
    rows, tip, tolerance = URDF[name]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "arm.urdf")
        path.write_text(written_urdf(rows, tip))
        model = pinocchio.buildModelFromUrdf(str(path))
        read = urdf_robot(load_urdf(str(path)), "l0", f"l{len(rows) + 1}", np.zeros(3))
    data = model.createData()
    robot, configurations = poses(name)
    for q in configurations:
        pinocchio.framesForwardKinematics(model, data, np.column_stack([np.cos(q), np.sin(q)]).ravel())
        expected = data.oMf[model.getFrameId(f"l{len(rows) + 1}")].homogeneous
        np.testing.assert_allclose(forward(robot, q), expected, atol=tolerance)
        np.testing.assert_allclose(forward(read, q), expected, atol=1e-9)


COMPARED_ONCE = {"jaco2_spherical", "jaco2_7dof"}
"""The robot models of example-robot-data and of robosuite are too large to be installed for tests."""


def test_every_arm_has_been_compared():
    assert {*STANDARD, *MODIFIED, *URDF, *COMPARED_ONCE, "yumi", "panda", "fr3"} == set(BUILT_IN)


@pytest.mark.parametrize("name", BUILT_IN)
def test_arms_have_names_limits_and_a_description(name):
    robot = built_in_robot(name)
    n = len(robot.joint_names)
    assert len(set(robot.joint_names)) == n == len(robot.screws)
    assert all(np.linalg.norm(screw[3:]) == pytest.approx(1, abs=1e-12) for screw in robot.screws)
    np.testing.assert_allclose(robot.flange_rotation @ robot.flange_rotation.T, np.eye(3), atol=1e-15)
    assert describe_robot(name)
    if robot.position_limits is None:  # of an arm that is stored as a Denavit-Hartenberg table
        assert robot.velocity_limits is None
        return
    assert robot.position_limits.shape == (n, 2)
    assert (robot.position_limits[:, 0] < robot.position_limits[:, 1]).all()
    assert np.abs(robot.position_limits[np.isfinite(robot.position_limits)]).max() < 7  # rad
    assert ((robot.velocity_limits > 1) & (robot.velocity_limits < 10)).all()


@pytest.mark.parametrize(("ours", "theirs"), [("panda", "panda_link8"), ("fr3", "fr3_link8")])
def test_the_frame_of_the_report_lies_107_mm_beyond_the_manufacturers_flange(ours, theirs):
    report, maker = built_in_robot(ours), built_in_robot(theirs)
    np.testing.assert_allclose(report.screws, maker.screws, atol=1e-15)
    np.testing.assert_array_equal(report.flange_rotation, maker.flange_rotation)
    beyond = maker.flange_rotation.T @ (report.flange_translation - maker.flange_translation)
    np.testing.assert_allclose(beyond, [0, 0, 0.107], atol=1e-15)
    assert report.joint_names == maker.joint_names
    assert "107 mm" in describe_robot(ours)
