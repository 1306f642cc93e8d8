"""Manifests that were damaged or edited: every line is read or counted, and the page and the table can be made."""

import copy
import json
import random
import warnings

import made_fleets
import pytest

from ftbias_jax.errors import FtbiasError
from ftbias_jax.fleet.alarms import alarms_of
from ftbias_jax.fleet.history import read_fleet
from ftbias_jax.fleet.manifest import read_manifests
from ftbias_jax.fleet.page import to_page
from ftbias_jax.fleet.table import save_table

VALUES = (
    None, True, -1, 0, 2**63 - 1, -(2**63) + 1, 2**63, 10**25, 10**400, 1e99, -1e99, 5e-324, 1e308, float("inf"),
    float("nan"), "", "x", "\x1b[2J", "\0", "\udce9", "\ud800", "<b>", "../a", "/etc/passwd", [], [[]], {}, {"a": []},
    "0001-01-01T00:00:00+14:00", "9999-12-31T23:59:59.999-14:00", "1970-01-01", "2026-02-30", "2026-11-23T05:00:00",
    [0] * 6, [None] * 6, ["x"] * 6, [[1.0]] * 6, [1e99, -1e99] * 3, [5e-324] * 6, [True] * 6, ["a", "\ud800"], [1, "a"],
)  # fmt: skip


def places(content, path=()):
    """Paths of all values in nested tables and lists."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield (*path, key)
        yield from places(value, (*path, key))


def mutant(line, rng):
    """A line with another value, key or byte somewhere, or nested too deep."""
    content = copy.deepcopy(json.loads(line))
    *path, key = rng.choice(list(places(content)))
    inner = content
    for step in path:
        inner = inner[step]
    kind = rng.random()
    if kind < 0.75:
        inner[key] = rng.choice(VALUES)
    elif kind < 0.8:
        del inner[key]
    elif kind < 0.85 and isinstance(inner, dict):
        inner[rng.choice(("surprise", "\ud800", ""))] = rng.choice(VALUES)
    elif kind < 0.9:
        return f'{{"log": {"[" * 50_000}'.encode()
    else:
        raw = bytearray(line)
        raw[rng.randrange(len(raw))] = rng.randrange(256)
        return bytes(raw).replace(b"\n", b" ")
    return json.dumps(content).encode()


@pytest.fixture(scope="module")
def lines(tmp_path_factory):
    folder = made_fleets.write_fleet(tmp_path_factory.mktemp("fleet"), count=3)
    return [line for path in sorted(folder.rglob("*.jsonl")) for line in path.read_bytes().splitlines()]


@pytest.mark.parametrize("seed", range(40))
def test_mutants_of_lines_are_read_or_counted_and_have_a_page_and_a_table(lines, tmp_path, seed):
    """Fifteen mutants at a time, each among intact lines and other mutants."""
    rng = random.Random(seed)
    mutants = [mutant(rng.choice(lines), rng) for _ in range(15)]
    (tmp_path / "manifest.filter.jsonl").write_bytes(b"\n".join([*lines, *mutants]))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        contents = read_manifests(str(tmp_path))
        assert len(contents.entries) >= 6  # the intact ones
        assert contents.damaged <= 15
        save_table(str(tmp_path / "table.parquet"), list(contents.entries.values()), contents.settings)
        try:
            fleet = read_fleet([str(tmp_path)])
        except FtbiasError:
            return
        to_page(fleet, "fleet", "").encode()
        assert all(alarm.text for records in fleet.by_robot().values() for alarm in alarms_of(records))
