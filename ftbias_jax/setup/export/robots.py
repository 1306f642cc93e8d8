"""The tool as the payload of a robot's controller: Universal Robots and Franka."""

from __future__ import annotations

import json

from ftbias_jax.setup.export.options import ExportOptions, heading, number, numbers, plain
from ftbias_jax.setup.export.payload import FRANKA, UR, payload_of
from ftbias_jax.setup.types import Setup


def ur_text(setup: Setup, options: ExportOptions) -> str:
    """URScript that sets the payload.

    ``set_target_payload(m, cog, inertia)`` of the script manual (SW 5.11 and newer): kg; m from the tool mount, in the
    tool flange frame; [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] kg m^2 about the centre of gravity, axes of the flange.
    https://www.universal-robots.com/manuals/EN/HTML/SW10_6/Content/prod-scriptmanual/G5/set_target_payload.htm

    Args:
        setup: with the tool.
        options: of the export.
    """
    mass, center, inertia = payload_of(setup, UR, options)
    cog = numbers(center)
    six = numbers([inertia[i, j] for i, j in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))])
    between = ", and what was given between flange and sensor" if options.sensor_mass else ""
    lines = [
        *heading(setup),
        "kg; m in the tool flange frame; kg m^2 about the centre of gravity, axes of the flange: xx yy zz xy xz yz",
        f"everything distal of the sensor{between}",
        "the robot zeroes its own force-torque reading when it runs this",
        f"older software: set_payload({number(mass)}, {cog})",
    ]
    return "".join(f"# {line}\n" for line in lines) + f"set_target_payload({number(mass)}, {cog}, {six})\n"


def franka_text(setup: Setup, options: ExportOptions) -> str:
    """JSON (which is YAML, too) with the arguments of ``setLoad``.

    ``franka::Robot::setLoad(load_mass, F_x_Cload, load_inertia)`` of libfranka: kg; centre of mass in the flange frame
    (link 8), m; inertia about the centre of mass, kg m^2, 3 x 3, column by column (frankaemika/libfranka, robot.h and
    robot_state.h). The request of franka_msgs/SetLoad has the same numbers under names of its own
    (https://docs.ros.org/en/humble/p/franka_msgs/srv/SetLoad.html).

    Args:
        setup: with the tool.
        options: of the export.
    """
    mass, center, inertia = payload_of(setup, FRANKA, options)
    numbers = {"mass": plain([mass])[0], "F_x_Cload": plain(center), "load_inertia": plain(inertia.ravel(order="F"))}
    words = [
        *heading(setup),
        "kg; m in the flange frame (link 8); kg m^2 about the centre of mass, column by column",
        "the load comes on top of the end effector that Desk is set to: set none there",
    ]
    request = {"mass": numbers["mass"], "center_of_mass": numbers["F_x_Cload"], "load_inertia": numbers["load_inertia"]}
    return json.dumps({"about": words, "setLoad": numbers, "franka_msgs/SetLoad": request}, indent=1) + "\n"
