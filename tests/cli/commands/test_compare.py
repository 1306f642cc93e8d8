import json

import numpy as np
import pytest

from ftbias_jax.cli.main import main

SETUP = '[robot]\nmodel = "panda"  # {}\n[sensor]\nnoise_std = 0.1\n[tool]\nmass = {}\ncenter_of_mass = [0, 0, 0.06]\n'


def run(capsys, *paths):
    code = main(["compare", *map(str, paths)])
    return code, capsys.readouterr().out.splitlines()


def test_setups_are_compared_by_what_they_say(tmp_path, capsys):
    for name, words in (("a", ("one", 0.7)), ("b", ("two", 0.70)), ("c", ("one", 0.9))):
        (tmp_path / f"{name}.toml").write_text(SETUP.format(*words))
    assert run(capsys, tmp_path / "a.toml", tmp_path / "b.toml") == (0, ["no difference"])
    assert run(capsys, tmp_path / "a.toml", tmp_path / "c.toml") == (1, ["[tool] mass: 0.7 -> 0.9"])


def test_results_are_compared_array_by_array(tmp_path, capsys):
    t, bias = np.arange(4.0), np.zeros((4, 6))
    np.savez(tmp_path / "a.npz", t=t, bias=bias, only=t)
    bias[0, 0] = 2.0
    np.savez(tmp_path / "b.npz", t=t, bias=bias)
    code, lines = run(capsys, tmp_path / "a.npz", tmp_path / "b.npz")
    assert code == 1
    assert lines == ["bias: differs by 0.408 rms, 2 at most", f"only: only in {tmp_path / 'a.npz'}"]
    assert run(capsys, tmp_path / "a.npz", tmp_path / "a.npz") == (0, ["no difference"])


def test_diagnoses_are_compared_value_by_value(tmp_path, capsys):
    one = {"verdict": "none", "causes": [], "gap": {"after": 1.0}}
    two = {"verdict": "explained", "causes": [{"effect": "gain"}], "gap": {"after": 1.0}}
    for name, content in (("a", one), ("b", two)):
        (tmp_path / f"{name}.json").write_text(json.dumps(content))
    code, lines = run(capsys, tmp_path / "a.json", tmp_path / "b.json")
    assert code == 1
    assert lines == ['verdict: "none" -> "explained"', 'causes[0].effect: not stated -> "gain"']


@pytest.mark.parametrize(
    ("names", "code", "words"),
    [
        (("a.toml", "b.npz"), 2, "cannot be compared"),
        (("a.txt", "b.txt"), 2, "cannot be compared"),
        (("a.json", "b.json"), 1, "cannot be read"),
    ],
)
def test_what_cannot_be_compared_is_told_in_one_line(tmp_path, capsys, names, code, words):
    assert main(["compare", *(str(tmp_path / name) for name in names)]) == code
    printed = capsys.readouterr()
    assert words in printed.err
    assert printed.err.count("\n") == 1


def test_a_shell_learns_the_commands(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--print-completion", "bash"])
    assert ended.value.code == 0
    script = capsys.readouterr().out
    assert "compare" in script
    assert "--robot" in script
