"""Small readers of robot programs, written from the languages' manuals and not from what the exporters print."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import Any

_TOKEN = re.compile(r"\s+|-?\d+\.?\d*(?:[eE]-?\d+)?|[A-Za-z_$][A-Za-z0-9_$]*|:=|[^\sA-Za-z0-9_]")


def tokens(text: str, comment: str) -> list[str]:
    """Return the tokens of a program without its comments and blanks; every sign has to be one."""
    found: list[str] = []
    for line in text.splitlines():
        code, place = line.split(comment, 1)[0], 0
        while place < len(code):
            match = _TOKEN.match(code, place)
            assert match, f"no token: {code[place:]!r}"
            if not match.group(0).isspace():
                found.append(match.group(0))
            place = match.end()
    return found


@dataclass
class Script:
    """What a URScript does when it runs: its moves in order."""

    moves: list[list[float]] = field(default_factory=list)
    servo: list[list[float]] = field(default_factory=list)
    settings: set[tuple[float, ...]] = field(default_factory=set)
    stopped: bool = False


def run_urscript(text: str) -> Script:
    """Run the part of URScript that a program for servoj needs: def, while, assignments, lists, calls."""
    script, lines = Script(), []
    for line in text.splitlines():
        code = line.split("#", 1)[0].rstrip()
        if code.strip():
            lines.append(code.strip())
    joined = "\n".join(lines)
    joined = re.sub(r"(?<=[\[,])\n", " ", joined)  # a list may go on over lines
    python, depth = [], 0
    for line in joined.splitlines():
        if line == "end":
            depth -= 1
            continue
        python.append("    " * depth + line)
        depth += line.endswith(":")
    assert depth == 0, "blocks and ends do not match"

    def servoj(q: list[float], *settings: float) -> None:
        script.servo.append(list(q))
        script.settings.add(settings)

    names: dict[str, Any] = {
        "movej": lambda q, a, v: script.moves.append(list(q)) if a > 0 and v > 0 else None,
        "servoj": servoj,
        "sleep": lambda s: None,
        "stopj": lambda a: setattr(script, "stopped", True),
    }
    name = re.fullmatch(r"def ([A-Za-z]\w*)\(\):", python[0])
    assert name
    namespace: dict[str, Any] = {"__builtins__": {}, **names}
    exec("\n".join(python), namespace)
    namespace[name[1]]()
    return script


@dataclass
class Module:
    """What a KRL or RAPID module does: slow targets, timed targets with the time at which each is due."""

    name: str
    slow: list[dict[str, float]] = field(default_factory=list)
    timed: list[tuple[float, dict[str, float]]] = field(default_factory=list)


def run_krl(source: str, data: str) -> Module:
    """Run a module: declarations of the .dat, then PTP and one PTP_SPLINE with a TIME_BLOCK of the .src."""
    points, sizes = _krl_data(data)
    lines = [line.split(";", 1)[0].strip() for line in source.splitlines()]
    lines = [line for line in lines if line]
    head = re.fullmatch(r"DEF ([A-Z]\w{0,23})\( \)", lines[0], re.IGNORECASE)
    assert head and lines[-1] == "END" and re.match(rf"DEFDAT {head[1]}\b", data)
    module, block, parts, total = Module(head[1]), [], [], 0.0
    inside = False
    for line in lines[1:-1]:
        if match := re.fullmatch(r"PTP (\w+(?:\[\d+\])?)", line):
            assert not inside
            module.slow.append(points[match[1]])
        elif match := re.fullmatch(r"SPTP (\w+(?:\[\d+\])?)", line):
            assert inside
            block.append(points[match[1]])
        elif match := re.fullmatch(r"TIME_BLOCK (?:PART|END) = (\d+\.\d+)", line):
            if "END" in line:
                total = float(match[1])
            else:
                parts.append(float(match[1]))
        elif line in ("PTP_SPLINE", "ENDSPLINE"):
            inside = line == "PTP_SPLINE"
        else:
            assert re.fullmatch(r"BAS\(#(INITMOV|VEL_PTP|ACC_PTP),\d+\)|WAIT SEC 1\.0|TIME_BLOCK START", line), line
    assert len(parts) == len(block) and total > 0 and sizes == {"QP": len(block) + 1}
    due = 0.0
    for part, point in zip(parts, block, strict=True):
        due += part / sum(parts) * total
        module.timed.append((due, point))
    return module


def _krl_data(data: str) -> tuple[dict[str, dict[str, float]], dict[str, int]]:
    points: dict[str, dict[str, float]] = {}
    sizes: dict[str, int] = {}
    lines = data.splitlines()
    assert lines[-1] == "ENDDAT"
    for line in lines[1:-1]:
        if match := re.fullmatch(r"DECL (?:AXIS|E6AXIS) (\w+)\[(\d+)\]", line):
            sizes[match[1]] = int(match[2])
        elif match := re.fullmatch(r"(?:DECL (?:AXIS|E6AXIS) )?(\w+(?:\[\d+\])?)=\{(.*)\}", line):
            pairs = [item.split(" ") for item in match[2].split(",")]
            points[match[1]] = {axis: float(value) for axis, value in pairs}
            assert all(re.fullmatch(r"[AE][1-6]", axis) for axis, _ in pairs)
        else:
            assert line == "EXT BAS (BAS_COMMAND :IN,REAL :IN )", line
    return points, sizes


def run_rapid(text: str) -> Module:
    """Run a module: data declarations, one procedure with MoveAbsJ and one FOR loop."""
    words = tokens(text, "!")
    assert words[0] == "MODULE" and words[-1] == "ENDMODULE"
    module, data, body = Module(words[1]), *_rapid_data(words[2:-1])
    time, k = 0.0, 0
    while k < len(body):
        if body[k] == "FOR":
            assert [body[k + 1], body[k + 2], body[k + 4], body[k + 6]] == ["i", "FROM", "TO", "DO"]
            end = body.index("ENDFOR", k)
            for i in range(int(body[k + 3]), int(body[k + 5]) + 1):
                time = _rapid_move([str(i) if w == "i" else w for w in body[k + 7 : end]], data, module, time)
            k = end + 1
        else:
            end = body.index(";", k) + 1
            if body[k] != "WaitTime":
                time = _rapid_move(body[k:end], data, module, time)
            k = end
    return module


def _rapid_data(words: list[str]) -> tuple[dict[str, Any], list[str]]:
    data: dict[str, Any] = {}
    k = 0
    while words[k] == "LOCAL":
        kind, name, place = words[k + 2], words[k + 3], k + 4
        assert words[k + 1] in ("CONST", "PERS") and kind in ("speeddata", "jointtarget")
        size = None
        if words[place] == "{":
            size, place = int(words[place + 1]), place + 3
        assert words[place] == ":="
        end = words.index(";", place)
        data[name] = eval("".join(words[place + 1 : end]), {"__builtins__": {}})
        assert size is None or len(data[name]) == size
        k = end + 1
    assert words[k] == "PROC" and words[k + 2 : k + 4] == ["(", ")"] and words[-1] == "ENDPROC"
    return data, words[k + 4 : -1]


def _rapid_move(words: list[str], data: dict[str, Any], module: Module, time: float) -> float:
    assert words[0] == "MoveAbsJ" and words[-1] == ";" and words[-2] == "tool0"
    target = data[words[1]]
    if words[2] == "{":
        target = target[int(words[3]) - 1]
    robot, external = target
    assert len(robot) == len(external) == 6
    axes = {f"rax_{i + 1}": value for i, value in enumerate(robot)}
    axes |= {f"eax_{letter}": value for letter, value in zip("abcdef", external, strict=True) if value != 9e9}
    assert words[words.index("\\") + 1] == "NoEOffs"
    speed = words[words.index(",") + 1]
    if "T" in words:
        time += float(words[words.index("T") + 2])
        module.timed.append((time, axes))
        assert speed == "v1000"
    else:
        assert data[speed] == [50, 10, 50, 10] and words[words.index(",") + 3] == "fine"
        module.slow.append(axes)
    return time
