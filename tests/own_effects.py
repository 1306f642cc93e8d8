"""Effects as a user would write them, for the tests of own effects."""

HOSE = """
import ftbias_jax as ft


def drag(values, signals, wrench):
    force = -values["coefficient"] * signals.path.velocity
    return wrench + signals.push(force)


HOSE_DRAG = ft.Effect(
    "hose_drag",
    "environment",
    (ft.Parameter("coefficient", "N s/m", "force per velocity of the sensor", lower=0, scale=5.0),),
    "a hose drags at the tool, the faster the more",
    "route the hose so that it moves freely",
    reading=drag,
)
"""
