"""``ftbias setup``: from known facts to a file that the other commands accept."""

import json

import made_scenes
import made_weights as made
import numpy as np
import pytest
import recordings
from recordings import SECOND, START, Joints, Pose, Text, Wrench
from scipy.spatial.transform import Rotation

from ftbias_jax.cli.main import main
from ftbias_jax.setup import load_setup
from ftbias_jax.setup.robots import BUILT_IN, built_in_robot

URDF = """<robot name="two"><link name="base"/><link name="upper"/><link name="tool0"/><link name="ft"/>
<joint name="pan" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/></joint>
<joint name="lift" type="revolute"><parent link="upper"/><child link="tool0"/><origin xyz="0 0 0.3"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" velocity="2"/></joint>
<joint name="mount" type="fixed"><parent link="tool0"/><child link="ft"/><origin xyz="0 0 0.05" rpy="0 0 0.5"/></joint>
</robot>"""


def published(q, names, wrench, frame="ft", prefix=""):
    stamps = START + np.arange(len(q)) * SECOND // 50
    joints = [Joints(int(t), tuple(prefix + n for n in names), tuple(x)) for t, x in zip(stamps, q, strict=True)]
    wrenches = [Wrench(int(t) + 1000, tuple(x), frame=frame) for t, x in zip(stamps, wrench, strict=True)]
    return sorted([*joints, *wrenches], key=lambda message: message.stamp)


def run(*words):
    return main(["setup", *map(str, words)])


def test_every_built_in_robot_gives_a_setup_to_finish(tmp_path):
    for name in BUILT_IN:
        assert run("--robot", name, "-o", tmp_path / f"{name}.toml") == 0
        setup = load_setup(tmp_path / f"{name}.toml")
        assert setup.robot.model == name
        assert setup.tool.unknown == ("mass", "center_of_mass")
        assert (tmp_path / f"{name}.toml").read_text().count("measure me") >= 5


def test_without_an_output_the_setup_is_printed(capsys):
    assert run("--robot", "ur5e", "--mass", "1.2", "--center-of-mass", "0", "0", "0.05") == 0
    printed = capsys.readouterr()
    assert "mass = 1.2  # kg; as stated" in printed.out
    assert "not known" not in printed.err


def test_the_schema_and_the_robots_are_printed(capsys):
    assert run("--schema") == 0
    assert json.loads(capsys.readouterr().out)["properties"]["tool"]["properties"]["mass"]["type"] == "number"
    assert run("--list") == 0
    listed = capsys.readouterr().out
    assert all(f"\n{name} " in f"\n{listed}" for name in BUILT_IN)


def test_a_recording_tells_joints_mounting_noise_and_tool(tmp_path, capsys):
    _, q, wrench = made.arm_log("ur5e", sign=-1.0)
    names = built_in_robot("ur5e").joint_names
    static = [Pose(START, ("tool0", "ft"), (0, 0, 0.02, 0, 0, 0, 1), topic="/tf_static")]
    log = recordings.write(tmp_path, "mcap", [*static, *published(q, names, wrench, prefix="left_")])
    assert run(log, "--robot", "ur5e", "-o", tmp_path / "setup.toml") == 0
    assert "weighed by the log" in capsys.readouterr().out
    setup = load_setup(tmp_path / "setup.toml")
    assert setup.robot.joint_names == tuple(f"left_{name}" for name in names)
    np.testing.assert_array_equal(setup.sensor.translation, [0, 0, 0.02])
    np.testing.assert_allclose(setup.sensor.noise_std, [0.05] * 3 + [0.002] * 3, rtol=0.4)
    assert setup.sensor.reports == "wrench_on_sensor"
    assert abs(setup.tool.mass - made.MASS) < 0.05
    assert main(["info", str(log), "--setup", str(tmp_path / "setup.toml")]) == 0
    assert "can be filtered" in capsys.readouterr().out


def test_the_description_in_a_recording_is_written_beside_the_setup(tmp_path, capsys):
    rng = np.random.default_rng(0)
    q = np.cumsum(rng.normal(size=(200, 2)) * 0.05, 0)
    messages = published(q, ("pan", "lift"), rng.normal(size=(200, 6)))
    log = recordings.write(tmp_path, "sqlite", [Text(START, URDF), *messages])
    assert run(log, "-o", tmp_path / "cell.toml") == 0
    assert f"wrote {tmp_path / 'cell.urdf'}, {tmp_path / 'cell.toml'}" in capsys.readouterr().out
    assert (tmp_path / "cell.urdf").read_text() == URDF
    setup = load_setup(tmp_path / "cell.toml")
    assert setup.robot.joint_names == ("pan", "lift")
    np.testing.assert_array_equal(setup.robot.position_limits[1], [-1, 1])
    np.testing.assert_allclose(setup.sensor.translation, [0, 0, 0.05])
    np.testing.assert_allclose(setup.sensor.rotation[0, 1], -np.sin(0.5))


def test_a_urdf_gives_arm_flange_and_mounting(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF)
    assert run("--urdf", tmp_path / "arm.urdf", "--base", "base", "-o", tmp_path / "setup.toml") == 0
    text = (tmp_path / "setup.toml").read_text()
    assert 'urdf = "arm.urdf"' in text
    assert 'tip_link = "tool0"' in text
    assert load_setup(tmp_path / "setup.toml").robot.joint_names == ("pan", "lift")


def test_an_mjcf_gives_arm_site_and_tool(tmp_path, capsys):
    scene, _ = made_scenes.write(tmp_path)
    assert run("--mjcf", scene, "-o", tmp_path / "drafted.toml") == 0
    text = (tmp_path / "drafted.toml").read_text()
    assert 'mjcf = "scene.xml"' in text
    assert 'site = "ft_site"' in text
    assert "# mass = ...  # kg" not in text
    assert "of scene.xml: 0.5" in text
    setup = load_setup(tmp_path / "drafted.toml")
    np.testing.assert_array_equal(setup.tool.inertia, load_setup(tmp_path / "setup.toml").tool.inertia)
    assert run("--mjcf", scene, "--site", "x", "-o", tmp_path / "other.toml") == 1
    assert "there is no site 'x'" in capsys.readouterr().err


def test_joints_in_a_recording_are_found_by_the_end_of_their_names(tmp_path):
    scene, _ = made_scenes.write(tmp_path)
    rng = np.random.default_rng(0)
    names = tuple(f"fr3_joint{i}" for i in range(1, 8))
    messages = published(np.cumsum(rng.normal(size=(200, 7)) * 0.05, 0), names, rng.normal(size=(200, 6)))
    log = recordings.write(tmp_path, "sqlite", messages)
    assert run(log, "--mjcf", scene, "-o", tmp_path / "drafted.toml") == 0
    assert load_setup(tmp_path / "drafted.toml").robot.joint_names == names


def test_a_table_with_joints_is_weighed_too(tmp_path, capsys):
    t, q, wrench = made.arm_log("ur5e")
    np.savez(tmp_path / "log.npz", t=t, q=q, wrench=wrench)
    assert run(tmp_path / "log.npz", "--robot", "ur5e", "-o", tmp_path / "setup.toml") == 0
    assert abs(load_setup(tmp_path / "setup.toml").tool.mass - made.MASS) < 0.05


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ((), "name a built-in robot, or give --urdf FILE, --mjcf FILE, --dh FILE or a LOG"),
        (("--robot", "UR5"), "there is no built-in robot 'UR5' (did you mean 'ur5'?)"),
        (("--robot", "ur5e", "--urdf", "arm.urdf"), "named twice"),
        (("--robot", "ur5e", "-o", "setup.json"), "end the name in .toml"),
    ],
)
def test_mistakes_end_in_one_line(capsys, words, message):
    assert run(*words) == 2
    printed = capsys.readouterr()
    assert printed.err.count("\n") == 1
    assert message in printed.err


def test_joints_that_several_robots_have_ask_for_a_name(tmp_path, capsys):
    _, q, wrench = made.arm_log("ur5e", samples=60)
    log = recordings.write(tmp_path, "ros1", published(q, built_in_robot("ur5e").joint_names, wrench))
    assert run(log, "-o", tmp_path / "setup.toml") == 2
    assert "the joints are those of ur3e, ur5e, ur10e, ur16e, ur20" in capsys.readouterr().err
    assert run(log, "--robot", "panda_link8", "-o", tmp_path / "setup.toml") == 2
    assert "the joints of panda_link8 are panda_joint1" in capsys.readouterr().err
    assert not (tmp_path / "setup.toml").exists()


def table(tmp_path, t, q, wrench):
    """A log as a table in a format of its own."""
    header = ",".join(["t", *(f"q{k}" for k in range(q.shape[1])), "Fx", "Fy", "Fz", "Mx", "My", "Mz"])
    np.savetxt(tmp_path / "log.csv", np.hstack([t[:, None], q, wrench]), delimiter=",", header=header, comments="")
    return tmp_path / "log.csv", tmp_path / "setup.toml"


@pytest.mark.slow
def test_a_payload_that_the_controller_subtracts_needs_no_mass(tmp_path, capsys):
    """The workflow from the log to a corrected wrench and a diagnosis needs no tool."""
    t, q, wrench = made.arm_log(samples=1500)
    weight = made.readings(made.rotations(built_in_robot("ur5e"), q), noise=0.0) + made.BIAS
    log, setup = table(tmp_path, t, q, wrench - weight)
    assert run(log, "--robot", "ur5e", "-o", setup) == 0
    assert "the controller subtracts the payload" in capsys.readouterr().out
    assert load_setup(setup).sensor.compensated == "tool"
    assert main(["check", str(log), "--setup", str(setup)]) == 0
    result = tmp_path / "result.npz"
    assert main(["filter", str(log), "--setup", str(setup), "-o", str(result)]) == 0
    np.testing.assert_allclose(np.load(result)["bias"][-1], made.BIAS, atol=0.1)
    assert main(["identify", str(log), "--setup", str(setup), "-o", str(tmp_path / "found.toml")]) == 2
    assert not (tmp_path / "found.toml").exists()
    assert main(["diagnose", str(log), "--setup", str(setup)]) == 0
    assert "nan" not in capsys.readouterr().out
    setup.write_text(setup.read_text().replace('compensated = "tool"', 'compensated = "weight"'))
    setup.write_text(
        setup.read_text().replace("# mass = ", "mass = ").replace("# center_of_mass = ", "center_of_mass = ")
    )
    assert main(["diagnose", str(log), "--setup", str(setup)]) == 2
    assert 'or state "tool"' in capsys.readouterr().err


@pytest.mark.parametrize("half_way", [False, True])
def test_a_sensor_that_was_set_to_zero_is_drafted_so(tmp_path, half_way):
    """The sensor was set to zero with the tool on, at the start or during the recording."""
    t, q, wrench = made.arm_log(samples=3000)
    if half_way:
        q[1400:1600] = q[1400]  # at rest
        wrench = made.readings(made.rotations(built_in_robot("ur5e"), q))
        wrench[1500:] -= wrench[1490:1500].mean(0)
    else:
        q[:50] = q[50]
        wrench = made.readings(made.rotations(built_in_robot("ur5e"), q))
        wrench -= wrench[:50].mean(0)
    log, setup = table(tmp_path, t, q, wrench)
    assert run(log, "--robot", "ur5e", "-o", setup) == 0
    found = load_setup(setup)
    assert found.sensor.rezeroed != half_way
    np.testing.assert_allclose(found.sensor.rezeroed_at, [t[1500]] * half_way, atol=0.03)
    np.testing.assert_allclose(found.tool.mass, made.MASS, rtol=0.05)
    assert main(["check", str(log), "--setup", str(setup)]) == 0


def test_a_log_of_poses_needs_no_robot_and_hears_nothing_of_joints(tmp_path, capsys):
    t, q, wrench = made.arm_log(samples=1500)
    turned = Rotation.from_matrix(made.rotations(built_in_robot("ur5e"), q)).as_quat()
    np.savez(tmp_path / "log.npz", t=t, orientation=turned, wrench=wrench)
    log, setup = tmp_path / "log.npz", tmp_path / "setup.toml"
    assert run(log, "--robot", "ur5e", "-o", setup) == 0
    told = capsys.readouterr().out
    assert told.startswith("--robot is not needed: the log has the sensor's pose")
    assert told.endswith(f"next: ftbias info {log} --setup {setup}\n")
    assert main(["info", str(log), "--setup", str(setup)]) == 0
    assert capsys.readouterr().out.endswith(f"next: ftbias identify {log} --setup {setup} -o identified.toml\n")
    assert main(["filter", str(log), "--setup", str(setup), "-o", str(tmp_path / "result.npz")]) == 0
    assert "joint" not in capsys.readouterr().out
