"""Logs of a UR5e as users have them: various headers, units and axes, sensors that subtract the payload or tare."""

import json

import numpy as np

import ftbias_jax as ft
from ftbias_jax.io.pose import arm_rotations

TRUTH = {
    "robot": {"model": "ur5e"},
    "sensor": {"noise_std": [0.08, 0.003]},
    "tool": {"mass": 1.2, "center_of_mass": [0.01, -0.004, 0.07], "inertia": [2e-3, 0, 0, 2e-3, 0, 1e-3]},
}
SECONDS, RATE = 40.0, 125.0
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3")


def truth():
    """Return setup, t (T,) s, q and dq (T, 6), the wrench (T, 6) in sensor axes, and the wrench of the tool (T, 6)."""
    setup = ft.parse_setup(TRUTH)
    made = ft.simulate(setup, duration=SECONDS, rate=RATE, motion="moves", seed=77)
    t, q, dq, wrench = (np.asarray(x) for x in made.log[:4])
    return setup, t, q, dq, wrench, np.asarray(made.truth.wrench_tool)


def table(path, columns):
    """Write a CSV of named columns (T,) or (T, k); return its path."""
    names, blocks = [], []
    for name, values in columns.items():
        several = isinstance(name, tuple)
        names += list(name) if several else [name]
        blocks.append(np.reshape(values, (len(values), -1)))
    np.savetxt(path, np.hstack(blocks), "%.15g", ",", header=",".join(names), comments="")
    return path


def _numbered(pattern, first=0):
    return tuple(pattern.format(i) for i in range(first, first + 6))


def in_base_axes(setup, q, wrench):
    """Rotate a wrench (T, 6) into the axes of the base."""
    turned = arm_rotations(setup.robot, setup.sensor, q)
    return np.hstack([np.einsum("tij,tj->ti", turned, wrench[:, part]) for part in (slice(3), slice(3, 6))])


def logs(folder):
    """Yield name, files, options of ``ftbias setup``, and the wrench (T, 6) that the drafted setup should read."""
    setup, t, q, dq, wrench, tool = truth()
    robot = ["--robot", "ur5e"]
    plain, axes = _numbered("q{}"), ("Fx", "Fy", "Fz", "Mx", "My", "Mz")
    wall = 1_700_000_000 + t

    def case(name, columns, expected=wrench):
        return [table(folder / f"{name}.csv", columns)], robot, expected

    xyz = ("x", "y", "z")
    ros_wrench = tuple(f"/wrench/wrench/{part}/{x}" for part in ("force", "torque") for x in xyz)
    yield "Fx..Mz", *case("fx_mz", {"time": t, plain: q, axes: wrench})
    yield (
        "Fx [N]..Tz [Nmm], degrees",
        *case(
            "units",
            {
                "Time [ms]": 1e3 * t,
                _numbered("joint_{} [deg]", 1): np.degrees(q),
                ("Fx [N]", "Fy [N]", "Fz [N]", "Tx [Nmm]", "Ty [Nmm]", "Tz [Nmm]"): wrench * np.repeat([1, 1e3], 3),
            },
        ),
    )
    names = tuple(f"{part}_{x}" for part in ("force", "torque") for x in xyz)
    yield "force_x..torque_z", *case("force_x", {"timestamp": wall, _numbered("joint_{}"): q, names: wrench})
    yield (
        "UR RTDE, base axes",
        *case(
            "rtde",
            {
                "timestamp": 1e4 + t,
                _numbered("actual_q_{}"): q,
                _numbered("actual_qd_{}"): dq,
                _numbered("actual_TCP_force_{}"): in_base_axes(setup, q, wrench),
            },
        ),
    )
    yield (
        "PlotJuggler",
        *case(
            "plotjuggler",
            {"__time": wall, _numbered("/joint_states/position[{}]"): q, ros_wrench: wrench},
        ),
    )
    yield (
        "PlotJuggler, by joint",
        *case(
            "plotjuggler_names",
            {"__time": wall, tuple(f"/joint_states/{x}_joint/position" for x in JOINTS): q, ros_wrench: wrench},
        ),
    )
    yield "ft_0..5", *case("ft", {"t": t, plain: q, _numbered("ft_{}"): wrench})
    yield (
        "libfranka's names",
        *case(
            "franka",
            {"time": t, _numbered("q[{}]"): q, _numbered("dq[{}]"): dq, _numbered("K_F_ext_hat_K[{}]"): wrench},
        ),
    )
    yield (
        "payload subtracted",
        *case("compensated", {"t": t, plain: q, axes: wrench - tool}, wrench - tool),
    )
    zeroed = wrench - wrench[:20].mean(0)
    yield (
        "zeroed at the start",
        *case("zeroed", {"t": t, plain: q, ("Fx", "Fy", "Fz", "Mx", "My", "Mz"): zeroed}, zeroed),
    )
    yield (
        "sensor of the other sign",
        *case("sign", {"t": t, plain: q, ("Fx", "Fy", "Fz", "Mx", "My", "Mz"): -wrench}, wrench),
    )
    yield "LeRobot data set", [lerobot(folder / "lerobot", t, q, wrench)[0]], robot, wrench


def lerobot(folder, t, q, wrench):
    """Write an episode in the layout of LeRobot, with lists of numbers in each row that meta/info.json names."""
    import pyarrow as arrow
    import pyarrow.parquet as parquet

    names = [f"{x}.pos" for x in JOINTS]
    for part in ("meta", "data/chunk-000"):
        (folder / part).mkdir(parents=True)
    features = {
        "observation.state": {"dtype": "float64", "shape": [6], "names": names},
        "observation.wrench": {"dtype": "float64", "shape": [6], "names": None},
    }
    info = {"codebase_version": "v2.1", "fps": RATE, "features": features}
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    path = folder / "data/chunk-000/episode_000000.parquet"
    rows = {"observation.state": q, "observation.wrench": wrench}
    lists = {name: arrow.array(values.tolist(), arrow.list_(arrow.float64())) for name, values in rows.items()}
    parquet.write_table(arrow.table({"timestamp": t, **lists}), path)
    return [path]
