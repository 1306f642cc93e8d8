"""``ftbias effects``."""

import own_effects
import pytest

from ftbias_jax.cli.main import main
from ftbias_jax.model.effects.catalogue import CATALOGUE


@pytest.fixture
def file(tmp_path, monkeypatch):
    monkeypatch.setattr("ftbias_jax.runtime.jax_config.prepare_jax", lambda: None)
    path = tmp_path / "my_effects.py"
    path.write_text(own_effects.HOSE)
    return str(path)


def test_it_lists_all_with_ones_own(file, capsys):
    assert main(["effects", "--effects", file]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert {line.split()[0] for line in lines} == {*CATALOGUE, "hose_drag"}
    assert next(line for line in lines if line.startswith("hose_drag")).endswith("(your own)")


def test_it_describes_units_bounds_and_twins(file, capsys):
    assert main(["effects", "gain"]) == 0
    out = capsys.readouterr().out
    assert "gain [1]: reading per load, channel by channel" in out
    assert "6 numbers; from 0.01 to 100; does nothing at 1; typically off by 0.02" in out
    assert "is indistinguishable from tool_mass: equal gains are a scaling of the whole tool" in out


def test_a_name_that_is_not_there_is_refused(file, capsys):
    assert main(["effects", "gian"]) == 2
    assert "did you mean" in capsys.readouterr().err


def test_check_passes_what_is_in_order(file, capsys):
    assert main(["effects", "check", file]) == 0
    assert capsys.readouterr().out == "hose_drag: in order\n"


def test_check_tells_of_faults_and_fails(file, tmp_path, capsys):
    path = tmp_path / "broken.py"
    path.write_text(own_effects.HOSE.replace('values["coefficient"]', 'values["coeficient"]'))
    assert main(["effects", "check", str(path)]) == 1
    assert "effect 'hose_drag': its code raises KeyError: 'coeficient'" in capsys.readouterr().err


def test_check_without_a_file_is_refused(capsys):
    assert main(["effects", "check"]) == 2
    assert "needs the file to check" in capsys.readouterr().err
