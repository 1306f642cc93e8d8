"""The demonstration as a newcomer runs it, but shorter: what it prints must be true."""

import re
import tomllib

import numpy as np
import pytest

from ftbias_jax.cli.commands.demo import SETUP, TRUE_MASS
from ftbias_jax.cli.main import main
from ftbias_jax.io.write import npz


def rows_of(printed):
    """Name -> (6,) numbers of the table of errors with respect to the truth."""
    lines = [line for line in printed.splitlines() if re.match(r"(error|inside) ", line)]
    cells = (re.split(" {2,}", line) for line in lines)
    return {name: np.array(numbers, float) for name, *numbers in cells}


@pytest.mark.slow
def test_the_diagnosis_finds_what_was_hidden_and_the_error_goes(tmp_path, capsys):
    assert main(["demo", "-o", str(tmp_path), "--duration", "20", "--rate", "200"]) == 0
    printed = capsys.readouterr().out
    assert re.search(r"The tool weighs 0\.9\d+ ± [\d.]+ kg, the setup says 0\.9 \(or ", printed)
    assert re.search(r"error falls from 0\.\d+ (Nm? )?to 0\.\d+ Nm?", printed)
    fixed = tomllib.loads((tmp_path / "fixed.toml").read_text())
    assert fixed["tool"]["mass"] == SETUP["tool"]["mass"]
    assert abs(fixed["effects"]["tool_mass"]["mass"] - TRUE_MASS) < 2e-3
    rows = rows_of(printed)
    assert np.linalg.norm(rows["error after"][:3]) < 0.1 * np.linalg.norm(rows["error before"][:3])
    assert rows["inside 2 sigma before"].mean() > 0.8  # the error bars include errors that are not explained yet
    assert rows["inside 2 sigma after"].mean() > 0.8
    assert "tool_mass" in (tmp_path / "report.html").read_text(encoding="utf-8")
    before, after = (npz.load_npz(tmp_path / f"{name}.npz") for name in ("before", "after"))
    assert after["log_likelihood"] > before["log_likelihood"]
