"""Logs read in parts equal those read whole, with the same report of faults."""

import numpy as np
import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.io import cleaning, parts, read_log
from ftbias_jax.io.health import Axis, extend
from ftbias_jax.io.log import Log
from ftbias_jax.io.parts import open_log

T = 500


@pytest.fixture(autouse=True)
def _everything_is_long(monkeypatch):
    monkeypatch.setattr(parts, "LONG", 64)
    monkeypatch.setattr(cleaning, "PART", 4)


def arrays(seed=0):
    rng = np.random.default_rng(seed)
    q, dq, wrench = rng.normal(size=(T, 2)), rng.normal(size=(T, 2)), rng.normal(size=(T, 6))
    q[:100, 1] = np.nan
    wrench[::2] = np.nan
    wrench[:, 4] = np.nan
    return {"t": 5.0 + np.cumsum(rng.uniform(0.01245, 0.01255, T)), "q": q, "dq": dq, "wrench": wrench}


def joined(log, size):
    pieces = list(log.parts(size))
    return Log(*(np.concatenate(x) for x in zip(*(piece[:5] for piece in pieces), strict=True)), log.start)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("size", [1, 7, T, 2 * T])
def test_parts_are_the_log(tmp_path, setup, save, size):
    save(tmp_path / "log.npz", **arrays(), notes=np.zeros(3))
    log, whole = open_log(tmp_path / "log.npz", setup), read_log(tmp_path / "log.npz", setup)
    for got, expected in zip(joined(log, size)[:6], whole[:6], strict=True):
        np.testing.assert_array_equal(got, expected)
    for got, expected in zip(log.whole(), whole, strict=True):
        np.testing.assert_array_equal(got, expected)
    assert (log.length, log.repairs) == (T, whole.repairs)


def test_types_orders_and_absent_arrays_do_not_matter(tmp_path, make_setup):
    setup = make_setup(sensor={"noise_std": 0.1, "reports": "wrench_on_sensor"})
    log = arrays()
    del log["dq"]
    log |= {"q": np.asfortranarray(log["q"], np.float32), "wrench": np.float32(log["wrench"]), "temperature": log["t"]}
    np.savez(tmp_path / "log.npz", **log)
    whole = read_log(tmp_path / "log.npz", setup)
    for got, expected in zip(joined(open_log(tmp_path / "log.npz", setup), 64)[:6], whole[:6], strict=True):
        np.testing.assert_array_equal(got, expected)


def test_facts_of_the_whole_log(tmp_path, setup):
    log = arrays()
    log["wrench"][:, 2] = np.where(np.arange(T) % 2 == 0, np.nan, np.clip(9 * np.sin(np.arange(T) / 50), -20, 5))
    np.savez(tmp_path / "log.npz", **log)
    opened = open_log(tmp_path / "log.npz", setup)
    facts, clipped = opened.facts, log["wrench"][:, 2] == 5
    np.testing.assert_array_equal(facts.first_q, [log["q"][0, 0], log["q"][100, 1]])
    np.testing.assert_array_equal([axis.samples for axis in facts.axes], [T / 2] * 4 + [0, T / 2])
    np.testing.assert_allclose(facts.wrench_t, log["t"][1::2] - log["t"][0])
    expected = [extend(Axis(), log["t"], axis).limits for axis in log["wrench"].T]
    np.testing.assert_array_equal([axis.limits for axis in facts.axes], expected)
    assert clipped.sum() > 50
    assert [repair.what for repair in opened.repairs] == [
        f"samples at the end of the sensor's range left out: {clipped.sum()} of fz",
        "never measured: ty",
        f"the wrench is measured in {T // 2} of {T} rows: taken as a stream of 40 Hz",
    ]
    np.testing.assert_array_equal(np.isnan(joined(opened, 9).wrench[1::2, 2]), clipped[1::2])


@pytest.mark.parametrize(
    ("name", "change", "words"),
    [
        ("q", lambda q: np.where(np.arange(T)[:, None] == 321, np.inf, q), r"q: q\[321, 0\] is infinite"),
        ("q", lambda q: np.full_like(q, np.nan), "joint 'joint1' is never measured|joint 'base' is never measured"),
        ("q", lambda q: q[:300], r"q: has shape \(300, 2\) for 500 stamps"),
        ("wrench", lambda w: np.full_like(w, np.nan), "no wrench data"),
        ("wrench", lambda w: w.astype(complex), "wrench: has type complex128"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, setup, name, change, words):
    log = arrays()
    np.savez(tmp_path / "log.npz", **{**log, name: change(log[name])})
    with pytest.raises(LogError, match=words):
        open_log(tmp_path / "log.npz", setup)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
def test_damage_anywhere_in_a_file_is_an_error_of_ours(tmp_path, setup, save):
    save(tmp_path / "log.npz", **arrays())
    content = (tmp_path / "log.npz").read_bytes()
    refused = 0
    for at in range(40, len(content), len(content) // 60):
        (tmp_path / "log.npz").write_bytes(content[:at] + bytes([content[at] ^ 0x40]) + content[at + 1 :])
        try:
            open_log(tmp_path / "log.npz", setup).whole()
        except LogError:
            refused += 1
    assert refused > 50


def spoilt(kind):
    """A log with one of the faults that are repaired."""
    log = arrays()
    log["wrench"] = np.random.default_rng(1).normal(size=(T, 6))
    if kind == "stuck":
        log["wrench"][100:450, 2] = 0.25
    elif kind == "clipped":
        log["wrench"][:, 3] = np.clip(9 * np.sin(np.arange(T) / 50), -20, 5)
    elif kind == "repeated":
        log["t"][50::7] = log["t"][49::7][: len(log["t"][50::7])]
    elif kind == "late":
        log["t"][[120, 121]] = log["t"][[121, 120]]
    else:
        log["q"] = np.sin(log["t"][:, None] + np.arange(2))
        log["t"] = log["t"] + np.random.default_rng(1).uniform(0, 0.003, T)
    return log


@pytest.mark.parametrize("kind", ["stuck", "clipped", "repeated", "late", "scattered"])
def test_parts_are_repaired_as_the_whole(tmp_path, setup, kind, monkeypatch):
    monkeypatch.setattr(parts, "LONG", 300)
    np.savez(tmp_path / "log.npz", **spoilt(kind))
    opened, whole = open_log(tmp_path / "log.npz", setup), read_log(tmp_path / "log.npz", setup)
    assert len(whole.repairs) == 1
    assert opened.repairs == whole.repairs
    for got, expected in zip(joined(opened, 33)[:6], whole[:6], strict=True):
        np.testing.assert_array_equal(got, expected)
