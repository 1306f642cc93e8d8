import pytest

from ftbias_jax.setup import Setup, parse_setup

TABLES = {
    "robot": {
        "joints": [
            {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "base"},
            {"axis": [0, 1, 0], "point": [0, 0, 0.5], "name": "elbow"},
        ],
        "flange": {"translation": [0, 0, 1]},
    },
    "sensor": {"noise_std": [0.1, 0.004]},
    "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
}


@pytest.fixture(scope="session")
def setup() -> Setup:
    """An arm of two joints, base and elbow."""
    return parse_setup(TABLES)


@pytest.fixture(scope="session")
def make_setup():
    """An arm of two joints, with sections of the setup replaced."""
    return lambda **sections: parse_setup({**TABLES, **sections})
