"""Made-up labels, diagnoses and sets of logs, as fixtures for the tests of the validation."""

import json
from collections.abc import Callable

import numpy as np
import pytest

from validation.labels import Label

SIGMA = (0.1, 0.1, 0.1, 0.004, 0.004, 0.004)


def label(effects, gap_sigmas=2.0, **forms) -> Label:
    return Label(effects, forms, gap_sigmas, SIGMA)


def said(verdict, *causes, shrink=1.0, seconds=4.0):
    """A diagnosis as its JSON; a cause is a name, a tuple of a name and its twins, or a dict."""
    made = []
    for cause in causes:
        if not isinstance(cause, dict):
            name, *twins = (cause,) if isinstance(cause, str) else cause
            cause = {"effect": name, "indistinguishable_from": twins, "parameters": {}, "stderr": {}}
        made.append(cause)
    return {"verdict": verdict, "causes": made, "gap": {"shrink": shrink}, "seconds": seconds}


@pytest.fixture(scope="session")
def make_label() -> Callable[..., Label]:
    return label


@pytest.fixture(scope="session")
def make_said() -> Callable[..., dict]:
    return said


@pytest.fixture
def make_set(tmp_path) -> Callable[..., object]:
    """A folder of empty logs with setups and the given labels; their diagnosis is to be made up."""

    def make(labels: dict[str, dict], truth: bool = True):
        for name in labels:
            np.savez(tmp_path / f"{name}.npz")
            (tmp_path / f"{name}.toml").write_text("")
        entries = {
            name: {"effects": effects or {"none": {}}, "gap_sigmas": 2.0, "sigma": list(SIGMA)}
            for name, effects in labels.items()
        }
        if truth:
            (tmp_path / "truth.json").write_text(json.dumps(entries))
        return tmp_path

    return make
