"""How a servo makes torque from a position command, and codes positions: as data, with where it is known from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from dynident.arrays import Array
from dynident.errors import UnknownChoice

#: Where a field of a law is known from.
STATES: Final = ("measured", "documented", "unknown")

#: Where a field is known from that the user states.
_STATED: Final = "stated in the case file"


@dataclass(frozen=True)
class KnownFrom:
    """Where a field of a drive law is known from.

    Attributes:
        state: One of STATES.
        source: Document or measurement, in words; empty where it is unknown.
    """

    state: str
    source: str = ""

    def __post_init__(self) -> None:
        if self.state not in STATES:
            raise ValueError(f"state '{self.state}' is not one of {', '.join(STATES)}")


@dataclass(frozen=True)
class DriveLaw:
    """The law of a position servo: duty = clip(kp error_gain (command - position) + ..., limit), torque = K duty - d v.

    A drive that controls torque itself (MIT mode) has error_gain 1, the torque as its duty, and no back-EMF.

    Attributes:
        name: Name of the preset, or empty.
        words: What it is for.
        kp: Position gain in the drive's own unit; None where the log states it or nobody knows.
        error_gain: Duty (or torque) per rad of error and unit of kp.
        limit: Largest duty, or torque in N m; infinite where there is none.
        controls_torque: Whether the drive's output is a torque, not a duty of its supply.
        dead_zone: Error in rad below which the drive does nothing.
        punch: Duty that is added outside the dead zone.
        slew_limit: Fastest change of the goal inside the drive in rad/s; infinite for none, None where it is free.
        delay_s: Time until a command acts in s; None where it is free.
        resolution: Step of the encoder in rad or m; 0 where it is not known.
        has_damping_gain: Whether the drive damps the velocity error by a gain that is to be found.
        damping_gain: That gain where it is known: duty (or N m) per rad/s; 0 where there is none, or it is to be found.
        full_torque: Torque at full duty that is known (of a drive that controls torque: torque over the commanded one)
            and its half width of 95 %, in N m; it is the scale where the logs have none. None where it is not known.
        known: Where each field is known from.
    """

    name: str = ""
    words: str = ""
    kp: float | None = None
    error_gain: float = 1.0
    limit: float = 1.0
    controls_torque: bool = False
    dead_zone: float = 0.0
    punch: float = 0.0
    slew_limit: float | None = None
    delay_s: float | None = None
    resolution: float = 0.0
    has_damping_gain: bool = False
    damping_gain: float = 0.0
    full_torque: tuple[float, float] | None = None
    known: Mapping[str, KnownFrom] = field(default_factory=dict)

    @property
    def gain_is_free(self) -> bool:
        """Whether the torque per error is not known up to the torque at full duty."""
        return self.state("error_gain").state == "unknown"

    def state(self, name: str) -> KnownFrom:
        """Return where a field is known from."""
        return self.known.get(name, KnownFrom("unknown"))

    def numbers(self, kp: float) -> Array:
        """Return the law for the compiled roll-out at a position gain, shape (4,)."""
        return np.array([kp * self.error_gain, self.limit, self.dead_zone, self.punch])

    @property
    def without_gain(self) -> DriveLaw:
        """The law where nobody knows kp: of gain and torque at full duty only the product is known at first."""
        if self.kp is not None:
            return self
        known = {name: state for name, state in self.known.items() if name != "error_gain"}
        return DriveLaw(**{**vars(self), "kp": 1.0, "error_gain": 1.0, "known": known})

    def for_slide(self) -> DriveLaw:
        """The law of a joint that slides: the resolution of a preset is that of a turn."""
        return self if self.state("resolution").source == _STATED else replace(self, resolution=0.0)

    def stated(self, fields: Mapping[str, Any]) -> DriveLaw:
        """Return the law with fields that the user states; they count as documented by the case file."""
        known = dict(self.known) | {name: KnownFrom("documented", _STATED) for name in fields}
        return replace(self, known=known, **fields)


_BAM: Final = "Rhoban BAM, oscilloscope on the drive (github.com/Rhoban/bam, Apache-2.0)"
_XL330: Final = "duty column of XL330 logs (Rhoban BAM, 2026-01): slope of duty over error, to 1 % of full scale"
_EMANUAL: Final = "ROBOTIS e-manual, control table of the X series"
_MIT: Final = "MIT mini-cheetah protocol: torque = kp e + kd de + feed-forward, in SI units"
_4096: Final = 2.0 * np.pi / 4096


def _law(law: DriveLaw, known: Mapping[str, tuple[str, str]]) -> DriveLaw:
    """Return a law with where its fields are known from, as (state, source)."""
    return replace(law, known={key: KnownFrom(*value) for key, value in known.items()})


#: Laws of common servo families, by name.
PRESETS: Final[Mapping[str, DriveLaw]] = {
    law.name: law
    for law in (
        _law(
            DriveLaw(
                "dynamixel_xl330",
                "Dynamixel XL330 and XC330, position mode, kp in units of the control table",
                error_gain=4096 / (2.0 * np.pi) / (256 * 885),
                resolution=_4096,
            ),
            {
                "error_gain": ("measured", _XL330),
                "limit": ("documented", f"{_EMANUAL}: PWM limit 885 is 100 %"),
                "resolution": ("documented", _EMANUAL),
            },
        ),
        _law(
            DriveLaw(
                "dynamixel_mx",
                "Dynamixel MX-64 and MX-106, protocol 1, position mode, kp in units of the control table",
                error_gain=0.158,
                limit=0.9625,
                resolution=_4096,
            ),
            {"error_gain": ("measured", _BAM), "limit": ("measured", _BAM), "resolution": ("documented", _EMANUAL)},
        ),
        _law(
            DriveLaw(
                "dynamixel_xl320",
                "Dynamixel XL-320, position mode, kp in units of the control table",
                error_gain=0.05048199,
                resolution=2.0 * np.pi * 300 / 360 / 1024,
            ),
            {"error_gain": ("measured", _BAM), "limit": ("measured", _BAM), "resolution": ("documented", _EMANUAL)},
        ),
        _law(
            DriveLaw(
                "feetech_sts3215",
                "Feetech STS3215 (SO-100, SO-101), position mode, kp in units of the control table",
                error_gain=0.166,
                limit=0.97,
                resolution=_4096,
            ),
            {"error_gain": ("measured", _BAM), "limit": ("measured", _BAM), "resolution": ("documented", "data sheet")},
        ),
        _law(
            DriveLaw(
                "mit",
                "drives with MIT mode (Damiao, CubeMars, quasi-direct drives): kp in N m/rad, kd in N m s/rad",
                limit=np.inf,
                controls_torque=True,
                slew_limit=np.inf,
            ),
            {"error_gain": ("documented", _MIT), "limit": ("unknown", "")},
        ),
        DriveLaw(
            "position_servo",
            "any position servo: torque proportional to the error up to a limit, nothing known of it",
            kp=1.0,
        ),
    )
}


def preset(name: str) -> DriveLaw:
    """Return the law of a servo family.

    Raises:
        UnknownChoice: No such preset.
    """
    if name not in PRESETS:
        raise UnknownChoice("drive law", name, tuple(PRESETS))
    return PRESETS[name]


@dataclass(frozen=True)
class CountCoding:
    """How the position register of a family of servos is read.

    Attributes:
        step: Angle of one count, in rad.
        middle: Count at angle 0.
        complement_bits: Bits of the register where negative numbers are its two's complement; 0 for none.
        sign_bit: Bit that is the sign of a magnitude, counted from 0; 0 for none.
        source: Where it is documented.
    """

    step: float
    middle: int
    complement_bits: int = 0
    sign_bit: int = 0
    source: str = ""

    def radians(self, counts: Array) -> Array:
        """Return angles in rad, of any shape, from counts that are signed already or not; nan stays nan."""
        found = np.array(counts, dtype=float)
        if self.complement_bits:
            found[found >= 2.0 ** (self.complement_bits - 1)] -= 2.0**self.complement_bits
        if self.sign_bit:
            negative = found >= 2.0**self.sign_bit
            found[negative] = 2.0**self.sign_bit - found[negative]
        return (found - self.middle) * self.step


#: Codings by the word of the case file.
COUNTS: Final = {
    "dynamixel": CountCoding(_4096, 2048, 32, source="ROBOTIS e-manual, X series: 4 bytes, 4096 a turn"),
    "dynamixel_mx": CountCoding(_4096, 2048, 16, source="ROBOTIS e-manual, MX, protocol 1: 2 bytes, multi-turn"),
    "dynamixel_xl320": CountCoding(
        2.0 * np.pi * 300 / 360 / 1024, 512, source="ROBOTIS e-manual, XL-320: 1024 over 300 degrees"
    ),
    "feetech": CountCoding(
        _4096, 2048, sign_bit=15, source="STS/SMS control table: Present_Position has its sign in bit 15"
    ),
    "feetech_complement": CountCoding(_4096, 2048, 16, source="the same, as a recorder of 16-bit integers writes it"),
}
