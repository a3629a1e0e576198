"""What the name of a column says: its quantity, whether it is measured, its side, its unit, its number or joint."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

#: Words of the field for each signal.
WORDS: Mapping[str, tuple[str, ...]] = {
    "time": (
        "t", "time", "timestamp", "timestamps", "stamp", "times", "timesec", "clock", "zeit", "zeitstempel", "uhrzeit",
        "temps", "tiempo", "tempo", "tout", "elapsed", "时间", "時間",
    ),
    "q": ("q", "pos", "position", "positions", "theta", "angle", "angles", "ang", "qpos", "jpos", "winkel", "θ",
        "phi", "φ", "posizione", "posicion", "posición", "位置", "角度"),
    "dq": (
        "dq", "qd", "vel", "velocity", "velocities", "qdot", "dqdt", "qvel", "jvel", "speed", "speeds", "omega", "ω",
        "geschwindigkeit", "dphi", "dtheta", "vitesse", "velocidad", "velocita", "velocità", "速度",
    ),
    "ddq": ("ddq", "qdd", "acc", "acceleration", "accelerations", "accel", "qddot"),
    "torque": (
        "tau", "torque", "torques", "tor", "torq", "trq", "effort", "efforts", "eff", "moment", "moments", "drehmoment",
        "τ", "force", "forces", "frc", "qfrc", "couple", "couples", "coppia", "力矩", "扭矩", "トルク",
    ),
    "current": ("i", "current", "currents", "cur", "curr", "iq", "amps", "strom", "courant", "corriente",
        "corrente", "电流", "電流"),
    "temperature": ("temp", "temperature", "temperatures", "temperatur", "temperatura"),
}  # fmt: skip

#: Words that join a signal and a side.
_JOINED = {"qm": ("q", "motor"), "dqm": ("dq", "motor"), "taum": ("torque", "motor"), "im": ("current", "motor")}
SIGNAL = {word: signal for signal, words in WORDS.items() for word in words}

_KINDS = {
    "measured": "actual act meas measured msr sensor present real encoder enc fb feedback ist".split(),
    "commanded": "des desired cmd command commands commanded ref reference target set setpoint sp goal planned soll "
    "d".split(),
    "model": "model est estimated ext external hat predicted pred sim residual friction gravity coriolis ff "
    "disturbance interaction collision contact compensate compensation comp".split(),
}
KIND = {word: kind for kind, words in _KINDS.items() for word in words}
_SIDES = {"motor": "motor", "mot": "motor", "rotor": "motor", "link": "link", "load": "link"}

#: Words that say what the column is not: a signal of a joint.
OTHER = frozenset(
    "err error std var cov min max limit lower upper tcp tool ee cart cartesian pose wrench twist imu x y z rx ry rz "
    "quat flange voltage volt volts power status mode flag count version bits".split()
)

#: Words of a force, which is no torque of a joint that turns, and of pressures of cylinders.
FORCE_WORDS = frozenset("force forces kraft fuerza forza".split())
_PRESSURE_WORDS = frozenset("pa pb kpa mpa bar psi pressure pressures druck pression presion pressione".split())

#: Counters of microcontrollers, which are a time and its unit.
_COUNTERS: Mapping[str, tuple[str, ...]] = {"millis": ("time", "ms"), "micros": ("time", "us")}

#: Words for the share of its drive that a servo uses, which is no torque.
SHARE_WORDS = frozenset("load duty pwm".split())

#: Columns that say whether a drive is on.
ENABLED = re.compile(r"(torque|motor|drive|servo)[_ ]?(enabled?|on)\d*|enabled?\d*|on\d+", re.IGNORECASE)

#: Words that say nothing more about a column.
NEUTRAL = frozenset(
    "joint joints j axis axes a achse arm robot state states value values observation data of s field msg header raw "
    "grp group actuator actuators drive drives servo servos id dxl m gear wert gelenk achs antriebs articulation axe "
    "eje asse counts ticks inc increments 关节 関節 轴 軸".split()
)

#: What a dot over a signal makes of it.
_DERIVED = {"q": "dq", "dq": "ddq"}

#: Units at the end of names, as the words of the case file; by signal where a word has two meanings.
UNIT_WORDS: Mapping[str, str] = {
    "s": "s", "sec": "s", "ms": "ms", "us": "us", "ns": "ns", "rad": "rad", "deg": "deg", "m": "m", "mm": "mm",
    "rad/s": "rad/s", "rads": "rad/s", "deg/s": "deg/s", "degs": "deg/s", "m/s": "m/s", "mm/s": "mm/s", "nm": "N m",
    "mnm": "mN m", "n": "N", "a": "A", "amp": "A", "amps": "A", "ma": "mA",
    **dict.fromkeys(("%", "percent", "pct", "prozent"), "percent"),
    **dict.fromkeys(("permille", "promille", "‰"), "permille"),
    "°": "deg", "°/s": "deg/s", "grad": "deg", "grad/s": "deg/s",
    "seconds": "s", "sek": "s", "msec": "ms",
    **dict.fromkeys(("rev", "revs", "turn", "turns", "umdr", "umdrehungen"), "360 deg"),
    **dict.fromkeys(("rpm", "rev/min", "u/min", "1/min", "min-1"), "6 deg/s"),
    **dict.fromkeys(("rev/s", "revs/s", "turns/s", "rps"), "360 deg/s"),
}  # fmt: skip

_QUANTITY_UNITS: Mapping[str, frozenset[str]] = {
    "time": frozenset(("s", "ms", "us", "ns")),
    "q": frozenset(("rad", "deg", "m", "mm", "360 deg")),
    "dq": frozenset(("rad/s", "deg/s", "m/s", "mm/s", "6 deg/s", "360 deg/s")),
    "torque": frozenset(("N m", "mN m", "N", "percent", "permille")),
    "current": frozenset(("A", "mA", "percent", "permille")),
}

#: Signals that a unit tells where no word does.
_UNIT_TELLS: Mapping[str, str] = {
    "deg": "q", "rad": "q", "deg/s": "dq", "rad/s": "dq", "N m": "torque", "mN m": "torque", "A": "current",
    "mA": "current",
}  # fmt: skip

#: Of these the words that have no other meaning in a name, so that a number may follow them.
_PLAIN_UNITS = frozenset("rad deg rads degs mm nm mnm percent pct prozent permille promille rev revs rpm".split())

_BRACKETED = re.compile(r"[\[({]\s*([^\[\](){}]*?)\s*[\])}]\s*$")

#: Signs for units, which need no brackets, and words that have no other meaning at the end of a name, also after NUL,
#: which stands for a number.
_SIGN = re.compile(r"[\s_.-]*([%‰°])\s*$")
_LAST_WORD = re.compile(rf"(?<=[^\W_]|\0)[\s_.-]((?:(?i:{'|'.join(sorted(_PLAIN_UNITS))}))|N|A)$")


@dataclass(frozen=True)
class Meaning:
    """What a name says, its number or joint left aside.

    Attributes:
        signal: Field of a log, such as ``q``; ``time``; empty where no word is known.
        kind: measured, commanded or model; empty where the name does not say.
        side: motor or link; empty where the name does not say.
        unit: Unit in the name, a word of the case file; empty where it has none.
        strange: Words that are not known.
    """

    signal: str
    kind: str = ""
    side: str = ""
    unit: str = ""
    strange: tuple[str, ...] = ()


#: Words that German writes as one, and programs: a wanted or a measured value, that of a motor or of a joint, a clock.
_WRITTEN_TOGETHER = re.compile(
    r"(?<![^\W\d_])(soll|ist|motor|gelenk|achs|antriebs)(?=(?:position|winkel|geschwindigkeit|drehmoment|moment|strom|wert)(?![^\W\d_]))"
    r"|(?<![^\W\d_])(act|actual|meas|cmd|des|ref|set|target|joint|axis|motor|drive)"
    r"(?=(?:pos|position|angle|vel|velocity|speed|torque|trq|tau|force|cur|curr|current)(?![^\W\d_]))"
    r"|(?<![^\W\d_])(?!time)[^\W\d_]{2,}(?=(?:time|stamp|timestamp)(?![^\W\d_]))",
    re.IGNORECASE,
)

#: Names of KUKA's sensor interface for what axes do and shall do, and for currents.
_OF_KUKA = {"aipos": "ist pos ", "aspos": "soll pos ", "macur": "current "}
_BY_KUKA = re.compile(rf"(?<![^\W_])({'|'.join(_OF_KUKA)})(?=[\W\d_]|a\d|$)", re.IGNORECASE)

#: Names of Unitree's messages for what joints do, behind their gears.
_BY_UNITREE = re.compile(r"motor_?state(?=\[)", re.IGNORECASE)

#: Words for a joint that are written without a blank to what follows.
_JOINT_SIGNS = re.compile("(关节|関節|轴|軸)")


def tokens_of(name: str) -> list[str]:
    """Return the words and numbers of a name in small letters: ``jointPos_1`` is joint, pos, 1, ``qDes`` q, des."""
    name = name.replace("dynamic_joint_states", "joint_states")  # a topic of ros2_control
    name = _BY_UNITREE.sub("state", name)
    name = _BY_KUKA.sub(lambda found: _OF_KUKA[found[1].lower()], name)
    name = _JOINT_SIGNS.sub(r" \1 ", _WRITTEN_TOGETHER.sub(r"\g<0> ", name))
    spaced = re.sub(r"(?<=[a-z][a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=[qx])(?=[A-Z][a-z])", " ", name)
    return [word.lower() for word in re.findall(r"[^\W\d_]+|\d+", spaced)]


def words_of(name: str, container: str = "") -> list[str]:
    """Return the words and numbers of a name; those of what contains all columns count where they are known.

    Args:
        name: Name of a column, or a part of it.
        container: What all columns of the log begin with, such as the name of a struct.
    """
    if not container or not name.startswith(container):
        return tokens_of(name)
    known = SIGNAL.keys() | KIND.keys() | _SIDES.keys() | _JOINED.keys() | OTHER
    outer = [word for word in tokens_of(container) if word in known and word != "t"]
    return outer + tokens_of(name[len(container) :])


def is_pressure(name: str) -> bool:
    """Return whether the name of a column says that it is a pressure: ``boom_pA``, ``p1 [bar]``."""
    return bool(_PRESSURE_WORDS.intersection(tokens_of(name)))


def split_unit(name: str) -> tuple[str, str]:
    """Return the name without a unit at its end, in brackets, as a sign or a plain word, and the unit or empty."""
    found = _BRACKETED.search(name) or _SIGN.search(name) or _LAST_WORD.search(name)
    if found is None:
        return name, ""
    plain = re.sub(r"[\s·*.]", "", found[1].lower())
    unit = UNIT_WORDS.get(plain, "")
    return (name[: found.start()], unit) if unit else (name, "")


def unit_of(names: Sequence[str]) -> str:
    """Return the unit that all names end in, with a number or without; empty where they do not."""
    units = set()
    for name in names:
        base, unit = split_unit(name)
        words = [word for word in tokens_of(base) if not word.isdigit()]
        units.add(unit or (UNIT_WORDS[words[-1]] if len(words) > 1 and words[-1] in _PLAIN_UNITS else ""))
    return units.pop() if len(units) == 1 else ""


def is_unit_of(unit: str, signal: str) -> bool:
    """Return whether a signal may have a unit."""
    return unit in _QUANTITY_UNITS.get(signal, ())


def meaning_of(words: Sequence[str], unit: str = "", at_end: bool = True) -> Meaning:
    """Return what words say together.

    Args:
        words: Words of a name without its number and the name of its joint.
        unit: Unit that stood in brackets.
        at_end: Whether the last word stood at the end of the name, where a unit may stand.
    """
    words = [own for word in _undotted(list(words)) for own in _COUNTERS.get(word, (word,))]
    signals, kind, side, strange = _signals(words), "", "", list[str]()
    signal = _one(signals)
    if not unit and len(words) > 1 and words[-1] in UNIT_WORDS and (at_end or _is_plain(words)):
        unit = UNIT_WORDS[words[-1]]
        is_told = is_unit_of(unit, signal) or (not signal and words[-1] in _PLAIN_UNITS)
        words = words[:-1] if is_told else words
    if signal in ("", "time") and set(words) <= NEUTRAL | KIND.keys() | _SIDES.keys() | {"t"}:
        signal = _UNIT_TELLS.get(unit, signal)  # J1 (deg), T1 (Nm), axis_1_deg
    if not signal and {"enc", "encoder"} & set(words):
        signal = "q"
    if signal in _QUANTITY_UNITS and unit not in _QUANTITY_UNITS[signal]:
        unit = ""
    for k, word in enumerate(words):
        if word in OTHER:
            return Meaning("")
        if word in _JOINED:
            side = _JOINED[word][1]
        elif word in SIGNAL:
            continue
        elif word in KIND and (word != "d" or k):
            kind = kind if kind in ("commanded", "model") else KIND[word]
        elif word in _SIDES:
            side = _SIDES[word]
        elif word not in NEUTRAL and not (word == "in" and words[k + 1 :] and words[k + 1] in UNIT_WORDS):
            strange.append(word)
    if signal == "time" and (strange or kind not in ("", "measured")):  # a clock of something, or a duration
        return Meaning("", unit=unit)
    return Meaning(signal, kind, side, unit, tuple(strange))


def _is_plain(words: Sequence[str]) -> bool:
    """Return whether the last word is a unit even before a number, such as ``force_N1``."""
    return words[-1] in _PLAIN_UNITS or (words[-1] == "n" and words[-2] in ("force", "forces", "frc"))


def _undotted(words: list[str]) -> list[str]:
    """Return words with ``theta dot`` as one that is known, such as dq."""
    found: list[str] = []
    for word in words:
        before = SIGNAL.get(found[-1], "") if found else ""
        if word in ("dot", "ddot") and before in _DERIVED:
            derived = _DERIVED[before] if word == "dot" else "ddq" if before == "q" else ""
            found[-1:] = [derived] if derived else [found[-1], word]
        else:
            found.append(word)
    return found


def _signals(words: Sequence[str]) -> list[str]:
    found = []
    for word in words:
        if word in _JOINED:
            found.append(_JOINED[word][0])
        elif word in SIGNAL:
            found.append(SIGNAL[word])
    return found


def _one(signals: Sequence[str]) -> str:
    """Return the signal of several words: 'current position' is a position, 'torque current' a current."""
    kinds = list(dict.fromkeys(signals))
    if len(kinds) > 1 and "time" in kinds:
        kinds.remove("time")
    if len(kinds) <= 1:
        return kinds[0] if kinds else ""
    return kinds[-1] if "current" in kinds and len(kinds) == 2 else ""


def container_of(header: Sequence[str]) -> str:
    """Return what all columns begin with up to a dot or a slash, such as the name of a struct; empty for nothing."""
    low, high = min(header, default=""), max(header, default="")
    same = next((k for k, signs in enumerate(zip(low, high, strict=False)) if signs[0] != signs[1]), len(low))
    return low[: max(low.rfind(".", 0, same), low.rfind("/", 0, same)) + 1] if len(header) > 1 else ""
