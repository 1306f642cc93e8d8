"""Both protocols on made-up diagnoses: the inputs of a diagnosis, what is kept, and the tables."""

import json

import pytest

from ftbias_jax.errors import LogError
from validation import protocols, runs
from validation.labels import read_labels

SET = {
    "log_000": {"tool_mass": {"mass": 1.0}},
    "log_001": {},
    "log_002": {"slosh": {}},
    "log_003": {"tool_mass": {"mass": 1.1}, "time_delay": {"delay": 0.1}},
    "log_004": {"time_delay": {"delay": 0.02}},
}
ANSWERS = {
    "log_000": ("explained", ["tool_mass"]),
    "log_001": ("explained", ["gain"]),
    "log_002": ("unknown", []),
    "log_003": ("partly_explained", ["time_delay"]),
    "log_004": ("explained", ["cable"]),
}


@pytest.fixture
def asked(monkeypatch, make_said):
    """Inputs of the diagnosis for each log; it answers from ANSWERS and fails on a log that is not there."""
    calls = []

    def diagnose(setup, logs, names, without=()):
        calls.append((setup, logs, names, without))
        verdict, causes = ANSWERS[logs[0].removesuffix(".npz")]
        return make_said(verdict, *causes, shrink=0.97 if causes else 0.0)

    monkeypatch.setattr(runs, "diagnose", diagnose)
    monkeypatch.setattr(runs, "to_json", lambda made: made)
    monkeypatch.setattr(runs, "load_setup", lambda path: path.name)
    monkeypatch.setattr(runs, "read_log", lambda path, setup, raw: path.name)
    return calls


def run(protocol, folder, jobs=1):
    return protocol(folder, runs.find_logs(folder), folder / "verdicts", jobs)


def test_a_diagnosis_is_told_log_and_setup_alone(make_set, asked):
    run(protocols.withheld, make_set(SET))
    assert asked == [(f"{name}.toml", [f"{name}.npz"], [f"{name}.npz"], ()) for name in SET]


def test_labels_are_opened_after_all_diagnoses(make_set, asked):
    folder = make_set(SET, truth=False)
    with pytest.raises(LogError, match=r"truth\.json: cannot be read"):
        run(protocols.withheld, folder)
    assert sorted(path.name for path in (folder / "verdicts").iterdir()) == [f"{name}.json" for name in SET]


def test_the_score(make_set, asked):
    score = run(protocols.withheld, make_set(SET))
    assert score.troubles == {}
    found = {name: (row["hits"], row["of"]) for name, row in score.content["score"].items()}
    assert found == {
        "right cause first": (1, 2),
        "false alarms on none": (1, 1),
        "unlisted: honest": (1, 1),
        "unlisted: confidently misnamed": (0, 1),
        "pairs: both named": (0, 1),
        "pairs: at least one named": (1, 1),
        "shrink within 0.05 of the oracle's": (1, 1),
        "parameters: truth within 3 sigma, all numbers": (0, 0),
        "parameters: truth within 3 sigma, each number": (0, 0),
        "faint, not counted: right": (0, 0),
    }
    assert {"true": "time_delay", "called": "cable", "logs": 1} in score.content["confusion"]
    assert [row["right"] for row in score.content["rows"]] == [True, False, True, False, False]
    assert score.content["seconds"]["longest"] < 10
    for words in ("right cause first", "1/2   50%", "unlisted: slosh", "none", "gain", "seconds a log: median"):
        assert words in score.text
    json.dumps(score.content, allow_nan=False)


def test_parameters_are_compared(make_set, asked, monkeypatch):
    cause = {"effect": "tool_mass", "parameters": {"mass": 1.02}, "stderr": {"mass": 0.01}}
    monkeypatch.setitem(ANSWERS, "log_000", ("explained", [cause]))
    content = run(protocols.withheld, make_set(SET)).content
    (row,) = content["parameters"]
    assert (row["effect"], row["parameter"], row["diagnoses"]) == ("tool_mass", "mass", 1)
    assert row["median_error"] == pytest.approx(0.02)
    assert row["median_error_in_stderr"] == pytest.approx(2.0)
    assert content["score"]["parameters: truth within 3 sigma, all numbers"]["hits"] == 1


def test_verdicts_that_are_there_are_kept(make_set, asked, make_said):
    folder = make_set(SET)
    (folder / "verdicts").mkdir()
    (folder / "verdicts" / "log_004.json").write_text(json.dumps(make_said("explained", "time_delay")))
    assert run(protocols.withheld, folder).content["score"]["right cause first"]["hits"] == 2
    assert len(asked) == 4
    assert run(protocols.withheld, folder).content["score"]["right cause first"]["hits"] == 2
    assert len(asked) == 4


def test_a_log_that_breaks_the_diagnosis_is_told_and_counts_as_wrong(make_set, asked, monkeypatch):
    monkeypatch.delitem(ANSWERS, "log_000")
    folder = make_set(SET)
    score = run(protocols.withheld, folder)
    assert set(score.troubles) == {"log_000"}
    assert score.troubles["log_000"].startswith("KeyError: 'log_000' (test_protocols.py, line ")
    assert score.content["score"]["right cause first"]["hits"] == 0
    assert score.content["rows"][0]["verdict"] == "failed"
    assert not (folder / "verdicts" / "log_000.json").exists()


def test_several_processes_report_to_one(make_set):
    """Their setups are empty, and separate processes use no stand-in that would hide this."""
    folder = make_set({"log_000": {}, "log_001": {}, "log_002": {}})
    score = run(protocols.withheld, folder, jobs=2)
    assert sorted(score.troubles) == ["log_000", "log_001", "log_002"]
    assert all(trouble.startswith("SetupError: ") for trouble in score.troubles.values())
    assert score.content["score"]["false alarms on none"]["hits"] == 3


def test_a_log_whose_process_was_killed_costs_no_other(make_set, asked, monkeypatch):
    def some(work, tasks, jobs):
        return ((task, None if task.log.stem == "log_000" else work(task)) for task in tasks)

    monkeypatch.setattr(runs, "run_each", some)
    score = run(protocols.withheld, make_set(SET), jobs=2)
    assert set(score.troubles) == {"log_000"}
    assert "its process was killed" in score.troubles["log_000"]
    assert score.content["rows"][0]["verdict"] == "failed"


def test_leaving_one_out_tells_the_diagnosis_what_not_to_name(make_set, asked):
    score = run(protocols.leave_one_out, make_set(SET))
    assert [(names, without) for _, _, names, without in asked] == [
        (["log_000.npz"], ("tool_mass",)),
        (["log_004.npz"], ("time_delay",)),
    ]
    # The made-up diagnosis names tool_mass, which is no twin of itself, and cable.
    assert [row["outcome"] for row in score.content["rows"]] == ["wrong", "wrong"]
    assert score.content["score"]["confident wrong name"]["hits"] == 2
    assert score.content["score"]["wrong name among the causes of any verdict"]["hits"] == 2
    assert score.content["by_effect"] == {"tool_mass": {"wrong": 1}, "time_delay": {"wrong": 1}}
    assert {"left_out": "time_delay", "called": "cable", "logs": 1} in score.content["confusion"]
    assert "unknown, described, partly explained or a twin" in score.text
    assert "confident wrong names" in score.text


def test_a_folder_without_logs_or_setups_is_refused(tmp_path, make_set):
    with pytest.raises(LogError, match="has no logs"):
        runs.find_logs(tmp_path)
    folder = make_set(SET)
    (folder / "log_002.toml").unlink()
    with pytest.raises(LogError, match=r"log_002\.npz: has no setup"):
        runs.find_logs(folder)


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"log_000": {}}', '{"log_000": {"effects": [], "sigma": 1}}'])
def test_labels_that_are_none_are_refused(tmp_path, text):
    (tmp_path / "truth.json").write_text(text)
    with pytest.raises(LogError, match=r"truth\.json"):
        read_labels(tmp_path, ["log_000"])


@pytest.mark.parametrize("text", ["", "[]", '{"verdict": 1, "causes": []}', '{"verdict": "none", "causes": [{}]}'])
def test_verdicts_that_are_none_are_refused(make_set, asked, text):
    folder = make_set(SET)
    (folder / "verdicts").mkdir()
    (folder / "verdicts" / "log_001.json").write_text(text)
    with pytest.raises(LogError, match=r"log_001\.json: is no diagnosis"):
        run(protocols.withheld, folder)
