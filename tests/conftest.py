import os
from importlib.metadata import version

# Before NumPy is imported: workers whose BLAS threads wait for one another take twice as long.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Most of a test's time is compilation by XLA. A version that does not know a flag would end the process.
if version("jax").startswith("0.10."):
    os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0 --xla_cpu_use_fusion_emitters=false")

import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import NamedTuple

import hypothesis
import jax
import numpy as np
import pytest
import small_archive
from scipy.linalg import block_diag

from ftbias_jax.model.kinematics.screws import Arm, make_arm
from ftbias_jax.model.params import BiasNoise, JointNoise, Params
from ftbias_jax.runtime.kept_programs import compiled_for_few_calls
from ftbias_jax.setup import Setup, parse_setup
from ftbias_jax.setup.robots import built_in_robot, prismatic_screw, revolute_screw
from ftbias_jax.setup.rotations import rotation_from_rpy
from ftbias_jax.types import Array, Sample

pytest_plugins = ["made_diagnoses", "labelled_sets"]

# The tests run in float64 and forbid silent broadcasting; the package itself sets no flag (test_layers.py).
jax.config.update("jax_enable_x64", True)
jax.config.update("jax_numpy_rank_promotion", "raise")

PROGRAMS = "FTBIAS_TEST_PROGRAMS"
"""Name the folder of compiled programs, shared by workers, and by several runs if it is set beforehand."""
LEAST_COMPILE_SECONDS = 0.3


def pytest_configure(config):
    if not hasattr(config, "workerinput") and PROGRAMS not in os.environ:
        config.own_programs = os.environ[PROGRAMS] = tempfile.mkdtemp(prefix="ftbias-tests-")
    jax.config.update("jax_compilation_cache_dir", os.environ[PROGRAMS])
    jax.config.update("jax_persistent_cache_min_compile_time_secs", LEAST_COMPILE_SECONDS)


def pytest_unconfigure(config):
    if own := getattr(config, "own_programs", None):
        shutil.rmtree(own, ignore_errors=True)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Compile programs of short tests in half the time; those of long tests are called often."""
    with nullcontext() if "slow" in item.keywords else compiled_for_few_calls():
        return (yield)


MOST_MAPPINGS = 20_000
"""Linux allows a process 65,530 memory mappings. A compiled program takes dozens; if none is left, XLA ends it."""


def pytest_runtest_teardown(item, nextitem):
    mappings = Path("/proc/self/maps")
    if (nextitem is None or nextitem.path != item.path) and mappings.exists():
        with mappings.open() as lines:
            count = sum(1 for _ in lines)
        if count > MOST_MAPPINGS:
            jax.clear_caches()


hypothesis.settings.register_profile("repeatable", deadline=None, max_examples=25, derandomize=True)
hypothesis.settings.load_profile("repeatable")


class Moving(NamedTuple):
    """An arm in motion: joint positions, velocities and accelerations (n,)."""

    arm: Arm
    q: Array
    dq: Array
    ddq: Array


class LinearGaussian(NamedTuple):
    """x_i = A_i x_{i-1} + m_i, y_i = C x_i + n_i, with textbook estimates; NaN in y = not measured.

    The first A and Q lead from the prior to the first sample. Noise R is (T, m, m).
    """

    A: Array
    Q: Array
    C: Array
    R: Array
    mean: Array
    covariance: Array

    def filtered(self, y: Array) -> tuple[Array, Array]:
        """Means (T, k) and covariances (T, k, k) by the textbook Kalman filter, with rows of NaN removed."""
        x, P, kept = self.mean, self.covariance, []
        for A, Q, R, y_i in zip(self.A, self.Q, self.R, y, strict=True):
            x, P = A @ x, A @ P @ A.T + Q
            seen = np.isfinite(y_i)
            C = self.C[seen]
            K = P @ C.T @ np.linalg.inv(C @ P @ C.T + R[np.ix_(seen, seen)])
            x, P = x + K @ (y_i[seen] - C @ x), (np.eye(len(x)) - K @ C) @ P
            kept.append((x, P))
        return tuple(np.stack(part) for part in zip(*kept, strict=True))

    def together(self, y: Array) -> tuple[Array, ...]:
        """Joint normal distribution of all states: mean, covariance, C, y - C mean, and the covariance of that."""
        steps, k = len(y), len(self.mean)
        means, blocks = [], np.empty((steps, k, steps, k))
        mean, covariance = self.mean, self.covariance
        for i in range(steps):
            mean, covariance = self.A[i] @ mean, self.A[i] @ covariance @ self.A[i].T + self.Q[i]
            means.append(mean)
            ahead = covariance
            for j in range(i, steps):
                ahead = ahead if j == i else self.A[j] @ ahead
                blocks[j, :, i], blocks[i, :, j] = ahead, ahead.T
        mean, covariance, seen = np.concatenate(means), blocks.reshape(steps * k, -1), np.isfinite(y.ravel())
        C = np.kron(np.eye(steps), self.C)[seen]
        S = C @ covariance @ C.T + block_diag(*self.R)[np.ix_(seen, seen)]
        return mean, covariance, C, y.ravel()[seen] - C @ mean, S

    def log_density(self, y: Array) -> float:
        """Log density of a whole log."""
        *_, residual, S = self.together(y)
        return -(residual @ np.linalg.solve(S, residual) + np.linalg.slogdet(2 * np.pi * S)[1]) / 2

    def smoothed(self, y: Array) -> tuple[Array, Array]:
        """Means (T, k) and covariances (T, k, k) given the whole log."""
        mean, covariance, C, residual, S = self.together(y)
        gain = np.linalg.solve(S, C @ covariance).T
        kept = (covariance - gain @ C @ covariance).reshape(len(y), len(self.mean), len(y), -1)
        i = np.arange(len(y))
        return (mean + gain @ residual).reshape(len(y), -1), kept[i, :, i]


@pytest.fixture(scope="session")
def linear_gaussian() -> type[LinearGaussian]:
    return LinearGaussian


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The recorded and simulated logs, which are not part of a checkout."""
    shared = os.environ.get("FTBIAS_SHARED") or Path(__file__).parents[1] / ".." / "shared"
    data = Path(shared) / "data"
    if not data.is_dir():
        pytest.skip(f"no logs in {data}: set FTBIAS_SHARED to the folder that has data/")
    return data


def random_arm(seed: int, kinds: str) -> Arm:
    """An arm of random geometry; kinds has a letter per joint, "R" (revolute) or "P" (prismatic)."""
    rng = np.random.default_rng(seed)
    axes = rng.normal(size=(len(kinds), 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    points = rng.uniform(-0.4, 0.4, axes.shape)
    screws = [
        revolute_screw(axis, point) if kind == "R" else prismatic_screw(axis)
        for kind, axis, point in zip(kinds, axes, points, strict=True)
    ]
    return make_arm(np.stack(screws), rng.uniform(-0.5, 0.5, 3), rotation_from_rpy(rng.uniform(-1, 1, 3)))


@pytest.fixture(scope="session")
def panda() -> Arm:
    robot = built_in_robot("panda")
    return make_arm(robot.screws, robot.flange_translation, robot.flange_rotation)


@pytest.fixture(scope="session", params=["panda", "seven revolute joints", "seven joints, two of them prismatic"])
def arm(request: pytest.FixtureRequest, panda: Arm) -> Arm:
    return {
        "panda": panda,
        "seven revolute joints": random_arm(1, "RRRRRRR"),
        "seven joints, two of them prismatic": random_arm(2, "RPRRRPR"),
    }[request.param]


@pytest.fixture(scope="session")
def moving(arm: Arm) -> Moving:
    """One of the arms in a random state; joints turn by less than two radians."""
    return Moving(arm, *np.random.default_rng(3).uniform(-2, 2, (3, arm.linear.shape[0])))


@pytest.fixture(scope="session")
def params() -> Params:
    """A small arm (quick to compile) with a tool; every leaf has a different value, so that a mix-up shows."""
    rng = np.random.default_rng(4)

    def spread(scale: Array, n: int) -> Array:
        return np.asarray(scale) * rng.uniform(0.5, 2.0, n)

    theta = np.array([0.9, 0.02, -0.03, 0.06, 0.011, 1e-3, -2e-3, 0.013, 5e-4, 0.009])
    force_torque = np.repeat([1.0, 0.05], 3)
    joint = JointNoise(spread(20, 3), spread(1e-4, 3), spread(2e-3, 3), np.array([0.3, 1.0, 10.0]))
    bias = BiasNoise(
        spread(2e-2 * force_torque, 6),
        spread(1e-3, 36),
        spread(0.1 * force_torque, 6) ** 2,
        rng.normal(size=12),
        spread(np.concatenate([force_torque, 0.1 * force_torque]), 12),
    )
    gravity = np.array([1.0, -2.0, -9.5])
    return jax.tree.map(jax.numpy.asarray, Params(random_arm(5, "RPR"), gravity, theta, joint, bias))


@pytest.fixture(scope="session")
def samples() -> Sample:
    """A log of 40 samples for the small arm: irregular stamps, and every kind of missing measurement."""
    rng = np.random.default_rng(6)
    count = 40
    dt = np.r_[0.0, rng.uniform(0.002, 0.02, count - 1)]
    t = np.cumsum(dt)[:, None]
    q = 0.5 * np.sin(2 * t + [0, 1, 2]) + 1e-4 * rng.normal(size=(count, 3))
    dq = np.cos(2 * t + [0, 1, 2]) + 2e-3 * rng.normal(size=(count, 3))
    wrench = 3 * rng.normal(size=6) + np.repeat([0.3, 0.02], 3) * rng.normal(size=(count, 6))
    dq[5:9] = np.nan  # the stream stops
    q[12, 1] = np.nan  # one joint
    wrench[3::4] = np.nan  # a stream at a lower rate
    wrench[20:30, 2] = np.nan  # one axis
    for stream in (q, dq, wrench):
        stream[33] = np.nan  # a whole sample
    return Sample(*(jax.numpy.asarray(x) for x in (dt, q, dq, wrench)))


@pytest.fixture(scope="session")
def make_setup() -> Callable[..., Setup]:
    """The arm of the recordings, with joints base and elbow, and with sections of the setup replaced."""
    return lambda **sections: parse_setup({**small_archive.TABLES, **sections})


@pytest.fixture(scope="session")
def setup(make_setup: Callable[..., Setup]) -> Setup:
    """The arm of the recordings."""
    return make_setup()


@pytest.fixture
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with three logs at two depths, and the setup; the current folder is the one above."""
    monkeypatch.chdir(tmp_path)
    for seed, name in enumerate(["b.npz", "day/a.npz", "day/c.npz"]):
        small_archive.write_log(tmp_path / "logs" / name, seed)
    (tmp_path / "setup.toml").write_text(small_archive.SETUP)
    return tmp_path / "logs"
