"""A MuJoCo scene corrected from one recording of a "real" scene with withheld changes, and scored on another."""

import json
import sys
import tempfile
import time
from functools import partial
from pathlib import Path

import jax
import numpy as np
from scipy.signal import butter, lfilter

sys.path.append(str(Path(__file__).parents[1]))
import mujoco
from common import keep, rounded

import ftbias_jax as ft
from ftbias_jax.diagnosis.apply import with_causes
from ftbias_jax.diagnosis.report.as_json import to_json
from ftbias_jax.io.cleaning import clean
from ftbias_jax.model.own_effects import catalogue_of_setup
from ftbias_jax.setup.mjcf import load_mjcf, mjcf_tool
from ftbias_jax.simulators.mend_mjcf import mend_mjcf
from ftbias_jax.simulators.replay import against, joint_states, replay
from ftbias_jax.simulators.sample import draw, posterior_of, with_rest
from ftbias_jax.simulators.validate import validate

SCENE = Path(__file__).with_name("scene.xml")
TOML = '[robot]\nmjcf = "scene.xml"\n\n[sensor]\nnoise_std = [0.05, 0.002]\n'
DURATION, RATE, FIRST, EACH = 40.0, 200.0, 6, 3
"""s, Hz, first case and number of cases per kind; earlier cases were used while the method was developed."""
DRAWS, TARE = 60, 1.0
"""Number of simulators per band, 0 = no bands; s at the start over which recording and simulations are tared."""
KINDS = ("tool", "mounting", "cable", "delay and low-pass", "crosstalk", "drag", "flexible tool", "gravity and tool")


def changed(kind, rng, folder):
    """Return the "real" scene, written by MuJoCo, the sensor's effect on its reading, and the true parameters."""
    spec = mujoco.MjSpec.from_file(str(SCENE))
    hand, site = spec.body("hand"), spec.site("ft_site")
    sensor, truth = lambda t, wrench, velocity: wrench, {}
    if kind in ("tool", "gravity and tool"):
        part = hand.add_body(pos=rng.uniform(-0.04, 0.04, 3) + np.array([0, 0, 0.08]))
        part.add_geom(type=mujoco.mjtGeom.mjGEOM_BOX, size=[0.02, 0.02, 0.03], mass=rng.uniform(0.05, 0.2))
    if kind == "mounting":
        turn = rng.normal(size=3)
        truth["mount_rotation"] = {"rotation": turn * np.radians(rng.uniform(1, 4)) / np.linalg.norm(turn)}
        quaternion, turned = np.zeros(4), np.zeros(4)
        angle = np.linalg.norm(truth["mount_rotation"]["rotation"])
        mujoco.mju_axisAngle2Quat(quaternion, truth["mount_rotation"]["rotation"] / angle, angle)
        mujoco.mju_mulQuat(turned, mujoco.MjModel.from_xml_path(str(SCENE)).site("ft_site").quat, quaternion)
        site.alt.type, site.quat = mujoco.mjtOrientation.mjORIENTATION_QUAT, turned
    if kind == "cable":
        stiffness = rng.uniform(5, 20)
        spec.body("link3").add_site(name="a", pos=rng.uniform(-0.1, 0.1, 3) + np.array([0, 0, 0.2]))
        hand.add_site(name="b", pos=rng.uniform(-0.02, 0.02, 3) + np.array([0, 0, 0.05]))
        tendon = spec.add_tendon(stiffness=stiffness, springlength=[0, 0.2])
        tendon.wrap_site("a")
        tendon.wrap_site("b")
        truth["cable"] = {"stiffness": stiffness}
    if kind == "flexible tool":
        frequency, gripper = rng.uniform(6, 12), spec.body("gripper")
        truth["tool_flexibility"] = {"frequency": frequency}
        inertia = 0.4 * (0.03**2 + 0.03**2) / 3 + 0.4 * 0.06**2
        for axis in ([1, 0, 0], [0, 1, 0]):
            stiffness = inertia * (2 * np.pi * frequency) ** 2
            damping = 2 * 0.05 * np.sqrt(stiffness * inertia)
            gripper.add_joint(axis=axis, pos=[0, 0, -0.06], stiffness=[stiffness, 0, 0], damping=[damping, 0, 0])
    if kind == "gravity and tool":
        tilt = rng.normal(size=2) * np.radians(1.5)
        spec.option.gravity = np.array([tilt[0], tilt[1], -1]) * 9.81 / np.linalg.norm([*tilt, 1])
        truth["gravity_tilt"] = {"gravity": np.array(spec.option.gravity)}
    if kind == "delay and low-pass":
        delay, cutoff = rng.uniform(0.01, 0.04), rng.uniform(4, 12)
        b, a = butter(1, cutoff, fs=RATE)

        def sensor(t, wrench, velocity):
            smooth = lfilter(b, a, wrench - wrench[0], axis=0) + wrench[0]
            return np.stack([np.interp(t - delay, t, channel) for channel in smooth.T], 1)
    elif kind == "crosstalk":
        source, target = rng.choice(3, 2, replace=False)
        leak = np.eye(6)
        leak[target, source] = rng.uniform(0.02, 0.06)
        truth["crosstalk"] = {"matrix": leak}

        def sensor(t, wrench, velocity):
            return wrench @ leak.T
    elif kind == "drag":
        drag = rng.uniform(5, 15)

        def sensor(t, wrench, velocity):
            return wrench + np.pad(drag * velocity, ((0, 0), (0, 3)))

    spec.compile()
    (folder / "real.xml").write_text(spec.to_xml())
    scene = load_mjcf(folder / "real.xml", "ft_site")
    if kind in ("tool", "gravity and tool"):
        tool = mjcf_tool(scene)
        truth |= {"tool_mass": {"mass": tool.mass}, "tool_com": {"center_of_mass": tool.center_of_mass}}
    return scene, sensor, truth


def velocity_in_sensor(scene, t, q):
    """Velocity (T, 3) m/s of the sensor's site, in its axes."""
    data, places, axes = mujoco.MjData(scene.model), [], []
    for row in q:
        data.qpos[scene.model.jnt_qposadr[list(scene.joints)]] = row
        mujoco.mj_kinematics(scene.model, data)
        places.append(data.site_xpos[scene.site].copy())
        axes.append(data.site_xmat[scene.site].reshape(3, 3).copy())
    return np.einsum("tji,tj->ti", np.array(axes), np.gradient(np.array(places), t, axis=0))


def recording(setup, scene, sensor, seed):
    """Record a log of the real robot: joints with encoder noise, and a wrench with bias, drift and noise."""
    made = ft.simulate(setup, {}, duration=DURATION, rate=RATE, seed=seed)
    log, truth = made.log, made.truth
    states = np.stack([truth.q, truth.dq, truth.ddq], 2)
    felt = sensor(log.t, replay(scene, log.t, states), velocity_in_sensor(scene, log.t, truth.q))
    return log._replace(wrench=felt + log.wrench - truth.wrench_tool)


def errors_of(causes, truth):
    """(value - truth) / standard error of those parameters that have a known truth and a standard error."""
    found = []
    for cause in causes:
        for name, true in truth.get(cause.effect, {}).items():
            value, stderr, true = (
                np.ravel(x).astype(float) for x in (cause.parameters[name], cause.stderr[name], true)
            )
            found += [(v - x) / s for v, x, s in zip(value, true, stderr, strict=True) if s > 0]
    return found


def draws_of(diagnosis, setup, seed):
    """Sample setups from the posterior of a diagnosis."""
    content = to_json(diagnosis)
    posterior, setup = posterior_of(diagnosis.causes, content, catalogue_of_setup(setup)), with_rest(setup, content)
    rng = np.random.default_rng(seed)
    return [with_causes(setup, draw(posterior, rng), diagnosis.terms) for _ in range(DRAWS)]


@partial(jax.jit, static_argnames="memory")
def read(sensor, t, wrench, dq, key, memory):
    """Reading (T, 6) of a sensor model for an applied wrench (T, 6), with random bias, drift and noise."""
    state = sensor.start(wrench[0], sensor.draw(key), memory=memory)

    def step(state, sample):
        dt, load, speed, key = sample
        return sensor.step(state, load, dt, sensor.draw(key), dq=speed)

    dt = jax.numpy.diff(t, prepend=2 * t[0] - t[1])
    return jax.lax.scan(step, state, (dt, wrench, dq, jax.random.split(key, len(t))))[1]


def readings(drawn, user, log, states, folder):
    """Yield the reading (T, 6) of each sampled simulator for the motion of a log."""
    for i, one in enumerate(drawn):
        (folder / "drawn.xml").write_text(
            mend_mjcf(one, user, str(folder / "drawn.xml")).files[str(folder / "drawn.xml")]
        )
        felt, sensor = replay(load_mjcf(folder / "drawn.xml"), log.t, states), ft.sensor_model(one)
        yield np.asarray(read(sensor, log.t, felt, states[:, :, 1], jax.random.key(i), sensor.memory(1 / RATE)))


def covered(log, simulated):
    """Share of the readings within the 95 % bands of simulated ones, and the bands' mean half width (6,) N, Nm."""
    start = log.t < TARE
    tared = [wrench - np.nanmean(wrench[start], axis=0) for wrench in (log.wrench, *simulated)]
    low, high = np.nanquantile(tared[1:], (0.025, 0.975), axis=0)[:, ~start]
    reading = tared[0][~start]
    there = np.isfinite(reading)
    return ((reading >= low) & (reading <= high))[there].mean(), np.nanmean(high - low, axis=0) / 2


def prepared(kind, number, folder):
    """Write a user's scene and setup; return the setup, the real scene, its sensor and the true parameters."""
    (folder / "scene.xml").write_text(SCENE.read_text())
    (folder / "setup.toml").write_text(TOML)
    rng = np.random.default_rng([KINDS.index(kind), number])
    return ft.load_setup(folder / "setup.toml"), *changed(kind, rng, folder)


def case(kind, number, folder):
    """Correct one scene from one recording, and score it on another one."""
    setup, real, sensor, truth = prepared(kind, number, folder)
    first, second = (recording(setup, real, sensor, 1000 * (1 + KINDS.index(kind)) + 2 * number + i) for i in (0, 1))
    start = time.perf_counter()
    user = load_mjcf(folder / "scene.xml")
    whole = clean(first)
    beside = against(setup, first, whole.t, replay(user, whole.t, joint_states(setup, whole)))
    diagnosis = ft.diagnose(setup, [beside])
    fixed = diagnosis.apply(setup)
    made = mend_mjcf(fixed, user, str(folder / "mended.xml"))
    (folder / "mended.xml").write_text(made.files[str(folder / "mended.xml")])
    mended = load_mjcf(folder / "mended.xml")
    seconds = time.perf_counter() - start
    judged = validate(setup, fixed, [second], (user, mended))
    second = clean(second)
    share = width = None
    if DRAWS:
        drawn = draws_of(diagnosis, setup, number)
        share, width = covered(second, list(readings(drawn, user, second, joint_states(setup, second), folder)))
        width = float(np.mean(width / setup.sensor.noise_std))
    lines = [text.splitlines() for text in (SCENE.read_text(), (folder / "mended.xml").read_text())]
    return {
        "kind": kind,
        "number": number,
        "verdict": diagnosis.verdict,
        "causes": [cause.title for cause in diagnosis.causes],
        "terms": [term.text for term in diagnosis.terms],
        "not_expressed": [one["effect"] for one in made.not_expressed],
        "before_sigmas": judged.before.sigmas,
        "after_sigmas": judged.after.sigmas,
        "shrink": judged.shrink,
        "shrink_stderr": judged.shrink_stderr,
        "covered": share,
        "half_width_sigmas": width,
        "errors_in_stderr": errors_of(diagnosis.causes, truth),
        "lines_changed": len(set(lines[0]) ^ set(lines[1])),
        "seconds": seconds,
    }


def main(kinds):
    """Run the cases of some kinds (all by default), and keep the saved cases of the other kinds."""
    there = json.loads(Path(__file__).with_name("result.json").read_text())["result"]["cases"] if kinds else []
    cases = [one for one in there if one["kind"] not in kinds]
    for kind in kinds or KINDS:
        for number in range(FIRST, FIRST + EACH):
            with tempfile.TemporaryDirectory() as folder:
                cases.append(case(kind, number, Path(folder)))
            print({key: x for key, x in cases[-1].items() if key not in ("terms",)}, flush=True)
    errors = np.abs([x for one in cases for x in one["errors_in_stderr"]])
    shrinks = np.array([one["shrink"] for one in cases])
    summary = {
        "median_shrink": float(np.median(shrinks)),
        "grown": int((shrinks < 0).sum()),
        "parameters": len(errors),
        "inside_three_stderr": float((errors < 3).mean()),
        "covered": float(np.mean([one["covered"] for one in cases if one["covered"] is not None])),
    }
    cases.sort(key=lambda one: (KINDS.index(one["kind"]), one["number"]))
    keep(__file__, {"summary": summary, "cases": [rounded_case(one) for one in cases]})
    print(summary)


def rounded_case(one):
    return {
        key: rounded(x, 3) if key not in ("kind", "verdict", "causes", "terms", "not_expressed") else x
        for key, x in one.items()
    }


if __name__ == "__main__":
    main(sys.argv[1:])
