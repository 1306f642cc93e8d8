"""Made-up diagnoses, as fixtures for the tests of reports and commands."""

from collections.abc import Callable

import numpy as np
import pytest

from ftbias_jax.diagnosis.result import Candidate, Diagnosis, Gap, Regime, Series, Where

MakeDiagnosis = Callable[..., Diagnosis]
NOISE = np.repeat([0.03, 0.0012], 3)


def candidate(effect: str = "tool_mass", gain: float = 1.93, **changes) -> Candidate:
    base = Candidate(
        effect,
        "tool",
        (),
        (),
        {"mass": 0.8134},
        {"mass": 0.0041},
        gain,
        0.11,
        0.97,
        "the tool is heavier than stated",
        "weigh the tool",
        {"mass": "kg"},
    )
    return base._replace(**changes)


@pytest.fixture(scope="session")
def make_diagnosis() -> MakeDiagnosis:
    """A diagnosis of made-up logs, with any fields replaced."""

    def make(logs: int = 1, bins: int = 2000, **changes) -> Diagnosis:
        rng = np.random.default_rng(0)
        t = 0.02 * np.arange(bins)
        after = NOISE * rng.normal(size=(bins, 6))
        after[bins // 3 : bins // 3 + 20] = np.nan
        regressor = np.sin(t)
        before = after + regressor[:, None] * [0.3, 0, 0, 0, 0.01, 0]
        series = Series(t, before, after, np.tile(NOISE, (bins, 1)), regressor, "predicted change [N]")
        rms = [np.sqrt(np.nanmean(x**2, 0)) for x in (before, after)]
        cause = candidate(indistinguishable_from=("gain",), separate_by=("turn the wrist",))
        gain = candidate("gain", 1.9, parameters={"gain": [1.1] * 6}, stderr={"gain": [0.01] * 6}, units={"gain": "1"})
        where = Where(
            ("tool", "sensor"),
            dict(zip(("fx", "fy", "fz", "tx", "ty", "tz"), (0.5, 0, 0, 0, 0.5, 0), strict=True)),
            ((12.0, 13.4, 5.2),),
            (Regime("fast motion", 0.7, 0.33),),
            ((0.1, 0.3, 0.9),),
        )
        base = Diagnosis(
            "explained",
            "The tool weighs 0.81 kg.",
            (cause,),
            (cause, gain),
            Gap(*rms, NOISE, 3.4, 1.01, 0.98, 0.01),
            where,
            (("temperature_drift", "no temperature was recorded"),),
            (series,) * logs,
            tuple(f"log_{i}.npz" for i in range(logs)),
        )
        return base._replace(**changes)

    return make


@pytest.fixture(scope="session")
def make_candidate() -> Callable[..., Candidate]:
    return candidate
