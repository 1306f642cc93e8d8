"""Give the wrist sensor of a Gymnasium environment the errors of a recorded one, and check it by a contact detector.

The "robot" is the same environment with two effects that the setup lacks: a heavier tool, and noise that grows with
motion. The detector compares the force with the tool's nominal weight. Nothing is touched, so all alarms are false.
"""

import tempfile
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

import ftbias_jax as ft
from ftbias_jax.setup.mjcf import load_mjcf
from ftbias_jax.simulators.mend_mjcf import mend_mjcf
from ftbias_jax.simulators.replay import against, joint_states, replay

try:
    import gymnasium
except ImportError:
    raise SystemExit("this example needs Gymnasium: pip install gymnasium") from None

RATE, HOME = 125, np.array([0.0, -0.4, 0.0, -1.9, 0.0, 1.6, 0.5])
THRESHOLD = 1.3  # N


# --8<-- [start:environment]
class Wrist(gymnasium.Env):
    """Arm whose joints follow target positions; it observes the joints and the reading of the wrist sensor."""

    def __init__(self, scene: str, sensor: ft.SensorModel):
        self.model = mujoco.MjModel.from_xml_path(str(scene))
        self.data, self.sensor = mujoco.MjData(self.model), sensor
        self.steps, self.dt = round(1 / RATE / self.model.opt.timestep), 1 / RATE
        n = self.model.nu
        self.action_space = gymnasium.spaces.Box(-np.pi, np.pi, (n,), np.float64)  # rad, joint targets
        joints = gymnasium.spaces.Box(-np.inf, np.inf, (n,), np.float64)
        wrench = gymnasium.spaces.Box(-np.inf, np.inf, (6,), np.float64)
        self.observation_space = gymnasium.spaces.Dict({"q": joints, "dq": joints, "wrench": wrench})

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        mujoco.mj_resetData(self.model, self.data)
        self.data.qpos[:] = self.data.ctrl[:] = HOME
        mujoco.mj_step(self.model, self.data, 1000)  # the arm sags under gravity
        self.state = self.sensor.start(
            self.felt(), self.sensor.draw(self.np_random), memory=self.sensor.memory(self.dt)
        )
        return self.step(HOME)[0], {}

    def step(self, action):
        for target in np.linspace(self.data.ctrl, action, self.steps + 1)[1:]:  # a jump would shake the tool
            q, dq = self.data.qpos.copy(), self.data.qvel.copy()  # MuJoCo's sensors refer to the state before the step
            self.data.ctrl[:] = target
            mujoco.mj_step(self.model, self.data)
        draws = self.sensor.draw(self.np_random)
        self.state, wrench = self.sensor.step(self.state, self.felt(), self.dt, draws, dq=dq)
        return {"q": q, "dq": dq, "wrench": wrench}, 0.0, False, False, {}  # put your reward and termination here

    def felt(self):
        """(6,) N, Nm: reading of an ideal sensor."""
        return np.concatenate([self.data.sensor("force").data, self.data.sensor("torque").data])


# --8<-- [end:environment]


def recording(env, setup, motion, seed, duration=20.0):
    """Record a log of an episode in which the joints oscillate."""
    random, seen = np.random.default_rng(motion), [env.reset(seed=seed)[0]]
    size, speed, phase = random.uniform([[[0.1]], [[0.3]], [[0]]], [[[0.35]], [[1.5]], [[6.3]]], (3, 2, 7))
    t = np.arange(0, duration, env.dt)
    for now in t[1:]:
        wave = size * (np.sin(speed * now + phase) - np.sin(phase))
        seen.append(env.step(HOME + (1 - np.exp(-now)) * wave.sum(0))[0])
    return ft.Log.from_arrays(setup, t, *(np.array([one[key] for one in seen]) for key in ("q", "wrench", "dq")))


def alarms(model, setup, log):
    """Seconds per minute in which the force, tared at the start, deviates from the nominal weight by over THRESHOLD."""
    data, weight = mujoco.MjData(model), []
    for q in log.q:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        weight.append(-setup.tool.mass * model.opt.gravity @ data.site("ft_site").xmat.reshape(3, 3))
    off = log.wrench[:, :3] - weight
    away = np.linalg.norm(off - off[: RATE // 2].mean(0), axis=1) > THRESHOLD
    return 60 * away[: len(away) // RATE * RATE].reshape(-1, RATE).any(1).mean()


def mean(values):
    """Return the mean and its standard error."""
    return np.mean(values), np.std(values, ddof=1) / np.sqrt(len(values))


if __name__ == "__main__":
    folder, scene = Path(tempfile.mkdtemp()), Path(__file__).with_name("scene.xml")
    setup = ft.parse_setup({"robot": {"mjcf": str(scene)}, "sensor": {"noise_std": [0.1, 0.004]}})
    user = load_mjcf(scene)

    def environment(name, fixed):
        """Environment of the scene with the robot, tool and sensor of a setup."""
        path = str(folder / name)
        Path(path).write_text(mend_mjcf(fixed, user, path).files[path])
        return Wrist(path, ft.sensor_model(fixed))

    # The robot with the effects that the setup lacks, and one recording of it.
    withheld = {"tool_mass": {"mass": 0.78}, "vibration": {"variance": [0.1] * 3 + [1e-4] * 3}}
    robot = environment("real.xml", replace(setup, effects=withheld))
    log = recording(robot, setup, motion=0, seed=0, duration=60.0)
    states = joint_states(setup, log)
    diagnosis = ft.diagnose(setup, [against(setup, log, log.t, replay(user, log.t, states), states)])
    print(diagnosis)

    # False alarms in other motions, on the robot and in both simulators.
    worlds = {
        "recorded": robot,
        "simulator as it was": environment("scene.xml", setup),
        "simulator mended": environment("mended.xml", diagnosis.apply(setup)),
    }
    rates = {
        name: np.array([alarms(user.model, setup, recording(env, setup, k, seed=100 * i + k)) for k in range(1, 25)])
        for i, (name, env) in enumerate(worlds.items())
    }
    for name, each in rates.items():
        print("{}: {:.1f} +- {:.1f} false alarms per minute".format(name, *mean(each)))
    recorded, before, mended = rates.values()
    (gap, error), (left, error_left) = mean(recorded - before), mean(recorded - mended)
    print(f"missed before {gap:.1f} +- {error:.1f}, by the mended one {left:.1f} +- {error_left:.1f}")
    assert gap > 4 * error
    assert abs(left) < 2 * error_left < gap / 2
