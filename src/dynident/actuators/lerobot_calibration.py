"""Calibration files of LeRobot: what a share of a motor's calibrated range is in rad."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynident.arrays import Array
from dynident.errors import FileError

#: Counts of a turn of the motors that LeRobot calibrates in shares (Feetech STS3215, Dynamixel X series).
TURN = 4096

#: End of the names of motors whose share runs from 0 to 100; that of all others runs from -100 to 100.
GRIPPER = "gripper"

_STEP = "name the JSON that lerobot-calibrate wrote for the follower arm, with range_min and range_max of each motor"


#: End of the calibrated range as a share in percent.
SHARES = 100.0


@dataclass(frozen=True)
class MotorRange:
    """The calibrated range of one motor (``motors_bus.py`` of LeRobot: RANGE_M100_100, RANGE_0_100).

    LeRobot turns shares over for a motor that is mounted the other way round (drive_mode 1): their sign is the joint's.

    Attributes:
        name: The motor.
        travel: From one end to the other, in rad.
    """

    name: str
    travel: float

    def radians(self, shares: Array) -> Array:
        """Return angles in rad from the middle of the range, of any shape, from shares in percent."""
        middle, width = (50.0, 100.0) if self.name.endswith(GRIPPER) else (0.0, 200.0)
        return (np.asarray(shares) - middle) / width * self.travel


def read_calibration(path: str | Path) -> tuple[MotorRange, ...]:
    """Return the ranges of the motors in the order of the file.

    Raises:
        FileError: The file cannot be read, or is no calibration.
    """
    try:
        data = json.loads(Path(path).read_text(encoding="utf-8"))
        found = []
        for name, motor in data.items():
            low, high = int(motor["range_min"]), int(motor["range_max"])
            if not low < high:
                raise FileError(
                    path, f"{name}: range_min {low} is not below range_max {high}", "calibrate the arm again"
                )
            if high - low > TURN:
                evidence = f"{name}: range_min {low} to range_max {high} is more than a turn of {TURN} counts"
                raise FileError(path, evidence, "calibrate the arm again")
            found.append(MotorRange(str(name), (high - low) * 2.0 * np.pi / TURN))
        return tuple(found)
    except OSError as error:
        raise FileError(path, str(error.strerror), _STEP) from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError) as error:
        raise FileError(path, f"no calibration of LeRobot ({error})", _STEP) from error
