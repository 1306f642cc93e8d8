"""A gripper of the generator weighs what it carries, and nothing when open; what it holds stays in place."""

import numpy as np
import pytest

from validation.generator.effects.gripper import Gripper, Handover, Part, at_rest, carried, with_fingers
from validation.generator.recording import random_scene

PART = Part(0.7, np.array([0.01, 0.02, 0.03]), np.array([0.002, -0.003, 0.006]))
TAKES, OFFSET = 0.1, np.array([5e-4, -4e-4, 3e-4])


@pytest.fixture(scope="module")
def held():
    """Scene with open fingers, wrench (S, 6), position of the part (S, 3), and times of its pick-up and release."""
    hand = random_scene("moves", 14.0, 100.0, 1.0, np.random.SeedSequence(3).spawn(4))
    middle = hand.belief.tool.com + np.array([0, 0, 0.08])
    gripper = Gripper(middle, (0.08, 0.05), 0.01, 40.0, 0.8, PART)
    rests = [(a, b) for a, b in at_rest(hand) if a > 0 and b - a > gripper.closes + 2 * TAKES]
    grip, release = (Handover(a + 0.06, b - 0.01, TAKES, OFFSET) for a, b in (rests[0], rests[-1]))
    assert grip.gone < release.start
    wrench, center = carried(hand, gripper, [grip, release])
    return with_fingers(hand, gripper), wrench, center, (grip.start + gripper.closes, release.start), middle


def test_the_part_is_weighed_and_resists_while_it_is_held(held):
    scene, wrench, center, (taken, put_down), middle = held
    extra, t = wrench - scene.nominal, scene.grid
    inside = (t > taken + TAKES + 0.05) & (t < put_down - 0.05)
    moving = np.abs(scene.motion(t)[1]).max(1) > 0.05
    size = np.linalg.norm(extra[:, :3], axis=1)
    np.testing.assert_allclose(size[inside & ~moving], 0.7 * 9.81, atol=0.3)
    assert np.ptp(size[inside & moving]) > 0.1
    # Closing fingers push the part to the middle, only along x.
    np.testing.assert_allclose(np.median(center[inside], 0), middle + PART.center + [0, *OFFSET[1:]], atol=3e-4)
    assert np.abs(center[inside] - np.median(center[inside], 0)).max() < 3e-4


def test_without_the_part_the_open_hand_is_the_tool_that_its_owner_knows(held):
    scene, wrench, center, (taken, put_down), _ = held
    extra, t = wrench - scene.nominal, scene.grid
    free = (t < taken - 0.5) & (t > -1.0)
    assert np.abs(extra[free, :3]).max() < 0.05
    assert np.isnan(center[free]).all()
    assert np.abs(extra[t > put_down + TAKES + 0.6, :3]).max() < 0.05
