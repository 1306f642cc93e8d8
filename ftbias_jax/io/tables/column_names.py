"""Names of columns and words for units that people, robots and loggers use.

Names are in lower case, with words separated by underscores, and without units.
"""

from collections.abc import Mapping


def _words(text: str) -> dict[str, str]:
    """Map word -> value, from entries "value: word, word, ..." separated by semicolons."""
    lines = (line.split(":") for line in text.split(";"))
    return {word.strip(): value.strip() for value, words in lines for word in words.split(",")}


UNITS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "time": (
        "log.time_unit",
        _words("s: s, sec, secs, seconds; ms: ms, msec, milliseconds; us: us, usec, µs, microseconds; ns: ns, nsec, "
               "nanoseconds"),
    ),
    "angle": ("log.angle_unit", _words("rad: rad, radians, rad/s, radps; deg: deg, degrees, °, deg/s, °/s, dps")),
    "acceleration": ("log.acceleration_unit", _words("m/s^2: m/s^2, m/s2, m/s²; g: g")),
    "force": ("log.force_unit", _words("N: n; kN: kn; mN: mn; lbf: lbf, lbs, lb; kgf: kgf")),
    "torque": (
        "log.torque_unit",
        _words("Nm: nm, n m, n*m, n.m, n-m, n·m; Nmm: nmm, n mm, n-mm, mnm; Ncm: ncm, n-cm; lbf-in: lbf-in, lbf in, "
               "lbf.in, lbf·in, lbfin, in-lbf, in-lb, in-lbs; lbf-ft: lbf-ft, lbf ft, lbf.ft, lbf·ft, lbfft, ft-lbf, "
               "ft-lb, ft-lbs; kgf-m: kgf-m, kgf m, kgfm; kgf-cm: kgf-cm, kgf cm, kgfcm"),
    ),
    "temperature": ("", _words(": c, °c, degc, celsius, k, kelvin")),
    "length": ("log.length_unit", _words("m: m; mm: mm")),
    "travel": ("log.length_unit", _words("m: [m], m/s; mm: mm, mm/s")),
}  # fmt: skip
"""Dimension -> the setup's key that states the unit, and a map from words for units to values of that key."""
DIMENSIONS: Mapping[str, str] = {
    "time": "time",
    "temperature": "temperature",
    "position": "angle",
    "velocity": "angle",
    "gyroscope": "angle",
    "accelerometer": "acceleration",
    "place": "length",
    "axis_angle": "angle",
    "rpy": "angle",
}
"""Quantity -> dimension; quaternions and matrices have none."""
DIMENSIONS_OF_SEVERAL: Mapping[str, tuple[str, ...]] = {
    "wrench": ("force", "torque"),
    **dict.fromkeys(("position", "velocity"), ("angle", "travel")),
}
"""Quantity -> dimensions of its columns: joints may be revolute or prismatic."""
OTHER = "other_"
"""Prefix of a quantity in the tables below: names that are looked for only if none of the usual ones is found."""
Names = tuple[str, ...]

FORCES, TORQUES = tuple(f"force_{x}" for x in "xyz"), tuple(f"torque_{x}" for x in "xyz")
QUATERNIONS = ("q", "orientation_", "quaternion_", "quat_")
FIXED: Mapping[str, tuple[Names, ...]] = {
    "time": (("t",), ("time",), ("timestamp",), ("timestamps",), ("stamp",), ("seconds",)),
    "other_time": (("time_stamp",), ("elapsed_time",), ("ros_time",), ("rostime",), ("unix_time",), ("zeit",)),
    "temperature": (("temperature",), ("temp",)),
    "wrench": (
        ("fx", "fy", "fz", "tx", "ty", "tz"),
        ("fx", "fy", "fz", "mx", "my", "mz"),
        (*FORCES, *TORQUES),
        (*FORCES, *(f"moment_{x}" for x in "xyz")),
        tuple(f"{name}_{i}" for name in ("force", "torque") for i in range(3)),
        *(
            tuple(f"{name}{x}" for name in names for x in "xyz")
            for names in (
                ("f_", "t_"),
                ("f_", "m_"),
                ("force", "torque"),
                ("kraft_", "moment_"),
                ("kraft_", "drehmoment_"),
            )
        ),
    ),
    **{
        f"quaternion_{order}": (
            *(tuple(f"{stem}{x}" for x in order) for stem in QUATERNIONS),
            *(
                tuple(f"{stem}{first + 'wxyz'.index(x)}" for x in order) for stem, first in (("q", 1), ("u", 0))
            ),  # of ABB
        )
        for order in ("xyzw", "wxyz")
    },
    "matrix": (tuple(f"r{i}{j}" for i in "123" for j in "123"),),
    "axis_angle": (("rx", "ry", "rz"), tuple(f"actual_tcp_pose_{i}" for i in (3, 4, 5))),
    # Columns C, B, A of a KUKA; W, P, R of a Fanuc; those of other robots, as those of an axis-angle, are rx, ry, rz.
    "rpy": (
        *(("roll", "pitch", "yaw"), ("c", "b", "a"), ("rist_c", "rist_b", "rist_a"), ("w", "p", "r")),
        ("rx", "ry", "rz"),
    ),
    "place": (
        *(tuple(f"{stem}{x}" for x in "xyz") for stem in ("", "position_", "rist_")),
        tuple(f"actual_tcp_pose_{i}" for i in range(3)),
    ),
    "gyroscope": tuple(tuple(f"{stem}{x}" for x in "xyz") for stem in ("w", "angular_velocity_", "gyro_")),
    "accelerometer": tuple(
        tuple(f"{stem}{x}" for x in "xyz") for stem in ("a", "linear_acceleration_", "accel_", "acc_")
    ),
}
"""Quantity -> the sets of names that its columns may have."""
COUNTED: Mapping[str, Names] = {
    "position": (
        *("actual_q", "q", "joint_positions", "joint_position", "joint_pos", "joint_angles", "joint_angle"),
        *("joints", "joint", "positions", "position", "qpos", "axis", "a"),
    ),
    "velocity": (
        *("actual_qd", "dq", "qd", "joint_velocities", "joint_velocity", "joint_vel", "velocities", "velocity", "qvel"),
    ),
    "other_position": (
        *("q_actual", "q_measured", "q_meas", "jointpos", "measuredjointposition", "jpos", "theta", "j", "achse"),
        "gelenk",
    ),
    "other_velocity": ("qdot", "q_dot", "joint_speeds", "joint_speed", "jointvel", "jvel"),
    "wrench": (
        *("ft_raw_wrench", "actual_tcp_force", "k_f_ext_hat_k", "o_f_ext_hat_k", "force_torque", "ft_sensor"),
        *("external_wrench", "wrench", "ft"),
    ),
}
"""Quantity -> stems of the names of its columns, which are numbered from 0 or 1."""
BY_JOINT: Mapping[str, Names] = {
    "position": ("position_{}", "{}_position", "{}_pos", "{}"),
    "velocity": ("velocity_{}", "{}_velocity", "{}_vel"),
}
"""Quantity -> templates of its columns' names, in which {} is the name of a joint."""
OF_JOINTS = ("j",)
"""Stems that mean joints, not their measured quantity; not accepted with a prefix, because torque_J1 is no position."""
IN_BASE_AXES = ("actual_tcp_force", "o_f_ext_hat_k")
"""Wrenches that UR and Franka report in the axes of the base."""
TO_NAME = "write the names of the columns in a first line of the file, such as # t,fx,fy,fz,tx,ty,tz,q0,q1,q2,q3,q4,q5"
"""Remedy in error messages about columns without names."""
