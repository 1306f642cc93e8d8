import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import jax
import pytest

from ftbias_jax.runtime import jax_config
from ftbias_jax.runtime.compiled_loops import on_cpu
from ftbias_jax.runtime.jax_config import accelerator, cache_folder, in_float64, prepare_jax, same_precision

CACHE = "jax_compilation_cache_dir"
ALWAYS = {"jax_enable_x64": True, "jax_platforms": "cpu"}


@pytest.fixture
def updates(monkeypatch):
    """The settings that would be made; those of the process stay."""
    made = {}
    # An earlier command in this process may have chosen a cache.
    config = SimpleNamespace(
        update=lambda name, value: made.update({name: value}),
        jax_compilation_cache_dir=None,
        jax_enable_compilation_cache=True,
    )
    monkeypatch.setattr(jax_config, "jax", SimpleNamespace(config=config, devices=list))
    for name in ("FTBIAS_CACHE", "JAX_PLATFORMS"):
        monkeypatch.delenv(name, raising=False)
    return made


def test_the_cache_is_the_user_s(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg" / "ftbias"
    monkeypatch.setenv("HOME", str(tmp_path))
    for not_a_place in ("", "relative"):  # to be ignored according to the XDG specification
        monkeypatch.setenv("XDG_CACHE_HOME", not_a_place)
        assert cache_folder() == Path(tmp_path) / ".cache" / "ftbias"


def test_double_precision_and_a_cache_are_set(tmp_path, monkeypatch, updates):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    prepare_jax()
    assert updates["jax_enable_x64"] is True
    assert updates[CACHE] == str(tmp_path / "ftbias" / "jax")
    assert Path(updates[CACHE]).is_dir()
    assert updates["jax_persistent_cache_min_compile_time_secs"] == jax_config.MIN_COMPILE_SECONDS


@pytest.mark.parametrize("device", ["cuda,cpu", "cpu"])
def test_a_device_that_the_environment_names_stays(monkeypatch, updates, device):
    monkeypatch.setenv("FTBIAS_CACHE", "off")
    monkeypatch.setenv("JAX_PLATFORMS", device)
    prepare_jax()
    assert updates == {"jax_enable_x64": True}


@pytest.mark.parametrize("chosen", [False, True])
def test_where_jax_has_an_accelerator_a_verb_computes_there_only_if_it_is_told_to(monkeypatch, chosen):
    monkeypatch.setattr(jax_config, "on_cpu", lambda: False)
    monkeypatch.setattr(jax_config, "_is_chosen", lambda: chosen)
    processor = jax.devices("cpu")[0]
    told = in_float64(lambda: jax.config.jax_default_device)
    assert told() is (None if chosen else processor)
    in_thread = in_float64(lambda: same_precision(lambda: jax.config.jax_default_device))()
    with ThreadPoolExecutor(1) as pool:
        assert pool.submit(in_thread).result() is told()


def test_the_processor_is_known_by_what_was_chosen():
    assert on_cpu()
    with jax.default_device("cpu"):
        assert on_cpu()
        assert accelerator() is None
    with jax.default_device("gpu"):
        assert not on_cpu()
        assert accelerator() == "gpu"


def test_where_no_folder_can_be_made_there_is_no_cache(tmp_path, monkeypatch, updates):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    prepare_jax()
    assert updates == ALWAYS


@pytest.mark.parametrize("word", ["off", "OFF"])
def test_the_cache_can_be_switched_off(tmp_path, monkeypatch, updates, word):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setenv("FTBIAS_CACHE", word)
    prepare_jax()
    assert updates == ALWAYS
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("decided", [{CACHE: "elsewhere"}, {"jax_enable_compilation_cache": False}])
def test_what_jax_was_told_about_its_cache_stays(tmp_path, monkeypatch, updates, decided):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    for name, value in decided.items():
        monkeypatch.setattr(jax_config.jax.config, name, value)
    prepare_jax()
    assert updates == ALWAYS


def _make_sparse(path):
    path.touch()
    os.truncate(path, 10 << 30)


@pytest.mark.parametrize("spoil", [os.mkfifo, _make_sparse])
def test_a_cache_with_what_is_no_program_is_not_used(tmp_path, monkeypatch, updates, spoil):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = tmp_path / "ftbias" / "jax"
    folder.mkdir(parents=True)
    (folder / "jit_sound").touch()
    (folder / "ftbias").mkdir()
    prepare_jax()
    assert CACHE in updates
    updates.clear()
    spoil(folder / "jit_odd")
    prepare_jax()
    assert updates == ALWAYS
