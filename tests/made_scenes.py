"""An MJCF as users have it: classes of defaults, degrees, a mesh with density, an include, comments, other bodies."""

import numpy as np

GRIPPER = """<mujocoinclude>
  <!-- a finger that slides -->
  <body name="finger" pos="0 0.02 0.08">
    <joint name="finger_joint" type="slide" axis="0 1 0" range="0 0.04"/>
    <geom type="box" size="0.01 0.005 0.03" mass="0.05"/>
  </body>
</mujocoinclude>
"""

SCENE = """<?xml version="1.0"?>
<!-- The cell by the window. -->
<mujoco model="cell">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="0 0 -9.81" timestep="0.002"/>  <!-- as everywhere -->
  <default>
    <joint axis="0 0 1" damping="0.5"/>
    <geom type="capsule" size="0.04 0.1" density="800"/>
    <default class="tool"><geom type="mesh" density="1200"/></default>
  </default>
  <asset>
    <mesh name="plate" vertex="0 0 0  0.06 0 0  0 0.05 0  0 0 0.09"/>
  </asset>
  <worldbody>
    <body name="box" pos="1 1 1"><freejoint/><geom type="box" size="0.1 0.1 0.1"/></body>
    <body name="base" pos="0.2 -0.1 0.4" euler="0 0 30">
      <geom/>
      <body name="link1" pos="0 0 0.33">
        <joint name="joint1" range="-166 166"/><geom/>
        <body name="link2" euler="-90 0 0">
          <joint name="joint2" ref="20" range="-120 120"/><geom pos="0 -0.1 0" euler="90 0 0"/>
          <body name="link3" pos="0 -0.316 0" euler="90 0 0">
            <joint name="joint3"/><geom/>
            <body name="link4" pos="0.08 0 0" euler="90 0 0">
              <joint name="joint4" range="-176 -4" ref="-90"/><geom/>
              <body name="link5" pos="-0.08 0.384 0" euler="-90 0 0">
                <joint name="joint5"/><geom/>
                <body name="link6" euler="90 0 0">
                  <joint name="joint6" range="-5 215"/><geom size="0.03 0.04"/>
                  <body name="link7" pos="0.088 0 0" euler="90 0 0">
                    <joint name="joint7"/><geom size="0.03 0.02" pos="0 0 0.05"/>
                    <body name="hand" pos="0 0 0.107" euler="0 0 -45">
                      <!-- the sensor -->
                      <site name="ft_site" pos="0 0 0.01" euler="0 0 20"/>
                      <geom class="tool" mesh="plate"/>
                      <geom class="tool" mesh="plate" pos="0.01 0.02 0.05" euler="30 0 0" mass="0.4"/>
                      <include file="gripper.xml"/>
                    </body>
                  </body>
                </body>
              </body>
            </body>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
  <sensor>
    <force name="force" site="ft_site"/>
    <torque name="torque" site="ft_site"/>
  </sensor>
</mujoco>
"""

URDF = """<?xml version="1.0"?>
<robot name="three">
  <!-- comments stay -->
  <link name="base"/><link name="upper"/><link name="lower"/><link name="wrist"/><link name="flange"/>
  <link name="hand">
    <inertial>
      <origin xyz="0 0 0.05" rpy="0 0.3 1.5"/>  <!-- weighed -->
      <mass value="0.7"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.0025"/>
    </inertial>
  </link>
  <joint name="pan" type="continuous"><parent link="base"/><child link="upper"/><axis xyz="0 0 2"/></joint>
  <joint name="tilt" type="revolute"><parent link="upper"/><child link="lower"/>
    <origin xyz="0.1 0 0" rpy="1.5707963267948966 0.2 0"/><axis xyz="0 1 0"/></joint>
  <joint name="lift" type="prismatic"><parent link="lower"/><child link="wrist"/>
    <origin xyz="0.1 0 0" rpy="1.5707963267948966 0 0"/><axis xyz="0 1 0"/></joint>
  <joint name="end" type="fixed"><parent link="wrist"/><child link="flange"/><origin xyz="0 0 0.2"/></joint>
  <joint name="grip" type="fixed"><parent link="flange"/><child link="hand"/>
    <origin xyz="0 0 0.1" rpy="0.1 0 0"/></joint>
</robot>
"""

TOML = """
[robot]
mjcf = "scene.xml"

[sensor]
noise_std = [0.05, 0.002]
"""


def write(folder, scene=SCENE):
    """The scene, its gripper and a setup of them in a folder; the paths of scene and setup."""
    for name, text in (("scene.xml", scene), ("gripper.xml", GRIPPER), ("setup.toml", TOML)):
        (folder / name).write_text(text)
    return folder / "scene.xml", folder / "setup.toml"


def reading_of_mujoco(model, joints, q, dq, ddq, force="force", torque="torque"):
    """(T, 6) N, Nm: readings of MuJoCo's force and torque sensors at these joints (T, n), with the others at rest."""
    import mujoco

    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONSTRAINT)  # random poses collide
    data, rows = mujoco.MjData(model), []
    at = [model.jnt_qposadr[model.joint(name).id] for name in joints]
    speed = [model.jnt_dofadr[model.joint(name).id] for name in joints]
    for one in zip(q, dq, ddq, strict=True):
        for target, place, values in zip((data.qpos, data.qvel, data.qacc), (at, speed, speed), one, strict=True):
            target[place] = values
        mujoco.mj_inverse(model, data)
        rows.append(np.concatenate([data.sensor(force).data, data.sensor(torque).data]))
    return np.array(rows)
