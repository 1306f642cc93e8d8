"""Arguments of the wrong kind, given from Python: each raises one typed error that names the argument."""

import numpy as np
import pytest
from stated import YAW_PITCH_ROLL

import ftbias_jax as ft
from ftbias_jax.errors import is_integer, is_number
from ftbias_jax.model.own_effects import fault_of

SETUP = ft.parse_setup(YAW_PITCH_ROLL)
T = np.arange(40) / 20
LOG = ft.Log(T, np.zeros((40, 3)), np.zeros((40, 3)), np.ones((40, 6)), np.full(40, np.nan))
VERBS = {
    "filter_log": ft.filter_log,
    "diagnose": ft.diagnose,
    "tune": ft.tune,
    "identify": ft.identify_tool,
    "payloads": ft.identify_payloads,
    "check": ft.check_setup,
    "calibrate": ft.calibrate,
}


@pytest.mark.parametrize("log", [None, 3])
@pytest.mark.parametrize("verb", VERBS)
def test_what_is_no_log_is_refused_by_every_verb(verb, log):
    with pytest.raises(ft.UsageError, match=r"^logs: got (NoneType|int) \(give logs of motion"):
        VERBS[verb](SETUP, log)


@pytest.mark.parametrize("verb", VERBS)
def test_a_log_changed_by_hand_must_have_a_row_for_every_stamp(verb):
    with pytest.raises(ft.LogError, match=r"^wrench: has shape \(38, 6\), expected \(40, 6\)"):
        VERBS[verb](SETUP, LOG._replace(wrench=LOG.wrench[:-2]))


@pytest.mark.parametrize(
    "change",
    [
        {"q": LOG.q[:, :2]},
        {"dq": LOG.dq.T},
        {"wrench": LOG.wrench.astype(str)},
        {"wrench": np.full((40, 6), np.inf)},
        {"temperature": None},
        {"wrench": np.full((40, 6), np.nan)},
        {"t": LOG.t[::-1]},
        {"t": LOG.t[:1]},
    ],
    ids=["joints missing", "transposed", "text", "infinite", "none", "never measured", "backwards", "one"],
)
def test_arrays_that_cannot_be_a_log_are_refused_before_anything_is_computed(change):
    with pytest.raises(ft.LogError, match="|".join(change)):
        ft.filter_log(SETUP, LOG._replace(**change))


def test_lists_of_numbers_are_arrays():
    as_lists = LOG._replace(q=LOG.q.tolist(), wrench=LOG.wrench.tolist())
    np.testing.assert_array_equal(ft.filter_log(SETUP, as_lists).bias, ft.filter_log(SETUP, LOG).bias)


def test_masked_values_are_missing_values():
    wrench = np.ma.masked_greater(np.arange(240.0).reshape(40, 6), 200.0)
    log = ft.Log.from_arrays(SETUP, T, LOG.q, wrench, raw=True)
    np.testing.assert_array_equal(np.isnan(log.wrench), wrench.mask)


@pytest.mark.parametrize("selection", [{"every": 2.5}, {"every": "2"}, {"rate": "a"}])
def test_a_selection_of_rows_must_be_a_number(tmp_path, selection):
    with pytest.raises(ft.UsageError, match=f"^{next(iter(selection))}: "):
        ft.filter_log(SETUP, LOG).save(tmp_path / "result.npz", **selection)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"effects": ["cable"]}, r"^effects: got list \(give a dict, such as \{'cable': \{\}\}"),
        ({"effects": "cable"}, "^effects: got str"),
        ({"duration": "3"}, "^duration: must be a positive number, not '3'"),
        ({"rate": None}, "^rate: must be a positive number, not None"),
        ({"rate": np.inf}, "^rate: must be a positive number, not inf"),
        ({"seed": 1.5}, "^seed: must be an integer, not 1.5"),
        ({"setup": 3}, "^setup: got int"),
    ],
)
def test_simulate_refuses_other_kinds_of_arguments(arguments, message):
    with pytest.raises(ft.UsageError, match=message):
        ft.simulate(**({"setup": SETUP} | arguments))


@pytest.mark.parametrize("read", [ft.load_setup, ft.load_effects, ft.load_sensor_model])
def test_what_is_no_path_is_refused(read):
    with pytest.raises(ft.UsageError, match=r": got NoneType \(give the path of a file\)"):
        read(None)


def test_a_setup_must_be_tables_by_name():
    with pytest.raises(ft.SetupError, match=r"^mapping: got list \(give the tables of a TOML text"):
        ft.parse_setup([1])


@pytest.mark.parametrize(
    ("parameter", "effect", "fault"),
    [
        ({"shape": 3}, {}, "shape must be a tuple of integers, such as (3,), not 3"),
        ({"starts": 3.0}, {}, "starts must be a tuple, such as (1.0,), not 3.0"),
        ({}, {"needs": "temperature"}, "needs must be a tuple, not 'temperature'"),
    ],
)
def test_fields_of_an_own_effect_must_be_tuples(parameter, effect, fault):
    own = ft.Effect(
        name="mine",
        stage="sensor",
        parameters=(ft.Parameter("size", "N", "how large", **parameter),),
        explanation="",
        remedy="",
        reading=lambda values, signals, wrench: wrench,
        **effect,
    )
    assert fault in fault_of(own)


def test_numbers_are_told_from_text_and_truth():
    assert all(is_number(x, 0, 3) for x in (2, np.float32(2), np.array(2.0)))
    assert not any(is_number(x, 0, 3) for x in ("2", True, None, np.nan, np.array([1.0, 2.0]), 4, 1j))
    assert is_integer(np.int64(3))
    assert not any(is_integer(x) for x in (3.0, True, None))
