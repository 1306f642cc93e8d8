"""Comparison of `mujoco.sysid` with `identify` on eight recordings of run.py: mass, centre and inertia of the tool.

It needs pip install 'mujoco[sysid]>=4' and writes sysid.json beside this script.
"""

import json
import tempfile
import time
from pathlib import Path

import mujoco
import numpy as np
from mujoco import sysid
from run import KINDS, SCENE, prepared, recording

import ftbias_jax as ft
from ftbias_jax.setup.mjcf import load_mjcf, mjcf_tool
from ftbias_jax.simulators.replay import joint_states, replay

CASES = (*(("tool", i) for i in range(4)), *((kind, i) for kind in ("cable", "delay and low-pass") for i in (0, 1)))
EVERY = 10
"""Number of samples averaged before recording and replay are compared; the motion is far slower than that."""


def values_of(tool):
    """Inertial parameters (10,) of a tool in kg, m, kg m^2."""
    return np.array([tool.mass, *tool.center_of_mass, *tool.inertia])


def set_inertia(spec, parameter):
    """Apply sysid's own modifier; it leaves the inertia's orientation NaN, which MuJoCo 4.0.0 then makes zero."""
    sysid.apply_body_inertia(spec, "hand", parameter)
    spec.body("hand").iquat[:] = [1, 0, 0, 0]


def by_sysid(user, setup, log):
    """Fit the hand's inertia and a constant bias by sysid; return tool parameters (10,) and standard errors (10,)."""
    count = len(log.t) // EVERY
    t, wrench = log.t[: count * EVERY : EVERY], log.wrench[: count * EVERY].reshape(count, EVERY, 6).mean(1)
    states = joint_states(setup, log)[: count * EVERY].reshape(count, EVERY, -1, 3).mean(1)
    spec = mujoco.MjSpec.from_file(str(SCENE))
    hand = sysid.body_inertia_param(spec, spec.compile(), "hand", sysid.InertiaType.Pseudo, modifier=set_inertia)
    params = sysid.ParameterDict(
        {"hand": hand, "bias": sysid.Parameter("bias", np.zeros(6), -20 * np.ones(6), 20 * np.ones(6))}
    )

    def scene(x):
        params.update_from_vector(x)
        return user._replace(model=sysid.apply_param_modifiers(params, spec.copy()))

    def residual(x, _):
        columns = [
            (replay(scene(one), t, states) - one[10:] - wrench) / setup.sensor.noise_std
            for one in x.reshape(len(x), -1).T
        ]
        stacked = np.stack([column.ravel() for column in columns], 1)
        return [stacked[:, 0] if x.ndim == 1 else stacked], None, None

    found, result = sysid.optimize(params.copy(), residual, x_scale="jac")
    x = found.as_vector()
    covariance, _ = sysid.calculate_intervals(residual(x, None)[0], result.jac)
    best, step = values_of(mjcf_tool(scene(x))), 1e-6
    slopes = np.stack([(values_of(mjcf_tool(scene(x + step * unit))) - best) / step for unit in np.eye(len(x))], 1)
    return best, np.sqrt(np.diag(slopes @ covariance @ slopes.T))


def by_identify(user, setup, log):
    found = ft.identify_tool(setup, log).tool
    return np.array(found.values), np.array(found.stderr)


def compared(kind, number, folder):
    """Errors of both methods on one recording: mass g, centre mm, inertia g m^2, and relative to standard errors."""
    setup, real, sensor, _ = prepared(kind, number, folder)
    log = recording(setup, real, sensor, 1000 * (1 + KINDS.index(kind)) + 2 * number)
    user, truth, row = load_mjcf(folder / "scene.xml"), values_of(mjcf_tool(real)), {"kind": kind}
    for name, fit in (("sysid", by_sysid), ("identify", by_identify)):
        start = time.process_time()
        try:
            values, stderr = fit(user, setup, log)
        except ft.FtbiasError as error:
            row[name] = {"refused": str(error).removeprefix(f"{folder}/")}
            continue
        off, known = 1e3 * (values - truth), np.isfinite(stderr) & (stderr > 0)
        row[name] = {
            "mass_g": round(float(off[0]), 3),
            "centre_mm": round(float(np.linalg.norm(off[1:4])), 3),
            "inertia_g_m2": round(float(np.linalg.norm(off[4:])), 4),
            "largest_in_stderr": round(float(np.abs((values - truth) / np.where(known, stderr, np.inf)).max()), 1),
            "seconds": round(time.process_time() - start, 1),
        }
    return row


def main():
    rows = []
    for kind, number in CASES:
        with tempfile.TemporaryDirectory() as folder:
            rows.append(compared(kind, number, Path(folder)))
        print(rows[-1], flush=True)
        Path(__file__).with_suffix(".json").write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
