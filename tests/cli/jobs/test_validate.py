import sys

import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.validation import protocols


@pytest.fixture(autouse=True)
def quiet(monkeypatch):
    monkeypatch.setattr("ftbias_jax.runtime.jax_config.prepare_jax", lambda: None)


def test_make_writes_a_set_and_refuses_to_mix_two(tmp_path, capsys):
    pytest.importorskip("mujoco", reason="the extra 'validation' is not installed")
    out = tmp_path / "new" / "set"
    command = ["validate", "make", str(out), "--count", "2", "--duration", "2,3", "--rate", "100", "--effects", "gain"]
    assert main(command) == 0
    assert sorted(path.name for path in out.iterdir()) == [
        *(f"log_00{i}.{end}" for i in range(2) for end in ("npz", "toml")),
        "truth.json",
    ]
    assert capsys.readouterr().out == f"wrote 2 logs with their setups and truth.json to {out}\n"
    assert main(command) == 1
    assert "holds a set already" in capsys.readouterr().err


def test_make_writes_pairs_of_unlisted_kinds(tmp_path, capsys):
    pytest.importorskip("mujoco", reason="the extra 'validation' is not installed")
    out = tmp_path / "set"
    command = ["validate", "make", str(out), "--protocol", "unlisted", "--kinds", "unseen", "--count", "1"]
    assert main([*command, "--duration", "2", "--rate", "100"]) == 0
    assert sorted(str(path.relative_to(out)) for path in out.rglob("*") if path.is_file()) == sorted(
        f"{place}{name}"
        for place in ("", "second/")
        for name in ("extra/log_000.npz", "log_000.npz", "log_000.toml", "truth.json")
    )
    assert capsys.readouterr().out == f"wrote 1 pairs of logs with their setups and truth.json to {out}\n"
    assert main(command) == 1
    assert "holds a set already" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "field"), [("--kinds all", "--kinds"), ("--protocol unlisted --effects gain", "--effects")]
)
def test_make_refuses_an_option_of_the_other_protocol(tmp_path, capsys, options, field):
    assert main(["validate", "make", str(tmp_path / "set"), *options.split()]) == 2
    assert f"{field}: says nothing to the protocol" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_make_refuses_effects_that_nobody_knows(tmp_path, capsys):
    pytest.importorskip("mujoco", reason="the extra 'validation' is not installed")
    assert main(["validate", "make", str(tmp_path / "set"), "--effects", "gain,tool_mas"]) == 2
    assert "--effects: no effect is called 'tool_mas'" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_without_mujoco_one_line_says_how_to_get_it(tmp_path, monkeypatch, capsys):
    for name in [name for name in sys.modules if name.startswith("ftbias_jax.validation.generator.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["validate", "make", str(tmp_path / "set")]) == 1
    printed = capsys.readouterr().err
    assert (
        printed == "ftbias: making logs needs mujoco, which is not installed (pip install 'ftbias-jax[validation]')\n"
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("option", ["--count 0", "--count x", "--duration 5,-1", "--rate nan", "--jobs 0"])
def test_numbers_are_checked(capsys, option):
    with pytest.raises(SystemExit) as end:
        main(["validate", "make", "set", *option.split()])
    assert end.value.code == 2


@pytest.mark.parametrize(
    ("options", "protocol", "verdicts", "score"),
    [
        ("", "withheld", "verdicts", "verdicts/score.json"),
        ("--leave-one-out", "leave_one_out", "verdicts_without", "verdicts_without/score.json"),
        ("--out mine --json score.json --jobs 3", "withheld", "mine", "score.json"),
    ],
)
def test_score_prints_and_writes(make_set, monkeypatch, capsys, options, protocol, verdicts, score):
    folder = make_set({"log_000": {}})
    monkeypatch.chdir(folder)
    calls = []

    def stand_in(folder, logs, out, jobs):
        calls.append((out, jobs, [log.name for log in logs]))
        out.mkdir()
        return protocols.Score("the table", {"logs": 1}, {"log_000": "it broke"})

    monkeypatch.setattr(protocols, protocol, stand_in)
    assert main(["validate", "score", ".", *options.split()]) == 1
    printed = capsys.readouterr()
    assert printed.out.startswith(f"the table\nwrote {score}; ")
    assert printed.err == "warning: log_000: no diagnosis: it broke\n"
    assert (folder / score).read_text() == '{\n "logs": 1\n}\n'
    ((out, jobs, logs),) = calls
    assert (out.name, jobs, logs) == (verdicts, 3 if "jobs" in options else 1, ["log_000.npz"])


def test_the_former_name_works_and_says_the_new_one(capsys):
    with pytest.raises(SystemExit):
        main(["blind", "make", "--help"])
    printed = capsys.readouterr()
    assert printed.err == "warning: 'blind' is now called 'validate'\n"
    assert "ftbias validate make" in printed.out
