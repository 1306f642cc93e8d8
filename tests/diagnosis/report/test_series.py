import numpy as np
import pytest

from ftbias_jax.diagnosis.report.series import Conditions, locate

STEP = 0.02
COUNT = 3000
NOISE = np.tile(np.repeat([0.1, 0.004], 3), (COUNT, 1))
T = STEP * np.arange(COUNT)


def white(seed: int) -> np.ndarray:
    return NOISE * np.random.default_rng(seed).normal(size=(COUNT, 6))


@pytest.fixture(scope="module")
def motion() -> Conditions:
    angle = 0.7 * T
    gravity = np.stack([np.sin(angle), 0 * T, -np.cos(angle)], axis=1)
    return Conditions(np.abs(np.sin(1.3 * T)), np.abs(np.cos(1.9 * T)), gravity, np.cos(0.9 * T), 20 + 10 * T / T[-1])


def test_noise_alone_is_nowhere(motion):
    found = [locate(white(seed) / NOISE, T, motion) for seed in range(100)]
    for name in ("intervals", "regimes", "bands"):
        assert sum(bool(getattr(where, name)) for where in found) <= 4
    assert all(np.isclose(sum(where.channels.values()), 1) for where in found)


def test_the_channel_of_the_gap_has_it_all(motion):
    residual = white(1)
    residual[:, 1] += 0.3 * np.sin(3 * T)
    residual[:, 5] += 0.012 * np.sin(3 * T)
    where = locate(residual / NOISE, T, motion, ("tool",))
    assert where.stages == ("tool",)
    assert where.channels["fy"] == pytest.approx(0.5, abs=0.05)
    assert where.channels["tz"] == pytest.approx(0.5, abs=0.05)


def test_events_are_the_intervals_in_the_order_of_time(motion):
    residual = white(2)
    events = [(50.0, 50.8, 0.8), (12.0, 13.0, 0.5)]
    for start, end, size in events:
        residual[(start <= T) & (end > T), 2] += size
    where = locate(residual / NOISE, T, motion)
    assert len(where.intervals) == 2
    for (start, end, _), (low, high, sigmas) in zip(sorted(events), where.intervals, strict=True):
        assert low == pytest.approx(start, abs=0.25)
        assert high == pytest.approx(end, abs=0.25)
        assert sigmas > 1.5
    assert where.regimes == ()  # two events say nothing about dependence on the motion


def test_a_gap_of_one_size_has_no_interval_and_no_regime(motion):
    where = locate(white(3) / NOISE + 3, T, motion)
    assert where.intervals == ()
    assert where.regimes == ()
    assert where.bands[0][2] > 0.9


@pytest.mark.parametrize(
    ("name", "inside"),
    [
        ("fast motion", lambda m: m.speed > 0.85),
        ("strong acceleration", lambda m: m.acceleration > 0.85),
        ("the sensor's +x axis points down", lambda m: m.gravity[:, 0] > 0.72),
        ("the sensor's -z axis points down", lambda m: m.gravity[:, 2] < -0.72),
        ("load falling", lambda m: m.load_rate < 0),
        ("second half of the log", lambda m: T > 30),
    ],
)
def test_the_regime_that_holds_the_gap_is_first(motion, name, inside):
    rng = np.random.default_rng(4)
    residual = white(4)
    residual[:, 0] += 0.2 * inside(motion) * rng.normal(size=COUNT)
    first = locate(residual / NOISE, T, motion).regimes[0]
    assert first.name.startswith(name) or (name.startswith("second half") and first.name.startswith("warm (over 25"))
    assert first.share > 0.8
    assert first.share > 1.3 * first.expected


def test_temperature_is_named_only_where_it_varies(motion):
    residual = white(5) * (1 + 2 * (T > 30))[:, None]

    def named(temperature):
        regimes = locate(residual / NOISE, T, motion._replace(temperature=temperature)).regimes
        return any(regime.name.startswith("warm") for regime in regimes)

    assert named(motion.temperature)
    assert not named(None)
    assert not named(np.full(COUNT, 21.0))
    assert not named(np.full(COUNT, np.nan))


def test_a_vibration_is_in_its_band(motion):
    residual = white(6)
    residual[:, 3] += 0.008 * np.sin(2 * np.pi * 12 * T)
    kept = np.ones(COUNT, bool)
    kept[1000:1030] = False  # a gap in the stamps
    part = motion._replace(**{name: getattr(motion, name)[kept] for name in Conditions._fields})
    ((low, high, share),) = locate((residual / NOISE)[kept], T[kept], part).bands
    assert (low, high) == (10, pytest.approx(25))
    assert share == pytest.approx(1)


def test_what_was_not_measured_counts_for_nothing(motion):
    residual = white(7)
    residual[:, 4] += 0.02
    full = locate(residual / NOISE, T, motion)
    residual[::2, 4] = np.nan
    residual[:, 2] = np.nan
    gappy = locate(residual / NOISE, T, motion)
    assert full.channels["ty"] > 0.95
    assert gappy.channels["ty"] > 0.95
    assert gappy.channels["fz"] == 0
    nothing = locate(np.full((COUNT, 6), np.nan), T, motion)
    assert (nothing.intervals, nothing.regimes, nothing.bands) == ((), (), ())
    assert sum(nothing.channels.values()) == pytest.approx(1)
    still = Conditions(*(np.full(COUNT, np.nan),) * 2, np.full((COUNT, 3), np.nan), np.full(COUNT, np.nan))
    assert locate(residual / NOISE, T, still).channels == gappy.channels


def test_a_log_of_a_few_bins_is_no_error(motion):
    for count in (1, 2, 20):
        part = Conditions(*(getattr(motion, name)[:count] for name in Conditions._fields))
        where = locate((white(8) / NOISE)[:count], T[:count], part)
        assert len(where.channels) == 6
