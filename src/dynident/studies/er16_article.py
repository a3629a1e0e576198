"""The ER-16 case of the article "Dynamic Model Identification for 6-DOF Industrial Robots", as data.

Numbers in brackets are the article's equations and tables. Where the article leaves something open, the choice stands
beside the number. Parameters carry the names that ``base_parameters`` gives to the columns they lead.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType

import numpy as np

from dynident.arrays import Array, frozen

#: Table 1, modified (Craig) DH: alpha_{i-1} in rad, a_{i-1} in m, d_i in m, offset of theta_i in rad.
TABLE_1: tuple[tuple[float, float, float, float], ...] = (
    (np.pi, 0.0, 0.0, 0.0),
    (np.pi / 2, 0.16, 0.0, -np.pi / 2),
    (0.0, 0.68, 0.0, 0.0),
    (np.pi / 2, 0.13, -0.75, 0.0),
    (-np.pi / 2, 0.0, 0.0, 0.0),
    (np.pi / 2, 0.0, 0.0, 0.0),
)

#: Table 2: the 21 identified parameters of joints 1-3, in SI units; joints 4-6 were locked. No possible robot has them:
#: M(q) is indefinite, and Fc of joint 1 is negative.
TABLE_2: Mapping[str, float] = MappingProxyType(
    {
        "Izz[link1]": 50.4438,
        "Ixx[link2]": 37.7503,
        "Ixy[link2]": 16.1693,
        "Ixz[link2]": -23.0075,
        "Iyz[link2]": 3.2047,
        "Izz[link2]": 1.5512,
        "mx[link2]": 5.9390,
        "my[link2]": 46.8898,
        "Ixx[link3]": 30.9319,
        "Ixy[link3]": -0.7515,
        "Ixz[link3]": 2.3092,
        "Iyz[link3]": 63.2997,
        "Izz[link3]": -0.4069,
        "mx[link3]": 2.3608,
        "my[link3]": 1.4471,
        "Fc[joint1]": -0.0448,
        "Fv[joint1]": 0.1144,
        "Fc[joint2]": 11.0195,
        "Fv[joint2]": 5.3853,
        "Fc[joint3]": 10.9173,
        "Fv[joint3]": 27.3475,
    }
)

#: Table 3: half-widths of the search box, symmetric about zero, in SI units. Table 2's Fc of joint 2 lies outside it.
TABLE_3: Mapping[str, float] = MappingProxyType(
    {
        "Izz[link1]": 60.0,
        "Ixx[link2]": 60.0,
        "Ixy[link2]": 30.0,
        "Ixz[link2]": 40.0,
        "Iyz[link2]": 10.0,
        "Izz[link2]": 10.0,
        "mx[link2]": 10.0,
        "my[link2]": 80.0,
        "Ixx[link3]": 60.0,
        "Ixy[link3]": 10.0,
        "Ixz[link3]": 10.0,
        "Iyz[link3]": 80.0,
        "Izz[link3]": 10.0,
        "mx[link3]": 10.0,
        "my[link3]": 10.0,
        "Fc[joint1]": 10.0,
        "Fv[joint1]": 10.0,
        "Fc[joint2]": 10.0,
        "Fv[joint2]": 30.0,
        "Fc[joint3]": 30.0,
        "Fv[joint3]": 30.0,
    }
)

#: (A.1), excitation: per joint the offset, five sine and five cosine amplitudes, in rad. Printed row 3 lacks its first
#: number, the offset; 0 stands for it. The order within a row is not stated; this one keeps the joints in -95..121 deg.
BETA_1: Array = frozen(
    [
        [-0.3857, -0.1911, -0.2842, -0.2289, -0.2455, -0.5705, 0.3359, 0.4129, 0.5744, 0.4842, 0.0730],
        [0.0011, 0.3597, -0.0179, -0.0117, 0.0443, 0.4355, 0.2551, 0.0386, 0.0411, 0.0057, -0.0065],
        [0.0, -0.1638, 0.5347, -0.1448, 0.1029, 0.0826, 0.4426, 0.3359, 0.6126, -0.6714, -0.5792],
    ]
)

#: (A.2), validation: per joint the offset, three sine and three cosine amplitudes, in rad.
BETA_2: Array = frozen(
    [
        [0.3016, 0.4006, 0.6921, -0.4210, -0.0423, 0.6066, -0.9719],
        [-0.5026, -0.0051, 0.0492, 0.8074, 0.4578, -0.2521, 0.6288],
        [-0.1276, -0.0624, 0.3805, 0.4006, 0.3016, 0.3531, 0.1524],
    ]
)

#: Period of both trajectories in s (4.1). The text also says 0.05 Hz, which is 20 s; its figures and data span 25 s.
PERIOD = 25.0

#: Samples per second and number of samples of one period (4.1).
RATE, SAMPLES = 1000.0, 25_000

#: Gravity in frame 0, in m/s^2; not printed. Joint 1 points down (alpha_0 = pi), so frame 0 has z up.
GRAVITY = (0.0, 0.0, -9.81)

#: Joints that were locked, and where, in rad; the positions are not printed and are our choice.
LOCKED: Mapping[str, float] = MappingProxyType({"joint4": 0.0, "joint5": 0.0, "joint6": 0.0})

#: Published settings of the colony (4.1): N_s, limit, T_max; and the objective (9) it ended at, in units not stated.
COLONY, LIMIT, ITERATIONS = 30, 15, 50
PUBLISHED_OBJECTIVE = 0.3182

#: Published correlation (18) of measured and predicted torque of joints 1-3: on the excitation (4.1), on (A.2) (4.2).
CORRELATION_EXCITATION = (0.9533, 0.9856, 0.9801)
CORRELATION_VALIDATION = (0.9272, 0.9534, 0.9606)

#: The measured torques were never published. Reproductions add white noise of this share of each joint's torque
#: standard deviation over the trajectory; our choice, of the size the published correlations imply.
NOISE_SHARE = 0.2
