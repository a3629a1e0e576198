"""Estimates of small arms for tests of exports: quick fits of exact logs with a little noise."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from dynident.data.log import Log
from dynident.identification.estimate.estimate import Estimate
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel
from dynident.model.robot import Robot

FRICTION = ("coulomb", "viscous", "offset", "rotor_inertia")


def estimate_of(
    robot: Robot,
    exact_log: Callable[..., Log],
    friction: Sequence[Any] = FRICTION,
    estimator: str = "consistent",
    exact: bool = False,
) -> Estimate:
    """Return an estimate of a robot whose friction coefficients lie between 0.1 and 0.5; ``exact`` has the truth."""
    model = DynamicModel(robot, tuple(friction))
    theta = model.nominal()
    assert theta is not None
    theta = theta.copy()
    theta[model.inertial_count :] = np.random.default_rng(0).uniform(0.1, 0.5, len(theta) - model.inertial_count)
    estimate = identify(model, [exact_log(model, theta, noise=0.01, samples=300)], estimator)
    return replace(estimate, theta=theta, beta=estimate.base.from_standard(theta)) if exact else estimate


#: An arm with what files have: comments, CDATA, line ends of two kinds, fixed links, a tool, a follower, odd quotes.
URDF = """<?xml version='1.0' encoding="utf-8"?>
<!-- <link name="upper"><inertial/></link> a comment is no link; café -->
<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <material name='grey'><color rgba=".5 .5 .5 1"/></material>
  <link name="base"><inertial>
    <mass value="9"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
  <link name="upper" type='arm'>
    <visual><geometry><mesh filename="package://arm/upper.stl"/></geometry></visual>
    <inertial>
      <origin rpy="0.1 0.2 0.3"
              xyz="0.1 0.02 0.03"/>
      <mass   value = '3.0' ></mass>
      <inertia iyz="0" ixx="0.03" iyy="0.04" izz="0.05" ixy="0" ixz="0.001"/>
    </inertial>
  </link>
  <joint name="shoulder" type="continuous">
    <origin xyz="0 0 0.3"/><parent link="base"/><child link="upper"/><axis xyz="0 0 2"/>
    <dynamics friction='7' damping="9" spring_stiffness="1"/>
  </joint>
  <link name="lower">
    <inertial>
      <mass value="2"/>
      <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/>
    </inertial>
  </link>
  <joint name="elbow" type="revolute">
    <origin xyz="0.4 0 0.1" rpy="1.5707963267948966 0 0"/>
    <parent link="upper"/>
    <child link="lower"/>
    <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" effort="50" velocity="3"/>
  </joint>
  <link name="flange"/>
  <joint name="flange_joint" type="fixed"><parent link="lower"/><child link="flange"/><origin xyz="0.3 0 0"/></joint>
  <link name="tool">
    <inertial><origin xyz="0.05 0 0"/><mass value="0.4"/>
      <inertia ixx="0.001" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.002"/></inertial>
  </link>
  <joint name="tool_joint" type="fixed"><parent link="flange"/><child link="tool"/><origin rpy="0.3 0 0.2"/></joint>
  <link name="finger"><inertial><mass value="0.2"/>
    <inertia ixx="2e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link>
  <joint name="grip" type="prismatic">
    <parent link="tool"/><child link="finger"/><origin xyz="0.1 0 0"/><axis xyz="0 1 0"/>
    <limit lower="-0.1" upper="0.1" effort="5" velocity="1"/>
  </joint>
  <link name="other"><inertial><mass value="0.15"/>
    <inertia ixx="2e-4" ixy="0" ixz="0" iyy="2e-4" iyz="0" izz="2e-4"/></inertial></link>
  <joint name="follow" type="prismatic">
    <parent link="tool"/><child link="other"/><origin xyz="0.1 0 0.02"/><axis xyz="0 -1 0"/>
    <mimic joint="grip" multiplier="0.5" offset="0.01"/><limit lower="-0.1" upper="0.1" effort="5" velocity="1"/>
    <dynamics damping="0.7"/>
  </joint>
  <gazebo reference="upper"><mu1>0.2</mu1></gazebo>
</robot>
"""
