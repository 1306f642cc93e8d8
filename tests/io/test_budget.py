"""The memory stated for a log applies to every format, and the error names how to allow more."""

import numpy as np
import pytest
from log_files import SUFFIXES, write
from small_archive import SETUP

from ftbias_jax.errors import LogError, SetupError, UsageError
from ftbias_jax.io import budget, read_log
from ftbias_jax.setup import load_setup

ROWS = 20_000


@pytest.fixture
def setup(tmp_path):
    (tmp_path / "setup.toml").write_text(SETUP)
    return load_setup(tmp_path / "setup.toml")


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_log_of_more_numbers_than_the_stated_memory_or_any_memory_is_refused(tmp_path, setup, monkeypatch, suffix):
    t = 0.001 * np.arange(ROWS)
    wrench = np.random.default_rng(0).normal(size=(ROWS, 6))
    path = write(tmp_path / f"log{suffix}", {"t": t, "q": np.sin(t)[:, None] * [1, 2], "wrench": wrench})
    assert len(read_log(path, setup).t) == ROWS
    monkeypatch.setenv("FTBIAS_MEMORY", "0.001")  # GiB, of which a third holds numbers: less than 9 columns
    with pytest.raises(LogError, match="GiB of memory are for 0 MiB") as error:
        read_log(path, setup)
    assert "FTBIAS_MEMORY" in error.value.remedy
    monkeypatch.delenv("FTBIAS_MEMORY")
    monkeypatch.setattr(budget, "MAX_BYTES", 100)
    with pytest.raises(LogError, match=r"100 bytes.*split"):
        read_log(path, setup)


@pytest.mark.parametrize("text", ["", "much", "-1", "nan", "inf"])
def test_a_memory_that_is_no_size_is_refused(monkeypatch, text):
    monkeypatch.setenv("FTBIAS_MEMORY", text)
    with pytest.raises(UsageError, match="FTBIAS_MEMORY"):
        budget.most_held()


def test_a_dotted_key_of_many_parts_is_refused_before_it_is_parsed(tmp_path):
    path = tmp_path / "deep.toml"
    path.write_text(".".join("a" * 50_000) + " = 1\n")
    with pytest.raises(SetupError, match="more than 32 parts"):
        load_setup(path)
    path.write_text("# " + "." * 500 + "\n" + SETUP)
    assert load_setup(path).tool.mass == 0.7
