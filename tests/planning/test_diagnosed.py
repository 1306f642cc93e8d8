import json

import numpy as np
import pytest

from ftbias_jax.errors import UsageError
from ftbias_jax.model.effects.catalogue import CATALOGUE
from ftbias_jax.planning.diagnosed import read_diagnosis


def test_it_has_the_sizes_of_effects_and_the_first_that_cannot_be_distinguished(tmp_path):
    causes = [{"effect": "tool_mass", "parameters": {"mass": 0.8}, "indistinguishable_from": ["unheard_of", "gain"]}]
    candidates = [
        {"effect": "gain", "parameters": {"gain": [1.1] * 6}},
        {"effect": "gain", "parameters": {"gain": [1.2] * 6}},
        {"effect": "tool_com", "parameters": {"center_of_mass": [1e9, 0, 0]}},
        {"effect": "magic", "parameters": {}},
    ]
    path = tmp_path / "found.json"
    path.write_text(json.dumps({"causes": causes, "candidates": candidates}))
    found = read_diagnosis(path, CATALOGUE)
    assert found.twins == "tool_mass:gain"
    assert found.values["tool_mass"] == {"mass": 0.8}
    np.testing.assert_array_equal(found.values["gain"]["gain"], [1.1] * 6)
    assert "tool_com" not in found.values


@pytest.mark.parametrize("content", ["", "[1]", '{"causes": 3}', "[" * 100_000, '{"causes": [{"effect": []}]}', None])
def test_a_file_that_is_no_diagnosis_is_refused_or_says_nothing(tmp_path, content):
    path = tmp_path / "found.json"
    if content is not None:
        path.write_text(content)
    if content and "effect" in content:
        assert read_diagnosis(path, CATALOGUE) == ({}, "")
        return
    with pytest.raises(UsageError, match=r"found\.json"):
        read_diagnosis(path, CATALOGUE)
