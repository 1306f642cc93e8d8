"""What ``diagnose --apply`` says about the setup that it wrote."""

import pytest

import ftbias_jax as ft
from ftbias_jax.cli.commands import demo
from ftbias_jax.cli.main import main


@pytest.mark.parametrize(("effect", "said"), [("bias_jump", True), ("tool_mass", False)])
def test_times_of_these_logs_are_told(effect, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    setup = ft.parse_setup(demo.SETUP)
    setup.save("setup.toml")
    ft.simulate(setup, {effect: {}}, duration=20, rate=200, seed=4).save("log.npz")
    assert main(["diagnose", "log.npz", "--setup", "setup.toml", "--apply", "-o", "fixed.toml", "--force"]) == 0
    output = capsys.readouterr()
    assert effect in output.out
    assert ("bias_jump has times of these logs, so that this setup fits no others" in output.err) == said
