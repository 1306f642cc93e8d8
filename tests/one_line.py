"""Errors that a user can fix: one line that begins with the place, and has a remedy."""

import pytest

from ftbias_jax.errors import LogError
from ftbias_jax.io import read_log


def fails(call, place, *words, kind=LogError):
    """Check that a call raises an error of this kind, whose line has all the words."""
    with pytest.raises(kind) as caught:
        call()
    message = str(caught.value)
    assert message.startswith(f"{place}: ")
    assert "\n" not in message
    assert caught.value.remedy
    for word in words:
        assert word in message


def reading_fails(path, setup, *words):
    """Check that a log cannot be read, and that the line names it."""
    fails(lambda: read_log(path, setup), path, *words)
