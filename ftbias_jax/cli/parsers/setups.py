"""Arguments of ``ftbias setup``."""

from __future__ import annotations

import argparse

from ftbias_jax.cli.argument_types import Commands, add_force, positive
from ftbias_jax.setup.chains import CONVENTIONS, UNITS


def add_setup(commands: Commands) -> None:
    """The command ``setup``."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "setup",
        help="draft a setup from a robot's name, a URDF or a log",
        description="Write a commented setup with everything that the robot's name, its URDF and LOG tell: kinematics, "
        "limits, names of joints, topics, mounting, noise, and the tool by its weight. What is left says "
        "'measure me'.",
        epilog="Example: ftbias setup pick.bag --robot ur10e -o setup.toml",
    )
    parser.add_argument(
        "logs", nargs="*", metavar="LOG", help="a log that shall be filtered with it; or all its files, one a stream"
    )
    parser.add_argument("--robot", default="", metavar="NAME", help="a built-in robot; --list shows them")
    parser.add_argument("--urdf", default="", metavar="FILE", help="a URDF instead")
    parser.add_argument("--base", default="", metavar="LINK", help="base link of the URDF (default: the root)")
    parser.add_argument("--tip", default="", metavar="LINK", help="flange of the URDF (default: tool0, flange, ...)")
    parser.add_argument(
        "--dh",
        default="",
        metavar="FILE",
        help="a Denavit-Hartenberg table instead: CSV, columns a, alpha, d, theta",
    )
    parser.add_argument(
        "--dh-convention", default="", choices=CONVENTIONS, help="of the table; modified is Craig's (default: none)"
    )
    parser.add_argument(
        "--dh-units", default="", choices=UNITS, help="of the table (default: as its header states, as in 'a [mm]')"
    )
    parser.add_argument("--mass", type=positive, metavar="KG", help="of all that is distal of the sensor, if known")
    parser.add_argument(
        "--center-of-mass", type=float, nargs=3, metavar=("X", "Y", "Z"), help="of the same, m, sensor frame"
    )
    parser.add_argument("--rate", type=positive, metavar="HZ", help="of a log without stamps")
    parser.add_argument("-o", "--output", metavar="SETUP.toml", help="the file to write (default: standard output)")
    parser.add_argument("--schema", action="store_true", help="print the JSON Schema of setups, for editors")
    parser.add_argument("--list", action="store_true", help="print the built-in robots")


def add_export(commands: Commands) -> None:
    """The command ``export``."""
    parser = commands.add_parser(
        "export",
        help="write the tool as a payload of UR or Franka or as YAML for ROS, or a layout for viewers",
        description="Write the tool of SETUP.toml (and for ROS its bias) as a robot's controller or a package of ROS "
        "reads it, in the frame and sign that it needs; or a layout of the topics that filter writes as MCAP.",
        epilog="Example: ftbias export identified.toml --format ur -o payload.script",
    )
    parser.add_argument(
        "setup", nargs="?", default="", metavar="SETUP.toml", help="with the tool; layouts do without a setup"
    )
    parser.add_argument(
        "--format",
        required=True,
        choices=["ur", "franka", "ros", "ft_calib", "foxglove", "plotjuggler"],
        help="ur: URScript; franka: setLoad as JSON; ros: ros2_control's broadcaster with gravity compensation, YAML; "
        "ft_calib: YAML of force_torque_tools; foxglove, plotjuggler: layouts",
    )
    parser.add_argument("-o", "--output", metavar="FILE", help="the file to write (default: standard output)")
    parser.add_argument(
        "--sensor-mass",
        type=float,
        nargs=4,
        metavar=("KG", "X", "Y", "Z"),
        help="ur, franka: what is between flange and sensor, as the sensor's body: mass, and centre in m, flange frame",
    )
    parser.add_argument(
        "--frames-as-stated",
        action="store_true",
        help="ur, franka: the flange of a setup with a URDF or a list of joints is the controller's tool flange, and a "
        "mounting of the sensor that is not stated is zero",
    )
    parser.add_argument(
        "--sensor-frame", default="ft_sensor", metavar="FRAME", help="ros, ft_calib: the sensor's frame (%(default)s)"
    )
    parser.add_argument(
        "--world-frame", default="", metavar="FRAME", help="ros: name of the base frame (the one of the robot's maker)"
    )
    add_force(parser)
