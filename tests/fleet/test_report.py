"""A fleet's page: what it states about robots over months; it loads nothing and runs nothing."""

import json
import re
from pathlib import Path

import fsspec
import made_fleets
import numpy as np
import pytest
from pages import Page

from ftbias_jax.cli.main import main
from ftbias_jax.errors import UsageError
from ftbias_jax.fleet.alarms import alarms_of
from ftbias_jax.fleet.entry import FAILED, OK, Entry, LogState, Settings
from ftbias_jax.fleet.history import read_fleet
from ftbias_jax.fleet.manifest import Manifest
from ftbias_jax.fleet.page import to_page
from ftbias_jax.fleet.place import Place
from ftbias_jax.fleet.plots import date_ticks


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return made_fleets.write_fleet(tmp_path_factory.mktemp("fleet"))


@pytest.fixture(scope="module")
def fleet(folder):
    return read_fleet([str(folder)])


def test_entries_of_several_commands_are_one_record_a_log(fleet):
    groups = fleet.by_robot()
    assert {group: len(records) for group, records in groups.items()} == {made_fleets.CALM: 60, made_fleets.AGEING: 60}
    last = groups[made_fleets.AGEING][-1]
    assert (last.verdict, last.words("causes"), last.dated) == ("explained", ("tool_mass",), True)
    assert last.numbers("bias")[2] == pytest.approx(5.0, abs=0.5)
    assert np.isnan(last.numbers("drift")).all()
    dates = [record.date for record in fleet.records]
    assert dates == sorted(dates)


def test_a_bias_that_ages_and_a_cause_that_appears_are_alarms(fleet):
    groups = fleet.by_robot()
    assert alarms_of(groups[made_fleets.CALM]) == []
    ages, cause = alarms_of(groups[made_fleets.AGEING])
    assert (ages.kind, ages.about) == ("ages", "fz")
    assert float(re.search(r"([+-][\d.]+) ±", ages.text)[1]) == pytest.approx(2.0 / 6, abs=0.05)  # N in 30 days
    assert (cause.kind, cause.about) == ("appears", "tool_mass")
    assert "in 0 of 31 logs before, in 29 of 29 since" in cause.text


def test_predictions_that_get_worse_are_an_alarm(tmp_path):
    rng = np.random.default_rng(0)
    with Manifest(str(tmp_path / "manifest.filter.jsonl")) as manifest:
        for i in range(40):
            quality = {"one_second_error": [0.1 * float(np.exp(0.02 * i + 0.1 * rng.normal()))] * 6}
            state = LogState(1, 10**18 + i * 10**14, 0, str(i))
            manifest.add_entry(Entry("log", f"{i}.npz", state=state, quality=quality))
    fleet = read_fleet([str(tmp_path)])
    kinds = [(alarm.kind, alarm.about) for alarm in alarms_of(fleet.records)]
    assert kinds == [("worse", "force"), ("worse", "torque")]
    assert not fleet.records[0].dated


def test_the_page_is_whole_and_runs_and_loads_nothing(fleet):
    page = Page(text := to_page(fleet, "<b>fleet</b>", ""))
    assert {"script", "link", "img", "iframe"} & set(page.tags) == set()
    assert len(ids := page.values("id")) == len(set(ids))
    assert "default-src 'none'" in text
    assert "http://" not in text.replace("http://www.w3.org", "")
    assert "<b>fleet</b>" not in text  # the title is escaped
    assert "is not an NPZ file &lt;cut&gt;" in text
    for words in ("2 alarms", "the bias of fz ages", "cell 2, sensor FT-02, over time", "tool_mass (29)", "29 of 60"):
        assert words in text


@pytest.mark.parametrize(
    ("status", "quality", "words", "quiet"),
    [
        (OK, {"verdict": "none"}, "No alarm", True),
        (OK, {"nis": 1.0}, "No alarm; no log was diagnosed", True),
        (OK, {"verdict": "unknown"}, "1 log with a gap", False),
        (FAILED, {}, "1 log failed", False),
    ],
)
def test_the_headline_is_quiet_only_where_no_log_failed_or_has_a_gap(tmp_path, status, quality, words, quiet):
    with Manifest(str(tmp_path / "manifest.diagnose.jsonl")) as manifest:
        state = LogState(1, 10**18, 0, "sum")
        manifest.add_entry(Entry("log", "log.json", "diagnose", status, state=state, quality=quality))
    text = to_page(read_fleet([str(tmp_path)]), "fleet", "")
    assert f"<h1>{words}</h1>" in text
    assert ("<header class='quiet'>" in text) == quiet
    assert "<dd>2001-09-09 (files)</dd>" in text


def test_dates_come_from_the_stamps_of_logs_where_there_are_some(tmp_path):
    with Manifest(str(tmp_path / "manifest.filter.jsonl")) as manifest:
        for day, quality in ((1, {"date": "2026-03-14T08:00:00+00:00"}), (2, {})):
            state = LogState(1, 10**18, 0, str(day))
            manifest.add_entry(Entry(f"{day}", f"{day}.npz", status=OK, state=state, quality=quality))
    text = to_page(read_fleet([str(tmp_path)]), "fleet", "")
    assert "<dd>2026-03-14</dd>" in text
    assert "2001-09-09" not in text


def test_damaged_lines_are_told(tmp_path, capsys):
    with Manifest(str(tmp_path / "manifest.filter.jsonl")) as manifest:
        manifest.add_entry(Entry("log", "log.npz", status=OK, state=LogState(1, 10**18, 0, "")))
        manifest.add("log", {"log": [[]]})
        manifest.add("settings", {"job": 1})
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "page.html")]) == 0
    assert "warning: 2 lines of the manifest could not be read" in capsys.readouterr().err
    assert "2 lines of the manifest could not be read." in (tmp_path / "page.html").read_text()


def test_every_drawing_has_words_for_who_cannot_see_it(fleet):
    text = to_page(fleet, "fleet", "")
    assert text.count("<svg ") == text.count('role="img"') == text.count("<desc ") >= 24


def test_a_log_leads_to_the_report_of_its_diagnosis(folder):
    place = folder / "cell_2"
    (place / "059.html").write_text("")
    assert main(["report", str(folder), "-o", str(place / "059.html")]) == 2  # it would be overwritten
    assert (place / "059.html").read_text() == ""
    text = to_page(read_fleet([str(folder)]), "fleet", str(folder / "pages"))
    assert '<a href="../cell_2/059.html">logs/cell 2/059.npz</a>' in text
    (place / "059.html").unlink()


def test_a_log_in_a_bucket_leads_to_its_report_there(capsys):
    memory = fsspec.filesystem("memory")
    bucket = Place("memory://fleet/cell 2")
    gap = Entry("log", "059.json", "diagnose", OK, state=LogState(1, 10**18, 0, ""), quality={"verdict": "unknown"})
    with bucket.growing("manifest.diagnose.jsonl") as growing, Manifest(*growing) as manifest:
        manifest.add_entry(gap)
    memory.pipe("/fleet/cell 2/059.html", b"")
    fleet = read_fleet(["memory://fleet"])
    assert fleet.folders == ("memory://fleet/cell 2",)
    assert '<a href="../cell%202/059.html">log</a>' in to_page(fleet, "fleet", "memory://fleet/pages")
    assert '<a href="memory://fleet/cell%202/059.html">log</a>' in to_page(fleet, "fleet", "pages")
    assert main(["report", "memory://fleet", "-o", "memory://fleet/cell 2/059.html"]) == 2  # it would be overwritten
    assert "is the same file as the input" in capsys.readouterr().err
    memory.rm("/fleet", recursive=True)


def test_many_logs_make_no_long_page(tmp_path):
    """Dots are thinned and tables are truncated: a page for people, not a copy of the manifest."""
    settings = Settings("filter", "x", {}, "1", "setup.toml", "arm")
    with Manifest(str(tmp_path / "manifest.filter.jsonl")) as manifest:
        manifest.add("settings", settings._asdict())
        for i in range(5000):
            state = LogState(1, 10**18 + i * 10**12, 0, str(i))
            quality = {"nis": i % 7, "bias": [i % 5] * 6, "verdict": "unknown", "gap_sigmas": 2.0}
            manifest.add_entry(Entry(f"{i}.npz", f"{i}.npz", settings=settings.key, state=state, quality=quality))
    text = to_page(read_fleet([str(tmp_path)]), "fleet", "")
    assert len(text) < 500_000
    assert "4800 logs with smaller gaps are in the manifest" in text


def test_the_command_writes_the_page_and_tells_the_alarms(folder, tmp_path, capsys):
    page = tmp_path / "page.html"
    assert main(["report", str(folder), "-o", str(page)]) == 0
    assert page.read_text().startswith("<!DOCTYPE html>")
    assert "120 logs of 2 robots, 2 alarms" in capsys.readouterr().out


def test_folders_without_a_manifest_are_refused(tmp_path, capsys):
    with pytest.raises(UsageError, match="no manifest in"):
        read_fleet([str(tmp_path)])
    (tmp_path / "manifest.filter.jsonl").write_text("{\n" + json.dumps({"run": {}}))
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "page.html")]) == 2
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "page.txt")]) == 2
    assert [path.name for path in Path(tmp_path).iterdir()] == ["manifest.filter.jsonl"]
    capsys.readouterr()


@pytest.mark.parametrize("days", [0.01, 0.2, 3, 20, 100, 400, 2000, 9000])
def test_dates_on_the_axis_are_few_and_round(days):
    low = 1_767_600_000.0
    ticks = date_ticks(low, low + days * 86400, 5)
    assert 1 <= len(ticks) <= 6
    assert all(low <= stamp <= low + days * 86400 for stamp, _ in ticks)
    assert len({words for _, words in ticks}) == len(ticks)


def test_a_cause_that_logs_show_together_is_an_alarm_of_its_robot(folder, tmp_path, capsys):
    dates = made_fleets.START.timestamp() + 86400 * np.arange(20.0)
    course = {
        "effect": "mount_rotation",
        "begins": "growing",
        "since": dates[12],
        "earliest": dates[10],
        "latest": dates[13],
        "dates": dates.tolist(),
        "share": np.clip(np.arange(-11, 9) / 8, 0, None).tolist(),
        "stderr": [0.1] * 20,
        "before": 0.01,
        "scatter": 0.1,
    }
    paths = {name: folder / "cell_1" / f"{name}.pooled.json" for name in ("cell 1", "cell 9")}
    for name, path in paths.items():
        path.write_text(json.dumps({"provenance": {"setup": {"name": f"{name}.toml"}}, "courses": [course]}))
    try:
        assert main(["report", str(folder), "-o", str(tmp_path / "page.html")]) == 0
    finally:
        for path in paths.values():
            path.unlink()
    words = "mount_rotation: since 2026-01-17 (95 %: 2026-01-15 to 2026-01-18), growing since, 1 % of it before"
    text = capsys.readouterr().out
    assert f"cell 1, sensor FT-01: logs together show {words}" in text
    assert f"cell 9.toml: logs together show {words}" in text  # a robot without a result of any log
    text = (tmp_path / "page.html").read_text()
    assert words in text
    assert "mount_rotation, share of what it is in the latest logs" in text
