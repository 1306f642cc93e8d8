import pytest

from ftbias_jax.setup import Setup, parse_setup


@pytest.fixture(scope="session")
def setup() -> Setup:
    """The arm that ``recordings`` records: joints base and elbow."""
    joints = [
        {"axis": [0, 0, 1], "point": [0, 0, 0], "name": "base"},
        {"axis": [0, 1, 0], "point": [0, 0, 0.5], "name": "elbow"},
    ]
    return parse_setup(
        {
            "robot": {"joints": joints, "flange": {"translation": [0, 0, 1]}},
            "sensor": {"noise_std": [0.1, 0.004]},
            "tool": {"mass": 0.7, "center_of_mass": [0, 0, 0.06]},
        }
    )
