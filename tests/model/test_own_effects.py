"""Effects that are passed by the caller."""

from dataclasses import replace
from types import SimpleNamespace

import jax
import numpy as np
import own_effects
import pytest
from stated import PANDA

from ftbias_jax.errors import SetupError, UsageError
from ftbias_jax.filtering.verbs.from_setup import filter_log
from ftbias_jax.io import read_log
from ftbias_jax.model import own_effects as loading
from ftbias_jax.model.effects import compose
from ftbias_jax.model.effects.catalogue import CATALOGUE, Catalogue, OwnValues, values_of
from ftbias_jax.model.effects.fitting import ByJoint, Entries, Fitting, Grid, Linear, Samples, Settling
from ftbias_jax.model.effects.types import Effect, Parameter
from ftbias_jax.model.kinematics.screws import sensor_pose
from ftbias_jax.model.own_effects import catalogue_of_setup, catalogue_with, fault_of, load_effects
from ftbias_jax.model.params import params_from_setup
from ftbias_jax.model.simulate_log import simulate
from ftbias_jax.setup import load_setup, parse_setup


def shifted(values, signals, wrench):
    return wrench + values["shift"]


SHIFT = Parameter("shift", "N", "added to every channel", scale=2.0)
SIMPLE = Effect("simple", "sensor", (SHIFT,), "it is shifted", "shift it back", reading=shifted)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "hose.py"
    path.write_text(own_effects.HOSE)
    return path


def test_a_file_gives_the_effects_that_it_names(file, tmp_path):
    """A list in the file decides which effects are taken, and in which order."""
    assert [effect.name for effect in load_effects(file)] == ["hose_drag"]
    copies = [f"HOSE_DRAG._replace(name={name!r})" for name in ("b", "a")]
    file.write_text(own_effects.HOSE + f"EFFECTS = [{', '.join(copies)}]\n")
    assert [effect.name for effect in load_effects(str(file))] == ["b", "a"]
    with pytest.raises(UsageError, match="is no file"):
        load_effects(tmp_path / "missing.py")


@pytest.mark.parametrize(
    ("code", "message"),
    [
        ("import nothing_of_this_name", "line 1: ModuleNotFoundError"),
        ("x = 1\ny = x / 0", "line 2: ZeroDivisionError"),
        ("def f(:", "line 1: SyntaxError"),
        ("x = 1", "defines no effect"),
    ],
)
def test_a_file_that_cannot_be_run_is_told_with_its_line(tmp_path, code, message):
    path = tmp_path / "broken.py"
    path.write_text(code)
    with pytest.raises(UsageError, match=message):
        load_effects(path)


def test_an_installed_package_is_run_only_if_it_is_named(monkeypatch):
    ran = []
    entry = SimpleNamespace(name="offered", load=lambda: ran.append(1) or (SIMPLE,))
    monkeypatch.setattr(loading, "installed", lambda: (entry,))
    assert not ran
    assert load_effects("offered") == (SIMPLE,)
    assert ran == [1]


@pytest.mark.parametrize(
    ("effect", "fault"),
    [
        ("hose", "expected an Effect, got str"),
        (SIMPLE._replace(name="two words"), "a name has letters"),
        (SIMPLE._replace(name="gain"), "the name is taken"),
        (SIMPLE._replace(stage="table"), "stage 'table' is none of tool"),
        (SIMPLE._replace(reading=None), "at least one of reading"),
        (SIMPLE._replace(recording=shifted), "recording cannot be combined"),
        (SIMPLE._replace(filter_noise="vibration"), "filter_noise is for built-in effects"),
        (SIMPLE._replace(fit="linear"), "fit: expected a Fitting, got str"),
        (SIMPLE._replace(fit=Fitting(Settling("tau", 2.0))), "fit: there is no parameter 'tau'"),
        (SIMPLE._replace(fit=Fitting(Linear(((("turns", 1.0),),)))), "fit: there is no parameter 'turns'"),
        (SIMPLE._replace(fit=Fitting(Samples("level"))), "needs a recording function"),
        (SIMPLE._replace(needs_motion="fast"), "is neither joints nor acceleration"),
        (SIMPLE._replace(fit=Fitting(Grid())), "a grid needs a parameter with starts"),
        (SIMPLE._replace(fit=Fitting(Settling(SHIFT.name, 2.0))), "its strength in each of the six channels"),
        (SIMPLE._replace(fit=Fitting(Entries(SHIFT.name))), "is no matrix"),
        (SIMPLE._replace(fit=Fitting(ByJoint(SHIFT.name, SHIFT.name))), "needs a transform function"),
        (SIMPLE._replace(parameters=(SHIFT, SHIFT)), "two parameters have one name"),
        (SIMPLE._replace(parameters=("shift",)), "expected a Parameter"),
        (SIMPLE._replace(parameters=(SHIFT._replace(shape=(2,), scale=[1, 2, 3]),)), "scale does not fit the shape"),
        (SIMPLE._replace(parameters=(SHIFT._replace(scale=-1.0),)), "must be 0 or more"),
        (SIMPLE._replace(parameters=(SHIFT._replace(lower=2, upper=1),)), "lower is above upper"),
        (SIMPLE._replace(parameters=(SHIFT._replace(lower=1),)), "neutral is outside of its bounds"),
        (SIMPLE._replace(parameters=(SHIFT._replace(neutral=float("inf")),)), "needs search=True"),
        (SIMPLE._replace(parameters=(SHIFT._replace(starts=((1, 2),)),)), "does not have the shape"),
    ],
)
def test_an_object_that_is_no_entry_is_refused_in_a_sentence(effect, fault):
    assert fault in fault_of(effect)
    with pytest.raises(UsageError, match=fault):
        catalogue_with([effect])


def test_an_own_effect_acts_after_the_first_built_in_ones_of_its_stage():
    for stage, before, after in (
        ("tool", "tool_inertia", "joint_flexibility"),
        ("environment", "contact", "mount_rotation"),
        ("sensor", "low_pass", "warmup"),
        ("bias", "bias_jump", "time_delay"),
    ):
        names = list(catalogue_with([SIMPLE._replace(stage=stage)]))
        place = names.index("simple")
        assert (names[place - 1], names[place + 1]) == (before, after)


def test_catalogues_of_the_same_entries_share_what_is_compiled():
    first, second = (catalogue_with([SIMPLE]) for _ in range(2))
    assert first == second
    assert hash(first) == hash(second)
    assert first != catalogue_with([SIMPLE._replace()])
    assert first != CATALOGUE
    assert catalogue_with([]) is CATALOGUE


def test_values_keep_their_catalogue_through_a_compiled_function():
    catalogue = catalogue_with([SIMPLE])
    values = values_of({"simple": {"shift": 2.0}}, catalogue)
    assert type(values_of({"gain": {"gain": np.ones(6)}}, catalogue)) is dict  # those of built-in effects stay plain
    doubled = jax.jit(lambda values: jax.tree.map(lambda x: 2 * x, values))(values)
    assert isinstance(doubled, OwnValues)
    assert doubled.catalogue is catalogue
    assert float(doubled["simple"]["shift"]) == 4.0


def test_values_without_their_catalogue_are_not_silently_left_out():
    with pytest.raises(KeyError, match="simple"):
        compose.correct_record(np.zeros((3, 6)), None, {"simple": {"shift": np.ones(())}})


def test_a_setup_states_an_own_effect_only_if_the_caller_has_brought_it(file, tmp_path):
    path = tmp_path / "setup.toml"
    parse_setup(PANDA | {"effects": {"hose_drag": {"coefficient": 3.0}}}).save(path)
    with pytest.raises(SetupError, match=r"unknown effect 'hose_drag'.*--effects"):
        params_from_setup(load_setup(path))
    params = params_from_setup(load_setup(path, effects=load_effects(file)))
    assert float(params.effects["hose_drag"]["coefficient"]) == 3.0


def test_an_effect_that_is_brought_twice_counts_once(file):
    effects = load_effects(file)
    setup = parse_setup(PANDA).with_effects(effects).with_effects(effects)
    assert isinstance(catalogue_of_setup(setup), Catalogue)
    assert len(setup.own_effects) == 1


def test_a_simulated_hose_pulls_against_the_velocity_of_the_sensor(file):
    """The force missing in the reading, in base axes, against finite differences of the sensor's position."""
    setup = parse_setup(PANDA)
    own = load_effects(file)
    made = simulate(setup, {"hose_drag": {"coefficient": 4.0}}, own=own, duration=4, rate=200, seed=3)
    changed = made.truth.wrench_clean - made.truth.wrench_tool
    params = params_from_setup(setup)
    R, p = jax.vmap(sensor_pose, (None, 0))(params.arm, made.truth.q)
    velocity = np.gradient(p, made.truth.t, axis=0)
    on_tool = -np.einsum("tij,tj->ti", R, changed[:, :3])
    np.testing.assert_allclose(on_tool[2:-2], -4.0 * velocity[2:-2], atol=0.02)
    assert np.abs(on_tool).max() > 0.5
    np.testing.assert_allclose(changed[:, 3:], 0, atol=1e-12)


@pytest.mark.parametrize(
    "reading",
    [lambda v, s, w: w * np.nan, lambda v, s, w: v["coefficient"], lambda v, s, w: w + 1j],
    ids=["NaN", "a number", "complex"],
)
def test_a_reading_that_no_sensor_gives_is_not_simulated(file, reading):
    (effect,) = load_effects(file)
    with pytest.raises(UsageError, match=r"own: with hose_drag the reading is not an array \(50, 6\)"):
        simulate(parse_setup(PANDA), {"hose_drag": {}}, own=[effect._replace(reading=reading)], duration=1, rate=50)


def spinning(values, signals, wrench):
    return wrench + values["per_ampere"] * signals.columns["current"][:, None]


SPINNING = Effect(
    "spinning", "sensor", (Parameter("per_ampere", "N/A", "", scale=0.1),), "", "", reading=spinning, needs=("current",)
)


def test_a_column_that_an_effect_needs_is_simulated_filtered_and_kept_in_the_file(tmp_path):
    setup = parse_setup(PANDA | {"log": {"columns": {"current": "I"}}}).with_effects([SPINNING])
    current = np.sin(np.arange(200) / 7)
    made = simulate(setup, {"spinning": {"per_ampere": 2.0}}, duration=2, rate=100, columns={"current": current})
    change = made.truth.wrench_clean - made.truth.wrench_tool
    np.testing.assert_allclose(change, 2.0 * current[:, None] * np.ones(6), atol=1e-9)
    made.save(tmp_path / "log.npz")
    log = read_log(tmp_path / "log.npz", setup)
    np.testing.assert_allclose(log.columns["current"].at(log.t), current, atol=1e-6)
    knowing = replace(setup, effects={"spinning": {"per_ampere": 2.0}})
    filtered = filter_log(knowing, log)
    np.testing.assert_allclose(filtered.wrench_tool, made.truth.wrench_clean, atol=0.05)
    again = simulate(knowing, motion=log)
    np.testing.assert_allclose(again.truth.wrench_clean[5:], made.truth.wrench_clean[5:], atol=0.1)


@pytest.mark.parametrize(
    ("columns", "message"), [(None, "needs the column 'current'"), ({"current": [1.0]}, "for 200 stamps")]
)
def test_a_column_that_is_missing_or_of_another_length_is_told(columns, message):
    setup = parse_setup(PANDA).with_effects([SPINNING])
    with pytest.raises(UsageError, match=message):
        simulate(setup, {"spinning": {}}, duration=2, rate=100, columns=columns)
