"""Cost of contact detection, gating and noise adaptation on clean logs, and benefit with contacts or bias jumps."""

import sys
from pathlib import Path

import numpy as np

sys.path.append(str(Path(__file__).parents[1]))
import by_hand
from common import SETUP, keep, rounded

import ftbias_jax as ft
from ftbias_jax.filtering import params_for_log
from ftbias_jax.filtering.method.passes import GATE

SEEDS, DURATION, RATE, SETTLED = 20, 20.0, 250.0, 1.0
OFF = 1e6
"""Gate threshold in standard deviations that no innovation reaches, which switches the gate off."""
FORCES, DURATIONS = (1.0, 5.0, 20.0, 50.0), (0.2, 1.0, 3.0)
"""N and s: forces and durations of the contacts."""
BEGIN, LEVER = 8.0, 0.1
"""s at which contact begins or the bias jumps; m, lever arm from the sensor to the point of contact."""
JUMP_DURATION, SOON = 60.0, 10.0
"""s: length of the logs in which the bias jumps, and time after the jump at which the error is first evaluated."""
FOLLOWED = 0.1
"""Share of a jump that may remain as error of the bias for the jump to count as followed."""


def filtered(log, kinds):
    """Filter one log with each kind of robustness; return the results by kind, and the noise that was found."""
    options = ft.options_from_setup(SETUP)
    params = params_for_log.max_likelihood_params(SETUP, ft.samples_from_log(log), options)
    whole = by_hand.Log(params, log)
    found = whole.noise(whole.blocks(options))
    by_kind = {"default": (found, GATE), "gate off": (found, OFF), "gate alone": (None, GATE), "neither": (None, OFF)}

    def one(noise, gate):
        return whole.filtered(noise, options._replace(gate=gate))[0]

    return {kind: one(*by_kind[kind]) for kind in kinds}, whole.in_words(found)


def touched(made, seed, force, duration, stays=False):
    """Add a push in a random direction to a log, or a permanent bias jump (``stays``); return log and wrench (6,)."""
    rng = np.random.default_rng(seed)
    push, arm = (x / np.linalg.norm(x) for x in rng.normal(size=(2, 3)))
    wrench = force * np.concatenate([push, np.cross(LEVER * arm, push)])
    t = made.log.t
    rows = (t >= BEGIN) & (stays | (t < BEGIN + duration))
    return made.log._replace(wrench=made.log.wrench - rows[:, None] * wrench), wrench


def rms(x):
    return np.sqrt(np.mean(np.square(x), axis=0))


def clean(made):
    """Bias error, NEES of the bias (6 for consistent error bars) and false alarms on clean logs."""
    kinds = ("default", "gate off", "gate alone", "neither")
    errors, squares = ({kind: [] for kind in kinds} for _ in range(2))
    alarms = dict.fromkeys(("contact", "vibration", "level of the noise", "slow errors", "offset", "inflation"), 0)
    rejected = dict.fromkeys(kinds, 0.0)
    for one in made:
        results, found = filtered(one.log, kinds)
        for kind, result in results.items():
            rows = result.t >= SETTLED
            error = (result.bias - one.truth.bias)[rows]
            errors[kind].append(error)
            squares[kind].append(((error / result.bias_std[rows]) ** 2).sum(1))
            rejected[kind] += float((~result.used).mean()) / len(made)
        seen = (
            bool(found.contacts),
            found.vibration is not None and found.vibration.per_speed.any(),
            found.vibration is not None and (found.vibration.level != 1).any(),
            found.slow is not None and found.slow.std.any(),
            found.offset.any(),
            (found.inflation > 1).any(),
        )
        for name, yes in zip(alarms, seen, strict=True):
            alarms[name] += int(yes)
    scores = {
        kind: {
            "force_rmse_N": float(rms(np.concatenate(errors[kind])[:, :3].ravel())),
            "torque_rmse_Nm": float(rms(np.concatenate(errors[kind])[:, 3:].ravel())),
            "nees_of_bias": float(np.mean(np.concatenate(squares[kind]))),
        }
        for kind in kinds
    }

    def over(kind, other):
        return {name: rounded(x / scores[other][name]) for name, x in scores[kind].items()}

    return {
        "scores": {
            kind: {name: rounded(x) for name, x in score.items()} | {"share not used": rounded(rejected[kind])}
            for kind, score in scores.items()
        },
        "gate: default over gate off": over("default", "gate off"),
        "gate: gate alone over neither": over("gate alone", "neither"),
        "adapting: default over neither": over("default", "neither"),
        "logs with a false alarm": alarms,
    }


def contact(made):
    """Bias error from the beginning of a contact to the end of the log, and number of logs in which it is found."""
    scored = {}
    kinds = ("default", "neither")
    for force in FORCES:
        for duration in DURATIONS:
            errors, found_in, ends = {kind: [] for kind in kinds}, 0, []
            for seed, one in enumerate(made):
                log, _ = touched(one, seed, force, duration)
                results, found = filtered(log, kinds)
                for kind, result in results.items():
                    errors[kind].append((result.bias - one.truth.bias)[result.t >= BEGIN, :3])
                hits = [x for x in found.contacts if x.start < BEGIN + duration and x.end > BEGIN]
                found_in += bool(hits)
                ends += [max(abs(hits[0].start - BEGIN), abs(hits[-1].end - BEGIN - duration))] if hits else []
            scored[f"{force:g} N for {duration:g} s"] = {
                "force_rmse_N": {kind: rounded(rms(np.concatenate(x).ravel())) for kind, x in errors.items()},
                "found in logs": found_in,
                "median miss of its ends [s]": rounded(np.median(ends)) if ends else None,
            }
    return scored


def jump(made):
    """Bias error some time after a jump and at the end of the log, and the time until the bias followed the jump."""
    scored = {}
    kinds = ("default", "gate alone", "neither")
    for force in FORCES:
        soon, left, scaled, times = ({kind: [] for kind in kinds} for _ in range(4))
        for seed, one in enumerate(made):
            log, wrench = touched(one, seed, force, 0.0, stays=True)
            results, _ = filtered(log, kinds)
            for kind, result in results.items():
                after = result.t >= BEGIN
                errors = (result.bias - one.truth.bias - wrench)[after, :3]
                error = np.linalg.norm(errors, axis=1)
                scaled[kind].append(errors[-1] / result.bias_std[-1, :3])
                soon[kind].append(error[round(SOON * RATE)])
                left[kind].append(error[-1])
                off = np.flatnonzero(error > FOLLOWED * force)
                times[kind].append(result.t[after][off[-1]] - BEGIN if len(off) else 0.0)
        longest = JUMP_DURATION - BEGIN - 2 / RATE
        scored[f"{force:g} N"] = {
            kind: {
                f"error after {SOON:g} s [N], median": rounded(np.median(soon[kind])),
                "error at the end [N], median": rounded(np.median(left[kind])),
                "error at the end in its standard deviations, rms": rounded(rms(np.ravel(scaled[kind]))),
                "followed after [s], median": rounded(np.median(times[kind])),
                "not followed in logs": int((np.array(times[kind]) >= longest).sum()),
            }
            for kind in kinds
        }
    return scored


ARMS = ("panda", "ur5e", "ur10e", "iiwa14", "gen3")


def pushed_all_along():
    """Bias error under a push that never ends, as by a hand on the tool; arms, tools, motions and pushes are random."""
    worst, width, said = [], [], 0
    for seed in range(SEEDS):
        rng = np.random.default_rng(1000 + seed)
        tool = {"mass": rng.uniform(0.3, 3.0), "center_of_mass": [*rng.uniform(-0.02, 0.02, 2), rng.uniform(0.03, 0.1)]}
        setup = ft.parse_setup(
            {"robot": {"model": ARMS[seed % len(ARMS)]}, "sensor": {"noise_std": [0.1, 0.004]}, "tool": tool}
        )
        motion = ("sines", "moves")[seed % 2]
        made = ft.simulate(setup, duration=30.0, rate=RATE, motion=motion, seed=seed)
        t = made.log.t
        kept = np.exp(-np.diff(t, prepend=t[0] - 1 / RATE) / rng.uniform(0.3, 2.0))
        varied, kicks = np.zeros((len(t), 3)), rng.normal(size=(len(t), 3))
        for k in range(1, len(t)):
            varied[k] = kept[k] * varied[k - 1] + np.sqrt(1 - kept[k] ** 2) * kicks[k]
        always = rng.normal(size=3)
        force = rng.uniform(5, 25) * (always / np.linalg.norm(always) + rng.uniform(0.3, 0.8) * varied)
        push = np.concatenate([force, np.cross(rng.normal(size=3) * LEVER, force)], 1)
        result = ft.filter_log(setup, made.log._replace(wrench=made.log.wrench - push))
        off = np.abs(result.bias - made.truth.bias)[t >= SETTLED]
        worst.append(float((off / result.bias_std[t >= SETTLED]).max()))
        width.append(float(np.median(result.bias_std[-1, :3])))
        said += any("no free motion" in line for line in result.warnings)
    return {
        "largest error of the bias in its standard deviations, by log": rounded(worst),
        "logs inside three": int((np.array(worst) < 3).sum()),
        "logs that are told to have no free motion": said,
        "standard deviation at the end [N], median": rounded(np.median(width)),
    }


def simulated(duration, motion="sines"):
    return [ft.simulate(SETUP, duration=duration, rate=RATE, motion=motion, seed=seed) for seed in range(SEEDS)]


def main():
    made = simulated(DURATION)
    result = {"seeds": SEEDS, "seconds": DURATION, "rate_Hz": RATE, "seconds of logs with a jump": JUMP_DURATION}
    result["clean"] = {"sines": clean(made), "moves": clean(simulated(DURATION, "moves"))}
    print(result["clean"], flush=True)
    result["contact"] = contact(made)
    print(result["contact"], flush=True)
    result["pushed all along"] = pushed_all_along()
    print(result["pushed all along"], flush=True)
    keep(__file__, result | {"jump": jump(simulated(JUMP_DURATION))})


if __name__ == "__main__":
    main()
