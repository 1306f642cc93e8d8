"""Garbage collection is off while a process imports its modules, and on afterwards."""

import gc
import sys

import pytest

from ftbias_jax.runtime.imports import many_imports


@pytest.fixture
def fresh(monkeypatch):
    """A process with few imports; objects that it freezes are unfrozen again."""
    monkeypatch.delitem(sys.modules, "jax")
    yield
    gc.unfreeze()


def test_nothing_is_collected_in_the_block_and_what_it_made_is_never_looked_at(fresh):
    with many_imports():
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0


def test_an_import_that_fails_leaves_the_search_on(fresh):
    with pytest.raises(ImportError), many_imports():
        raise ImportError
    assert gc.isenabled()


def test_a_process_that_has_imported_it_all_goes_on_as_it_was():
    frozen = gc.get_freeze_count()
    with many_imports():
        assert gc.isenabled()
    assert gc.get_freeze_count() == frozen
