"""Effects of the sensor itself: gain, hysteresis, filter, converter and noise."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.signal import butter, firwin, lfilter, lfilter_zi

from validation.generator.arms import Floats
from validation.generator.effects.effect import Draw, Effect, Scene

GAIN, CROSSTALK, BENT, RIPPLE, HYSTERESIS, LOW_PASS = range(6)  # order in which they act on a wrench


def gain(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "scattered" (each channel separately), "one_channel", "force_channels" (a wrong calibration sheet)."""
    size = draw.size((0.01, 0.02), (0.03, 0.06), (0.08, 0.12))
    factors = 1 + size * draw.rng.uniform(0.5, 1.5, 6) * draw.signs()
    if form == "one_channel":
        factors = np.where(np.arange(6) == draw.rng.integers(6), 1 + 2 * (factors - 1), 1.0)
    if form == "force_channels":
        factors = 1 + draw.sign() * size * np.array([1, 1, 1, 0, 0, 0])
    return Effect("gain", form, {"gain": factors.tolist()}, sensor=lambda w: w * factors, order=GAIN)


def crosstalk(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "sparse" (one to four entries), "mutual" (pairs of channels), "full" (every channel a little)."""
    share = draw.size((0.01, 0.02), (0.03, 0.06), (0.08, 0.15))
    unit = np.repeat([1.0, 0.1], 3)  # crosstalk of 1 N is as large as that of 0.1 Nm
    weight = draw.rng.uniform(0.7, 1.3, (6, 6)) * draw.signs(36).reshape(6, 6)
    mask = np.zeros((6, 6))
    rows, columns = np.nonzero(~np.eye(6, dtype=bool))
    picked = draw.rng.permutation(len(rows))[: int(draw.rng.integers(1, 5))]
    mask[rows[picked], columns[picked]] = 1
    if form == "mutual":
        mask = np.maximum(mask, mask.T)
    if form == "full":
        mask = 0.5 * (1 - np.eye(6))
    matrix = np.eye(6) + share * weight * mask * unit[:, None] / unit
    return Effect("crosstalk", form, {"matrix": matrix.tolist()}, sensor=lambda w: w @ matrix.T, order=CROSSTALK)


def bent(form: str, draw: Draw, scene: Scene) -> Effect:
    """Load-dependent gain. Forms: "quadratic", "cubic"; ``share``: relative error at the largest load. Unlisted."""
    share = draw.size((0.01, 0.02), (0.03, 0.06), (0.08, 0.15)) * draw.signs() * draw.rng.uniform(0.3, 1.0, 6)
    power = 1 if form == "quadratic" else 2
    top = np.abs(scene.nominal).max(0)
    return Effect(
        "load_nonlinearity",
        form,
        {"share": share.tolist()},
        sensor=lambda w: w + share * w * (np.abs(w) / top) ** power,
        order=BENT,
    )


def gear_ripple(form: str, draw: Draw, scene: Scene) -> Effect:
    """Vibration locked to the angle of a joint's gear, whose amplitude grows with the joint speed. Unlisted."""
    joint = int(draw.rng.integers(2, len(scene.belief.arm.home)))
    teeth = float(draw.rng.integers(30, 101))
    sizes = draw.size((1.0, 2.0), (3.0, 5.0), (8.0, 15.0)) * draw.rng.uniform(0.3, 1.0, 6) * scene.belief.noise_std
    q, dq, _ = scene.motion(scene.grid)
    ripple = (np.sin(teeth * q[:, joint]) * np.minimum(np.abs(dq[:, joint]), 1.0))[:, None]
    parameters = {"joint": joint + 1, "per_turn": teeth, "amplitude": sizes.tolist()}
    return Effect("gear_ripple", form, parameters, sensor=lambda w: w + sizes * ripple, order=RIPPLE)


def low_pass(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "first_order", "butterworth" (second order), "moving_average"; the cutoff is the -3 dB frequency."""
    hz = 1 / draw.size((0.1, 0.17), (0.2, 0.4), (0.5, 1.2))
    rate = 1 / (scene.grid[1] - scene.grid[0])
    if form == "moving_average":
        b, a = firwin(max(3, round(0.443 * rate / hz)), 1e-6, window="boxcar", fs=rate), np.ones(1)
    else:
        b, a = butter(2 if form == "butterworth" else 1, hz, fs=rate)
    return Effect("low_pass", form, {"cutoff_hz": hz}, sensor=lambda w: _filtered(b, a, w), order=LOW_PASS)


def _filtered(b: Floats, a: Floats, w: Floats) -> Floats:
    """Filter every channel of w (S, 6) by b / a, starting in the steady state of the first value."""
    return lfilter(b, a, w, axis=0, zi=lfilter_zi(b, a)[:, None] * w[0])[0]


def hysteresis(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "play", "bouc_wen", "maxwell_slip" (several plays); ``fraction``: loop width / span of the channel."""
    fraction = draw.size((0.008, 0.015), (0.02, 0.04), (0.08, 0.14))
    radius = fraction * scene.span / 2
    memory = {"play": _stops(1), "maxwell_slip": _stops(4), "bouc_wen": _bouc_wen}[form]
    parameters = {"fraction": fraction, "width": (2 * radius).tolist(), "form": form}
    return Effect("hysteresis", form, parameters, sensor=lambda w: w - radius * memory(w / radius), order=HYSTERESIS)


def _stops(count: int) -> Callable[[Floats], Floats]:
    """Mean, within -1 ... 1, of ``count`` elements that follow x (S, 6) until they slip, at thresholds up to 2."""
    thresholds = (2 * np.arange(count) + 1)[:, None] / count

    def memory(x: Floats) -> Floats:
        state, out = np.zeros((count, x.shape[1])), np.zeros_like(x)
        for k, step in enumerate(np.diff(x, axis=0), 1):
            state = np.clip(state + step, -thresholds, thresholds)
            out[k] = state.mean(0)
        return out

    return memory


LONGEST_STEP = 0.5
"""Longest explicit step of Bouc-Wen's variable, relative to its range."""


def _bouc_wen(x: Floats) -> Floats:
    """Bouc-Wen's smooth hysteretic variable for x (S, 6), n = 1.5, beta = 0.6, gamma = 0.4; within -1 ... 1.

    The explicit steps are at most LONGEST_STEP, because with longer ones the variable leaves its range and diverges.
    """
    z, out = np.zeros(x.shape[1]), np.zeros_like(x)
    for k, step in enumerate(np.diff(x, axis=0), 1):
        count = max(int(np.ceil(np.abs(step).max() / LONGEST_STEP)), 1)
        for _ in range(count):
            z = z + step / count * (1 - np.abs(z) ** 1.5 * (0.6 * np.sign(step * z) + 0.4))
        out[k] = z
    return out


def saturation(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "clip" (both signs), "one_sided", "force_only"; limit = fraction of a channel's largest reading."""
    fraction = 1 - min(draw.size((0.05, 0.1), (0.15, 0.25), (0.3, 0.4)), 0.6)
    nominal = _at_stamps(scene) - scene.bias
    limits = fraction * np.abs(nominal).max(0)
    lower, upper = -limits, limits
    if form == "one_sided":
        side = np.where(np.abs(nominal.max(0)) >= np.abs(nominal.min(0)), 1.0, -1.0)
        lower, upper = np.where(side < 0, -limits, -np.inf), np.where(side > 0, limits, np.inf)
    if form == "force_only":
        lower[3:], upper[3:] = -np.inf, np.inf
    parameters = {"fraction": fraction, "limits": limits.tolist()}
    return Effect("saturation", form, parameters, reading=lambda w: np.clip(w, lower, upper))


def _at_stamps(scene: Scene) -> Floats:
    return np.stack([np.interp(scene.stamps, scene.grid, column) for column in scene.nominal.T], 1)


def quantisation(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "round", "truncate" (towards minus infinity: half a step of offset), "coarse_force" (forces only)."""
    sigmas = draw.size((2.0, 3.0), (4.0, 6.0), (8.0, 12.0))
    step = sigmas * scene.belief.noise_std
    if form == "coarse_force":
        step = step * np.repeat([1.0, 0.01], 3)
    lattice = np.floor if form == "truncate" else np.round
    parameters = {"in_noise_sigmas": sigmas, "step": step.tolist()}
    return Effect("quantisation", form, parameters, reading=lambda w: lattice(w / step) * step)


def noise_level(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "louder", "some_channels", "heavy_tailed" (Student t, 4 degrees of freedom), "quieter" than stated."""
    scale = draw.size((1.6, 2.2), (3.0, 4.0), (6.0, 8.0))
    stream = draw.stream()
    if form == "quieter":
        scale = 1 / scale
    scales = np.full(6, scale)
    if form == "some_channels":
        scales[draw.rng.permutation(6)[: draw.rng.integers(2, 5)]] = 1.0

    def noise(white: Floats) -> Floats:
        if form != "heavy_tailed":
            return white * scales
        return scales * scene.belief.noise_std * stream().standard_t(4, white.shape) / np.sqrt(2)  # variance 2 -> 1

    return Effect("noise_level", form, {"scale": scale, "per_channel": scales.tolist()}, noise=noise)


def outliers(form: str, draw: Draw, scene: Scene) -> Effect:
    """Forms: "fixed_size" (each channel alone), "whole_sample" (all channels), "spread" (exponential sizes)."""
    rate, sigmas = draw.size((0.001, 0.003), (0.004, 0.008), (0.015, 0.025)), float(draw.rng.uniform(15, 45))
    stream = draw.stream()

    def noise(white: Floats) -> Floats:
        rng = stream()
        hit = rng.uniform(size=(len(white), 1 if form == "whole_sample" else 6)) < rate
        sizes = rng.exponential(1.0, white.shape) + 0.4 if form == "spread" else np.ones(white.shape)
        return white + hit * sizes * sigmas * scene.belief.noise_std * rng.choice([-1.0, 1.0], white.shape)

    return Effect("outliers", form, {"rate": rate, "sigmas": sigmas}, noise=noise)


def vibration(form: str, draw: Draw, scene: Scene) -> Effect:
    """Noise that grows with the motion, to ``times`` the noise at rest in the fastest tenth of the log.

    Forms: "squared" (variance linear in squared joint speeds, as in the catalogue), "straight" (standard deviation
    linear in the sum of joint speeds), "meshing" (tooth meshing of the motors' gears, aliased by the sampling).
    """
    times = draw.size((2.0, 3.0), (4.0, 6.0), (8.0, 12.0))
    q, dq, _ = scene.motion(scene.stamps)
    joint, channel, stream = draw.rng.uniform(0.2, 1.0, q.shape[1]), draw.rng.uniform(0.5, 1.5, 6), draw.stream()
    speed = {"squared": np.sqrt(dq**2 @ joint), "straight": np.abs(dq) @ joint}.get(form, np.sqrt(dq**2 @ joint**2))
    fastest = np.sqrt((speed[speed >= np.quantile(speed, 0.9)] ** 2).mean())
    size = np.sqrt(times**2 - 1) / fastest * channel * scene.belief.noise_std
    teeth = draw.rng.uniform(3e3, 1e4, q.shape[1])

    def noise(white: Floats) -> Floats:
        if form == "meshing":
            phase = stream().uniform(0, 2 * np.pi, (6, q.shape[1]))
            waves = [np.sqrt(2) * np.sin(teeth * q + shift) * dq @ joint for shift in phase]
            return white + size * np.stack(waves, 1)
        return white + size * speed[:, None] * stream().normal(size=white.shape)

    rows = {"variance": np.outer(joint, size**2).tolist()} if form == "squared" else {}
    return Effect("vibration", form, {"times": times, **rows}, noise=noise)
