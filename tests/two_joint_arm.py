"""The arm with two revolute joints on which commands are tried."""

URDF = """<robot name="arm2">
  <link name="stand"/>
  <link name="upper"><inertial><origin xyz="0.18 0 0.02"/><mass value="7"/>
    <inertia ixx="0.03" ixy="0" ixz="0" iyy="0.12" iyz="0" izz="0.12"/></inertial></link>
  <link name="fore"><inertial><origin xyz="0.12 0 0"/><mass value="3"/>
    <inertia ixx="0.008" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>
  <joint name="shoulder" type="revolute"><parent link="stand"/><child link="upper"/><origin xyz="0 0 0.3"/>
    <axis xyz="0 0 1"/><limit lower="-3" upper="3" velocity="3" effort="200"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/><origin xyz="0.4 0 0.05"/>
    <axis xyz="0 1 0"/><limit lower="-3" upper="3" velocity="4" effort="100"/></joint>
</robot>
"""
