"""Random MJCFs that MuJoCo reads: models attached to models, copies of copies, ties of joints, settings, classes."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import PurePosixPath

import numpy as np

from dynident.arrays import Array


@dataclass
class _Model:
    """A model that is written.

    Attributes:
        degrees: Whether its angles are in degrees.
        limits: Whether a range alone makes a limit.
        classes: Its classes, and those of the models attached to it so far.
        models: Those that it may attach, by the name that it gives them.
        bodies: Names of its bodies, as another model may attach them.
        frames: Names of its frames.
        joints: Names of its joints by the replicas around them, with the rank of the joint of each.
        copies: Names of copies of its joints.
        tied: Ranks of the joints that follow another or are held.
        within: The replicas around what is written now.
        has_bounds: Whether all its bodies have an inertia, its world too.
        attached: How many models are attached to it.
    """

    degrees: bool
    limits: bool
    classes: list[str] = field(default_factory=list)
    models: dict[str, _Model] = field(default_factory=dict)
    bodies: list[str] = field(default_factory=list)
    frames: list[str] = field(default_factory=list)
    joints: dict[tuple[int, ...], dict[str, int]] = field(default_factory=dict)
    copies: set[str] = field(default_factory=set)
    tied: set[int] = field(default_factory=set)
    within: tuple[int, ...] = ()
    has_bounds: bool = False
    attached: int = 0


class RandomMjcf:
    """Writes files of a seed: ``main.xml``, and models attached to it and includes in folders.

    Attributes:
        files: The text of each file by its name.

    Args:
        seed: Of the random numbers.
        once: Whether all that an element stands for is the same: each model is attached once, and no copy is named.
    """

    def __init__(self, seed: int, once: bool = False) -> None:
        self._random = np.random.default_rng(seed)
        self._once = once
        self._count = 0
        self.files: dict[str, str] = {}
        fingers = self._model("parts/deep/finger.xml", {})
        hand = self._model("parts/hand.xml", {"f": fingers})
        arms = {"h": hand}
        if not once:
            arms |= {"f": fingers, "o": self._model("parts/other.xml", {"f": fingers})}
        self._model("main.xml", arms)

    def _chance(self, share: float) -> bool:
        return bool(self._random.random() < share)

    def _pick(self, words: Sequence[str]) -> str:
        return words[int(self._random.integers(len(words)))]

    def _word(self, letter: str) -> str:
        self._count += 1
        return f"{letter}{self._count}_"  # no name of another one with the number of a copy behind it

    def _numbers(self, count: int, low: float = -0.4, high: float = 0.4) -> str:
        return " ".join(f"{value:.4g}" for value in self._random.uniform(low, high, count))

    def _some(self, share: float, text: str) -> str:
        return text if self._chance(share) else ""

    def _turn(self, model: _Model) -> str:
        angle = 100.0 if model.degrees else 2.0
        return self._pick(
            [
                "",
                f' euler="{self._numbers(3, -angle, angle)}"',
                f' quat="{self._numbers(4)}"',
                f' axisangle="{self._numbers(3)} {self._numbers(1, -angle, angle)}"',
                f' xyaxes="{self._numbers(6)}"',
                f' zaxis="{self._numbers(3)}"',
            ]
        )

    def _pose(self, model: _Model) -> str:
        return self._some(0.8, f' pos="{self._numbers(3)}"') + self._turn(model)

    def _class(self, model: _Model, share: float = 0.3, key: str = "class") -> str:
        return f' {key}="{self._pick(model.classes)}"' if model.classes and self._chance(share) else ""

    def _model(self, path: str, models: dict[str, _Model]) -> _Model:
        """Write a model."""
        model = _Model(self._chance(0.5), self._chance(0.7))
        classes, own = self._defaults(model)
        model.classes = list(own)
        settings = self._settings(model)
        model.has_bounds = "bound" in settings
        assets = self._assets(path, model, models)
        world = "".join(self._body(model, 0, path) for _ in range(int(self._random.integers(1, 3))))
        world += "".join(self._attach(model) for _ in range(2))
        if path == "main.xml" and "h" in model.models and not model.attached:
            world += '<attach model="h" prefix="whole_"/>'
        option = self._some(0.5, f'<option gravity="{self._numbers(3, -9, 9)}"/>')
        model.tied.add(min(rank for names in model.joints.values() for rank in names.values()))  # it moves on its own
        rest = self._ties(model) + self._actuators(model, own)
        text = f"{settings}{option}<size memory='64M'/><default>{classes}</default><asset>{assets}</asset>"
        self.files[path] = f"<mujoco>{text}<worldbody>{world}</worldbody>{rest}</mujoco>"
        return model

    def _settings(self, model: _Model) -> str:
        stated = f' angle="{"degree" if model.degrees else "radian"}"'
        stated += self._some(0.5, f' eulerseq="{self._pick(["xyz", "XYZ", "zyx", "ZXY", "zxz", "yXz"])}"')
        stated += "" if model.limits else ' autolimits="false"'
        stated += self._some(0.2, ' balanceinertia="true"') + self._some(0.25, ' inertiafromgeom="true"')
        stated += self._some(0.2, f' boundmass="{self._numbers(1, 0.1, 1)}"')
        stated += self._some(0.2, f' boundinertia="{self._numbers(1, 0.001, 0.05)}"')
        stated += self._some(0.2, f' settotalmass="{self._numbers(1, 2, 20)}"')
        stated += self._some(0.2, ' inertiagrouprange="0 2"')
        return f"<compiler{stated}/>" + self._some(0.1, '<compiler balanceinertia="true"/>')

    def _defaults(self, model: _Model) -> tuple[str, list[str]]:
        """Return the classes and their names."""
        names: list[str] = []

        def inside(depth: int) -> str:
            axis = self._some(0.3, ' axis="0 1 0"')
            text = self._some(0.5, f"<joint{self._drive()}{axis}/>")
            turn = self._some(0.3, f' euler="{self._numbers(3, -1, 1)}"')
            text += self._some(0.5, f'<geom density="{self._numbers(1, 200, 2000)}"{turn}/>')
            text += self._some(0.4, f'<motor gear="{self._numbers(1, 1, 5)}"/>')
            for _ in range(int(self._random.integers(0, 3)) if depth else 0):
                names.append(self._word("c"))
                text += f'<default class="{names[-1]}">{inside(depth - 1)}</default>'
            return text

        return inside(2), names

    def _assets(self, path: str, model: _Model, models: dict[str, _Model]) -> str:
        """Return the models that may be attached, by files relative to that of the model."""
        text = ""
        places = {"f": "parts/deep/finger.xml", "h": "parts/hand.xml", "o": "parts/other.xml"}
        for name, one in models.items():
            place = PurePosixPath(places[name]).relative_to(PurePosixPath(path).parent)
            text += f'<model name="{name}" file="{place}"/>'
            model.models[name] = one
        return text

    def _geom(self, model: _Model) -> str:
        kind = self._pick(["sphere", "capsule", "box", "cylinder", "ellipsoid"])
        mass = self._pick(["", "", f' mass="{self._numbers(1, 0.1, 2)}"', f' density="{self._numbers(1, 100, 3000)}"'])
        shell = self._some(0.15, ' shellinertia="true"') if kind != "ellipsoid" else ""
        stated = f' type="{kind}"{self._class(model)}{mass}{shell}' + self._some(0.2, ' group="3"')
        if kind in ("capsule", "cylinder") and self._chance(0.3):
            return f'<geom{stated} fromto="{self._numbers(6)}" size="{self._numbers(1, 0.02, 0.1)}"/>'
        return f'<geom{stated} size="{self._numbers(3, 0.02, 0.2)}"{self._pose(model)}/>'

    def _inertial(self, model: _Model) -> str:
        where = f'pos="{self._numbers(3)}" mass="{self._numbers(1, 0.2, 3)}"'
        if self._chance(0.5):
            return f'<inertial {where} diaginertia="0.02 0.03 0.04"{self._turn(model)}/>'
        half: Array = self._random.normal(size=(3, 3)) * 0.1
        tensor = (np.trace(half @ half.T) + 0.01) * np.eye(3) - half @ half.T
        six = " ".join(f"{tensor[at]:.6g}" for at in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        return f'<inertial {where} fullinertia="{six}"/>'

    def _drive(self) -> str:
        keys = ("armature", "damping", "frictionloss")
        return "".join(self._some(0.4, f' {key}="{self._numbers(1, 0.01, 0.5)}"') for key in keys)

    def _joint(self, model: _Model) -> str:
        name = self._word("j")
        model.joints.setdefault(model.within, {})[name] = self._count
        is_slide = self._chance(0.3)
        reach = 60.0 if model.degrees and not is_slide else 1.0
        text = f'<joint name="{name}"{self._class(model)}' + (' type="slide"' if is_slide else ' type="hinge"')
        text += self._some(0.9, f' axis="{self._numbers(3)}"') + self._some(0.4, f' pos="{self._numbers(3)}"')
        limited = "" if model.limits else ' limited="true"'
        limits = f' range="{self._numbers(1, -reach, -0.1)} {self._numbers(1, 0.1, reach)}"{limited}'
        text += self._some(0.4, limits) + self._some(0.3, f' ref="{self._numbers(1, -reach, reach)}"')
        return f"{text}{self._drive()}/>"

    def _body(self, model: _Model, depth: int, path: str) -> str:
        name = self._word("b")
        if not model.within:
            model.bodies.append(name)
        text = f'<body name="{name}"{self._pose(model)}{self._class(model, 0.2, "childclass")}>'
        text += "".join(self._joint(model) for _ in range(int(self._pick("01112")) if depth else 1))
        text += self._some(0.5, self._inertial(model)) + '<geom size=".07" mass=".3"/>'
        text += "".join(self._geom(model) for _ in range(int(self._random.integers(0, 3))))
        text += self._some(0.3, f'<site name="{self._word("s")}"{self._pose(model)}/>')
        text += self._some(0.15, self._copied(model, lambda: self._geom(model)))
        for _ in range(int(self._pick("0112")) if depth < 2 else 0):
            text += self._framed(model, lambda: self._below(model, depth + 1, path))
        return f"{text}{self._attach(model, 0.4)}</body>"

    def _below(self, model: _Model, depth: int, path: str) -> str:
        """Return a body, in a replica or not, some in an include."""
        if len(model.within) < 2 and self._chance(0.3):
            return self._copied(model, lambda: self._body(model, depth, path) + self._attach(model, 0.3))
        text = self._body(model, depth, path)
        if self._chance(0.15):
            file = f"{self._word('i')}.xml"
            self.files[str(PurePosixPath(path).with_name(file))] = f"<mujocoinclude>{text}</mujocoinclude>"
            return f'<include file="{file}"/>'
        return text

    def _framed(self, model: _Model, inside: Callable[[], str]) -> str:
        if self._chance(0.6):
            return inside()
        name = self._word("f")
        if not model.within:
            model.frames.append(name)
        stated = f'name="{name}"{self._pose(model)}{self._class(model, 0.3, "childclass")}'
        return f"<frame {stated}>{inside()}{self._some(0.3, self._geom(model))}</frame>"

    def _copied(self, model: _Model, inside: Callable[[], str]) -> str:
        """Return replicas; what names them may name a copy, which is one in each replica around."""
        copies, separator, number = int(self._pick("1223")), self._pick(["-", "", "."]), self._count + 1
        outside, self._count = model.within, number
        model.within = (*outside, number)
        text = inside()
        around = model.joints.setdefault(outside, {})
        for name, rank in model.joints.get(model.within, {}).items():
            found = {f"{name}{separator}{copy}": rank for copy in range(0 if self._once else copies)}
            around.update(found)
            model.copies.update(found)
        model.within = outside
        angle = 60.0 if model.degrees else 1.0
        stated = f'count="{copies}" offset="{self._numbers(3)}" euler="{self._numbers(3, -angle, angle)}"'
        return f'<replicate {stated} sep="{separator}">{text}</replicate>'

    def _attach(self, model: _Model, share: float = 0.7) -> str:
        if not model.models or model.attached > 2 or not self._chance(share):
            return ""
        name, prefix = self._pick(list(model.models)), self._word("p")
        inner = model.models.pop(name) if self._once else model.models[name]
        kind = self._pick(["body", "frame", "all", "body", "body" if inner.has_bounds else "world"])
        if kind == "frame" and not inner.frames:
            kind = "body"
        what = {"body": inner.bodies, "frame": inner.frames, "world": ["world"], "all": [""]}[kind]
        key = "frame" if kind == "frame" else "body"
        stated = f' {key}="{self._pick(what)}"' if kind != "all" else ""
        model.attached += 1
        model.classes += [prefix + one for one in inner.classes] if self._chance(0.5) else []
        if kind in ("world", "all"):
            resolved = inner.joints.get((), {})
            free = [prefix + one for one, rank in resolved.items() if rank not in inner.tied]
            model.joints.setdefault(model.within, {}).update({one: self._count + at for at, one in enumerate(free)})
            self._count += len(free)
            if not model.within:
                model.bodies += [prefix + one for one in inner.bodies]
        text = f'<attach model="{name}"{stated} prefix="{prefix}"/>'
        return f"<frame{self._pose(model)}>{text}</frame>" if self._chance(0.5) else text

    def _ties(self, model: _Model) -> str:
        """Return equalities of joints and of fixed tendons, each joint tied once, to one that is written before it."""
        equalities, tendons = "", ""
        for _ in range(int(self._random.integers(0, 5))):
            chain = list(model.joints)[int(self._random.integers(len(model.joints)))]
            names = model.joints[chain]
            kind = self._pick(["joint", "joint", "held", "tendon", "two", "one"])
            one = self._pick(list(names)) if names else ""
            outer = model.joints.get(chain[:-1], {}) if kind == "tendon" else {}
            around = {name: rank for name, rank in outer.items() if name not in model.copies} | names
            before = [name for name, rank in around.items() if rank < names.get(one, 0)]
            if not one or names[one] in model.tied or not (before or kind in ("held", "one")):
                continue
            model.tied.add(names[one])
            other, constant = self._pick(before) if before else "", self._numbers(1)
            slope, last, first = (self._numbers(1, low, low + 2) for low in (0.3, 0.2, -2.2))
            if kind in ("joint", "held"):
                follows = f' joint2="{other}" polycoef="{constant} {slope}"' if kind == "joint" else ""
                held = f' polycoef="{constant}"' if kind == "held" else ""
                equalities += f'<joint joint1="{one}"{follows}{held}/>'
                continue
            tendon, second = self._word("t"), self._word("t")
            part = f'<joint joint="{one}" coef="{last}"/>'
            inside = f'<joint joint="{other}" coef="{first}"/>'
            tendons += f'<fixed name="{tendon}">{inside if kind == "tendon" else ""}{part}</fixed>'
            tendons += f'<fixed name="{second}">{inside}</fixed>' if kind == "two" else ""
            follows = (
                f' tendon2="{second}" polycoef="{constant} {slope}"' if kind == "two" else f' polycoef="{constant}"'
            )
            equalities += f'<tendon tendon1="{tendon}"{follows}/>'
        return f"<tendon>{tendons}</tendon><equality>{equalities}</equality>"

    def _actuators(self, model: _Model, classes: list[str]) -> str:
        text = ""
        for name in (name for names in model.joints.values() for name in names):
            stated = self._some(0.6, f' gear="{self._numbers(1, -4, 4)}"')
            stated += self._some(0.3, ' forcerange="-3 4" forcelimited="true"')
            stated += self._some(0.3, f' armature="{self._numbers(1, 0, 0.2)}"')
            stated += self._some(0.3, f' damping="{self._numbers(1, 0, 0.2)}"')
            stated += f' class="{self._pick(classes)}"' if classes and self._chance(0.3) else ""
            kind = self._pick(["motor", "position", "velocity", "general"])
            text += self._some(0.3, f'<{kind} joint="{name}"{stated}/>')
        return f"<actuator>{text}</actuator>"
