"""Headers of people, robots and loggers: their meaning, and the log read with a setup drafted from each is the same."""

import json

import made_weights as made
import numpy as np
import pyarrow as arrow
import pyarrow.parquet as parquet
import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log
from ftbias_jax.io.draft.draft import Request, draft
from ftbias_jax.io.draft.table import look
from ftbias_jax.io.info import describe
from ftbias_jax.io.tables.headers import matches
from ftbias_jax.setup import load_setup, parse_setup
from ftbias_jax.setup.recorded import FORCE_UNITS, TORQUE_UNITS
from ftbias_jax.setup.robots import built_in_robot

ROBOT = built_in_robot("ur5e")
T, Q, WRENCH = made.arm_log("ur5e", samples=400)
DQ = np.gradient(Q, T, axis=0)
SIX, XYZ = range(6), "xyz"
IN_BASE = np.concatenate(
    [np.einsum("tij,tj->ti", made.rotations(ROBOT, Q), WRENCH[:, half]) for half in (slice(0, 3), slice(3, 6))], 1
)


def counted(stem, first=0):
    return [f"{stem}{i}" for i in range(first, first + 6)]


def of_joints(form):
    return [form.format(joint) for joint in ROBOT.joint_names]


HEADERS = {
    "manufacturer's, with units in brackets": (
        [
            ("Time [ms]", T * 1e3),
            (counted("A", 1), Q * 180 / np.pi),
            (["Fx [N]", "Fy [N]", "Fz [N]", "Mx [Nm]", "My [Nm]", "Mz [Nm]"], WRENCH),
        ],
        {"time_unit": "ms", "angle_unit": "deg"},
    ),
    "Fx to Tz": ([("t", T), (counted("q"), Q), (["Fx", "Fy", "Fz", "Tx", "Ty", "Tz"], WRENCH)], {}),
    "words, degrees by their names": (
        [
            ("time_s", T),
            ([f"joint_{i}_deg" for i in range(1, 7)], Q * 180 / np.pi),
            ([f"{kind}_{x}" for kind in ("force", "torque") for x in XYZ], WRENCH),
        ],
        {"angle_unit": "deg"},
    ),
    "RTDE": (
        [
            ("timestamp", T),
            (counted("target_q_"), 0 * Q),
            (counted("actual_q_"), Q),
            (counted("actual_qd_"), DQ),
            (counted("actual_TCP_force_"), IN_BASE),
        ],
        {"wrench_axes": "base"},
    ),
    "PlotJuggler, counted": (
        [
            ("__time", 1.7e9 + T),
            ([f"/joint_states/position[{i}]" for i in SIX], Q),
            ([f"/joint_states/effort[{i}]" for i in SIX], 0 * Q),
            ([f"/ft/wrench/{kind}/{x}" for kind in ("force", "torque") for x in XYZ], WRENCH),
        ],
        {},
    ),
    "PlotJuggler, by name": (
        [
            ("__time", 1.7e9 + T),
            (of_joints("/joint_states/{}/position")[::-1], Q[:, ::-1]),
            (of_joints("/joint_states/{}/velocity"), DQ),
            ([f"/ft/wrench/{kind}/{x}" for kind in ("force", "torque") for x in XYZ], WRENCH),
        ],
        {},
    ),
    "libfranka": (
        [
            ("time", T),
            (counted("q_"), Q),
            (counted("q_d_"), 0 * Q),
            (counted("tau_ext_"), 0 * Q),
            (counted("K_F_ext_hat_K_"), WRENCH),
        ],
        {},
    ),
    "pounds": (
        [
            ("t", T),
            (counted("q"), Q),
            ([f"f{x} (lbf)" for x in XYZ], WRENCH[:, :3] / FORCE_UNITS["lbf"]),
            ([f"t{x} (lbf-in)" for x in XYZ], WRENCH[:, 3:] / TORQUE_UNITS["lbf-in"]),
        ],
        {"force_unit": "lbf", "torque_unit": "lbf-in"},
    ),
    "counted from zero": ([("t", T), (counted("joint_"), Q), (counted("ft_"), WRENCH)], {}),
}


def write(path, columns):
    names = [name for some, _ in columns for name in ([some] if isinstance(some, str) else some)]
    table = np.column_stack([values for _, values in columns])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    return path


def drafted(tmp_path, *logs, **more):
    found = draft(Request(logs=[str(log) for log in logs], output=str(tmp_path / "setup.toml"), **more))
    (tmp_path / "setup.toml").write_text(found.text)
    return load_setup(tmp_path / "setup.toml"), found


@pytest.mark.parametrize("kind", HEADERS)
def test_a_draft_from_every_header_reads_the_same_log(tmp_path, kind):
    columns, units = HEADERS[kind]
    log = write(tmp_path / "log.csv", columns)
    setup, _ = drafted(tmp_path, log, robot="ur5e")
    read = read_log(log, setup, raw=True)
    np.testing.assert_allclose(read.t, T, atol=1e-6)
    np.testing.assert_allclose(read.q, Q, atol=1e-12)
    np.testing.assert_allclose(read.wrench, WRENCH, atol=1e-9)
    assert np.isnan(read.dq).all() or np.abs(read.dq - DQ).max() < 1e-12
    assert {key: getattr(setup.log, key) for key in units} == units
    assert abs(setup.tool.mass - made.MASS) < 0.05
    info = describe(log)
    assert "6 joints and a wrench: ftbias setup log.csv --robot NAME" in info.verdict or not setup.log.columns


@pytest.mark.parametrize("kind", ["RTDE", "words, degrees by their names", "pounds"])
def test_readers_use_the_names_and_refuse_a_setup_that_contradicts_them(tmp_path, kind):
    columns, units = HEADERS[kind]
    log = write(tmp_path / "log.csv", columns)
    stated = {"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}}
    read = read_log(log, parse_setup({**stated, "log": units}), raw=True)
    np.testing.assert_allclose(read.wrench, WRENCH, atol=1e-9)
    key = next(iter(units))
    with pytest.raises(LogError, match="by its name, but") as error:
        read_log(log, parse_setup(stated))
    assert f'state [log] {key} = "{units[key]}"' in error.value.remedy


@pytest.mark.parametrize(
    ("quantity", "header"),
    [
        ("position", [f"command/joint_{i}" for i in SIX]),
        ("position", [*(f"q{i} [rad]" for i in range(5)), "q5 [deg]"]),
        ("position", ["q0", "q1", "q3"]),
        ("wrench", ["fx", "fy", "fz", "tx", "ty"]),
        ("wrench", ["a/fx", "a/fy", "a/fz", "b/tx", "b/ty", "b/tz"]),
        ("wrench", [f"data_{i}" for i in SIX]),
        ("place", ["force_x", "force_y", "force_z"]),
        ("time", ["header/stamp"]),
    ],
)
def test_what_is_commanded_incomplete_or_contradictory_is_nothing(quantity, header):
    assert matches(quantity, header) == []


def test_two_sensors_are_not_chosen_between_without_a_word(tmp_path):
    both = [("t", T), (counted("q"), Q), (counted("left/ft_"), WRENCH), (counted("right/ft_"), 2 * WRENCH)]
    log = write(tmp_path / "log.csv", both)
    with pytest.raises(LogError, match="several columns may be the wrench: left/ft_0"):
        read_log(log, parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}}))
    setup, found = drafted(tmp_path, log, robot="ur5e")
    assert setup.log.columns["wrench"] == tuple(counted("left/ft_"))
    assert "also there: right/ft_0 ..." in found.text


def test_a_dead_axis_does_not_hide_the_tool(tmp_path):
    dead = WRENCH.copy()
    dead[:, 5] = 0.25
    setup, _ = drafted(
        tmp_path, write(tmp_path / "log.csv", [("t", T), (counted("q"), Q), (counted("ft_"), dead)]), robot="ur5e"
    )
    assert abs(setup.tool.mass - made.MASS) < 0.05
    np.testing.assert_allclose(setup.tool.center_of_mass, made.CENTER, atol=6e-3)


def test_without_any_torque_the_mass_is_weighed_all_the_same(tmp_path):
    dead = WRENCH.copy()
    dead[:, 3:] = 0.0
    log = write(tmp_path / "log.csv", [("t", T), (counted("q"), Q), (counted("ft_"), dead)])
    setup, _ = drafted(tmp_path, log, robot="ur5e")
    assert abs(setup.tool.mass - made.MASS) < 0.05
    assert (setup.tool.center_of_mass_std > 0.05).all()


def test_joints_with_names_of_their_own_are_taken_in_their_order_and_that_is_said(tmp_path):
    names = ["Base_position", "Shoulder_position", "Elbow_position", "W1_position", "W2_position", "W3_position"]
    log = write(tmp_path / "log.csv", [("t", T), (names, Q), (counted("ft_"), WRENCH)])
    setup, found = drafted(tmp_path, log, robot="ur5e")
    assert setup.log.columns["position"] == tuple(names)
    assert "in the order of the header: check it" in found.text


def test_where_nothing_fits_the_draft_lists_the_columns_to_choose_from(tmp_path, capsys):
    log = write(tmp_path / "log.csv", [("u", T), (counted("alpha"), Q), (counted("beta"), WRENCH)])
    output = str(tmp_path / "setup.toml")
    assert main(["setup", str(log), "--robot", "ur5e", "-o", output]) == 0
    assert "which columns are time and position and wrench does not show by their names" in capsys.readouterr().out
    text = (tmp_path / "setup.toml").read_text()
    assert "# wrench = ...  # columns of force, then torque; choose from u, alpha0, " in text
    filled = text.replace("# time = ...", 'time = "u"').replace("# position = ...", f"position = {counted('alpha')}")
    (tmp_path / "setup.toml").write_text(filled.replace("# wrench = ...", f"wrench = {counted('beta')}"))
    np.testing.assert_allclose(read_log(log, load_setup(output), raw=True).wrench, WRENCH)


@pytest.mark.parametrize("fixed", [True, False])
def test_a_lerobot_data_set(tmp_path, fixed):
    """Parquet with a list in every row, whose entries are named by meta/info.json."""
    state = np.column_stack([Q, np.zeros(len(T))])
    names = [*of_joints("{}.pos"), "gripper.pos"]
    features = {
        "observation.state": {"dtype": "float32", "shape": [7], "names": {"motors": names}},
        "observation.wrench": {"dtype": "float32", "shape": [6], "names": None},
        "action": {"dtype": "float32", "shape": [7], "names": names},
    }
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text(json.dumps({"fps": 50, "features": features}))
    folder = tmp_path / "data" / "chunk-000"
    folder.mkdir(parents=True)

    def lists(values):
        width = values.shape[1]
        kind = arrow.list_(arrow.float64(), width) if fixed else arrow.list_(arrow.float64())
        return arrow.array(values.tolist(), kind)

    table = {"observation.state": lists(state), "action": lists(0 * state), "observation.wrench": lists(WRENCH)}
    rows = {"timestamp": T, "frame_index": np.arange(len(T)), "episode_index": np.zeros(len(T), int)}
    log = folder / "episode_000000.parquet"
    parquet.write_table(arrow.table(table | rows), log)
    setup, _ = drafted(tmp_path, log, robot="ur5e")
    assert setup.log.columns["position"] == tuple(f"observation.state/{name}" for name in names[:6])
    read = read_log(log, setup, raw=True)
    np.testing.assert_allclose(read.q, Q)
    np.testing.assert_allclose(read.wrench, WRENCH)
    assert abs(setup.tool.mass - made.MASS) < 0.05


def test_lists_that_are_shorter_than_said_are_an_error_of_ours(tmp_path):
    lists = arrow.array([[1.0] * 6, [1.0] * 5], arrow.list_(arrow.float64()))
    log = tmp_path / "log.parquet"
    parquet.write_table(arrow.table({"t": [0.0, 0.1], "ft": lists, **{f"q{i}": [0.0, 0.1] for i in SIX}}), log)
    (tmp_path / "meta").mkdir()
    (tmp_path / "meta" / "info.json").write_text('{"features": {"ft": {"shape": [6]}}}')
    with pytest.raises(LogError, match="is damaged"):
        read_log(log, parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}}))


def test_lists_of_no_stated_length_have_that_of_the_first(tmp_path):
    """Cells that are lists, as pandas writes them: some are missing, and those of pixels are not read."""
    q = [None, *Q.tolist()[1:]]
    columns = {"time": T, "q": q, "ft": WRENCH.tolist(), "picture": [[i % 256] * (1 + i % 3) for i in range(len(T))]}
    log = tmp_path / "log.parquet"
    parquet.write_table(arrow.table(columns), log)
    assert "picture" in look(str(log)).header
    setup, _ = drafted(tmp_path, log, robot="ur5e")
    read = read_log(log, setup, raw=True)
    np.testing.assert_allclose(read.q[1:], Q[1:])
    assert np.isnan(read.q[0]).all()
    np.testing.assert_allclose(read.wrench, WRENCH)


def save_h5(path, arrays):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as root:
        for name, values in arrays.items():
            root[name] = values


@pytest.mark.parametrize(("suffix", "save"), [(".npz", lambda path, x: np.savez(path, **x)), (".h5", save_h5)])
@pytest.mark.parametrize(
    "names",
    [
        ("timestamps", "joint_positions", "ft"),
        ("t", "qpos", "force_torque"),
        ("timestamp", "robot/joint_positions", "robot/wrench"),
    ],
)
def test_arrays_of_other_names_are_columns(tmp_path, suffix, save, names):
    if suffix == ".npz":
        names = [name.rpartition("/")[2] for name in names]
    log = tmp_path / f"log{suffix}"
    pictures = np.zeros((len(T), 4, 3), np.uint8)
    save(log, dict(zip((*names, "picture", "action"), (T, Q, WRENCH, pictures, 0 * Q), strict=True)))
    setup, _ = drafted(tmp_path, log, robot="ur5e")
    assert setup.log.columns["wrench"] == tuple(f"{names[2]}/{i}" for i in range(6))
    read = read_log(log, setup, raw=True)
    np.testing.assert_allclose(read.q, Q)
    np.testing.assert_allclose(read.wrench, WRENCH)
    assert abs(setup.tool.mass - made.MASS) < 0.05


def test_forces_and_torques_in_arrays_of_their_own(tmp_path):
    log = tmp_path / "log.npz"
    np.savez(log, t=T, q=Q, force=WRENCH[:, :3], torque=WRENCH[:, 3:])
    read = read_log(log, drafted(tmp_path, log, robot="ur5e")[0], raw=True)
    np.testing.assert_allclose(read.wrench, WRENCH)
    assert look(str(log)).joints == 6


def test_arrays_that_are_columns_have_one_length(tmp_path):
    np.savez(tmp_path / "log.npz", time=T, joint_positions=Q, ft=WRENCH[1:])
    with pytest.raises(LogError, match=f"ft: has {len(T) - 1} samples, joint_positions {len(T)}|time {len(T)}"):
        read_log(tmp_path / "log.npz", parse_setup({"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}}))


def test_links_on_the_way_to_a_dataset_are_not_followed(tmp_path):
    h5py = pytest.importorskip("h5py")
    save_h5(tmp_path / "other.h5", {"arm/q": Q})
    with h5py.File(tmp_path / "log.h5", "w") as root:
        root["arm"] = h5py.ExternalLink("other.h5", "arm")
        root["t"], root["wrench"] = T, WRENCH
    columns = {"position": [f"arm/q{i}" for i in range(6)]}
    setup = {"robot": {"model": "ur5e"}, "sensor": {"noise_std": 0.1}, "log": {"columns": columns}}
    with pytest.raises(LogError, match="arm/q0: is a link"):
        read_log(tmp_path / "log.h5", parse_setup(setup))
    assert "arm/q/0" not in look(str(tmp_path / "log.h5")).header


def test_a_table_without_names_says_how_to_name_them(tmp_path):
    pose = made.rotations(ROBOT, Q).reshape(-1, 9)
    rows = "\n".join(",".join(f"{x:.9g}" for x in row) for row in np.column_stack([T, WRENCH, pose]))
    log = tmp_path / "log.txt"
    log.write_text(rows)
    assert "write the names of the columns in a first line" in describe(log).verdict
    with pytest.raises(LogError, match="its columns have no names") as caught:
        drafted(tmp_path, log)
    assert "# t,fx,fy" in caught.value.remedy
    log.write_text("# t,fx,fy,fz,tx,ty,tz,r11,r12,r13,r21,r22,r23,r31,r32,r33\n" + rows)
    np.testing.assert_allclose(read_log(log, drafted(tmp_path, log)[0], raw=True).wrench, WRENCH)


@pytest.mark.parametrize("delimiter", [",", ";", "\t"])
@pytest.mark.parametrize("bracket", ["{}", "[{}]"])
def test_units_in_the_second_line_are_those_of_the_columns(tmp_path, delimiter, bracket):
    names = ["time", "state", *(f"q{i}" for i in SIX), "fx", "fy", "fz", "tx", "ty", "tz"]
    units = ["ms", "-", *["deg"] * 6, *["N"] * 3, *["Nmm"] * 3]
    rows = np.column_stack([T * 1e3, 0 * T, np.degrees(Q), WRENCH * ([1] * 3 + [1000] * 3)])
    numbers = [[f"{x:.12g}" for x in row] for row in rows]
    log = tmp_path / "log.csv"
    log.write_text("\n".join(map(delimiter.join, [names, [bracket.format(unit) for unit in units], *numbers])))
    setup, _ = drafted(tmp_path, log, robot="ur5e")
    assert (setup.log.time_unit, setup.log.angle_unit, setup.log.torque_unit) == ("ms", "deg", "Nmm")
    read = read_log(log, setup, raw=True)
    np.testing.assert_allclose(read.q, Q)
    np.testing.assert_allclose(read.wrench, WRENCH)


def test_words_in_the_second_line_are_no_units(tmp_path):
    (tmp_path / "log.csv").write_text("t,q0,q1\nnull,null,null\n0,1,2\n")
    with pytest.raises(LogError, match="line 2, column t: 'null' is not a number"):
        look(str(tmp_path / "log.csv"))


def test_time_of_other_names_is_taken_where_there_is_no_time():
    assert [match.names for match in matches("time", ["elapsed_time [ms]", "q0"])] == [("elapsed_time [ms]",)]
    assert matches("time", ["elapsed_time [ms]"])[0].facts == {"log.time_unit": "ms"}
    assert matches("time", ["Zeit [s]", "q0"])[0].facts == {"log.time_unit": "s"}
    assert [match.names for match in matches("time", ["elapsed_time", "Timestamp"])] == [("Timestamp",)]


def test_german_names_are_known():
    header = ["Zeit [s]", *(f"Achse {i} [°]" for i in range(1, 7)), *(f"Kraft {x} [N]" for x in "XYZ")]
    for torque in ("Moment", "Drehmoment"):
        named = [*header, *(f"{torque} {x} [Nm]" for x in "XYZ")]
        assert matches("wrench", named)[0].names == tuple(named[-6:])
    assert matches("position", header)[0].names == tuple(header[1:7])
    assert matches("position", header)[0].facts == {"log.angle_unit": "deg"}


def test_other_names_of_joints_are_taken_where_there_are_no_usual_ones():
    motors = [f"state.theta[{i}]" for i in SIX]  # of libfranka, beside q
    assert [match.names[0] for match in matches("position", [*motors, *(f"state.q[{i}]" for i in SIX)])] == [
        "state.q[0]"
    ]
    assert [match.names[0] for match in matches("position", motors)] == ["state.theta[0]"]
    assert matches("velocity", [f"qdot{i} [deg/s]" for i in SIX])[0].facts == {"log.angle_unit": "deg"}


def test_what_is_measured_of_a_joint_is_no_position():
    assert [match.names[0] for match in matches("position", [f"J{i}" for i in range(1, 7)])] == ["J1"]
    assert not matches("position", [f"torque_J{i}" for i in range(1, 7)])


@pytest.mark.parametrize("form", ["joint_{}/position", "/joint_states/actuator{}/position", "position/axis_{}"])
def test_numbered_joints_may_have_other_names_than_in_the_setup(form):
    header = ["t", *(form.format(i) for i in range(1, 7)), *(f"joint_{i}/torque" for i in range(1, 7))]
    (match,) = matches("position", header, ROBOT.joint_names)
    assert match.names == tuple(header[1:7])
    assert not matches("position", header, ROBOT.joint_names[:5])


@pytest.mark.parametrize(("rail", "unit"), [("rail [mm]", "mm"), ("rail [m]", "m"), ("rail_mm", "mm")])
def test_a_rail_and_joints_have_units_of_their_own(rail, unit):
    header = [rail, *(f"joint{i} [deg]" for i in range(1, 7))]
    (match,) = matches("position", header, ["rail", *(f"joint{i}" for i in range(1, 7))])
    assert match.names == tuple(header)
    assert match.facts == {"log.length_unit": unit, "log.angle_unit": "deg"}


@pytest.mark.parametrize("torque", ["(in-lb)", "[lbf·in]", "[in-lbs]"])
def test_units_of_pounds_as_people_write_them(torque):
    header = [*(f"F{x} [lbs]" for x in XYZ), *(f"T{x} {torque}" for x in XYZ)]
    assert matches("wrench", header)[0].facts == {"log.force_unit": "lbf", "log.torque_unit": "lbf-in"}
