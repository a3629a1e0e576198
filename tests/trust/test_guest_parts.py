"""Parts that another package adds by entry points: found by name everywhere, held to the same contracts, or refused."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from dynident import DynamicModel, read_robot
from dynident.errors import BrokenPart, UnknownChoice
from dynident.model.friction import FRICTION, Motion
from dynident.model.friction.viscous import Viscous
from dynident.plugins import part_names

ROOT = Path(__file__).parents[2]
GUEST = ROOT / "tests" / "guest"
NAMES = ("cubic_drag", "pulled", "central_differences", "even_d", "pipes", "counted")

DRAG = 0.4
CASE = """case: 1
robot: generic-scara
friction: [cubic_drag, viscous]
preprocessing:
  filter: central_differences
train: run.pipes
"""

_FRICTION = '''
from dataclasses import dataclass
from dynident.model.friction import Friction
from dynident.model.friction.base import Coefficient

@dataclass(frozen=True)
class Guest(Friction):
    """A guest."""

    coefficients = (Coefficient("Fg", "N m", "N", nonnegative=False),)

    def terms(self, at):
        return (at.q,)
'''


def with_guest(*words: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(GUEST), "PYTHONWARNINGS": "ignore"}
    call = [sys.executable, *words]
    return subprocess.run(call, capture_output=True, text=True, check=False, env=environment, cwd=ROOT)


def test_guests_keep_the_contracts_of_their_families() -> None:
    """The same batteries as for our own parts: each guest is drawn by its family's name list and none fails."""
    chosen = " or ".join(NAMES)
    done = with_guest("-m", "pytest", "-q", "-p", "no:xdist", "-rA", "tests/contracts", "-k", chosen)
    assert done.returncode == 0, done.stdout[-3000:]
    passed = set(re.findall(r"^PASSED .*\[(\w+)", done.stdout, re.MULTILINE))
    assert passed >= set(NAMES)


def test_guests_do_their_work_from_case_to_report(tmp_path: Path) -> None:
    model = DynamicModel(read_robot("generic-scara"), (Viscous(),))
    size, rate = np.array([1.0, 0.9, 0.1, 1.2]), np.array([1.1, 1.7, 2.3, 2.9])
    time = np.arange(1500) / 100.0
    phase = np.outer(time, rate) + np.arange(4.0)
    motion = Motion(size * np.sin(phase), size * rate * np.cos(phase), -size * rate**2 * np.sin(phase))
    assert model.robot.nominal is not None
    torque = model.torque(motion, np.append(model.robot.nominal, np.ones(4))) + DRAG * motion.dq**3
    torque += 1e-4 * np.random.default_rng(0).normal(size=torque.shape)
    names = ["t", *(f"{word}{k}" for word in ("q", "tau") for k in range(1, 5))]
    rows = np.column_stack([time, motion.q, torque]).tolist()
    (tmp_path / "run.pipes").write_text("\n".join("|".join(map(str, row)) for row in [names, *rows]))
    (tmp_path / "case.yaml").write_text(CASE)
    made = {name: str(tmp_path / name) for name in ("case.yaml", "out.json", "page.html")}
    words = ("--estimator", "pulled:strength=1e-12", "-o", made["out.json"], "--report", made["page.html"], "--quiet")
    done = with_guest("-m", "dynident", "identify", made["case.yaml"], *words)
    assert done.returncode == 0, done.stderr[-3000:]
    assert "generic-scara has 16 base parameters, counted by a guest." in Path(made["page.html"]).read_text()
    beta = json.loads(Path(made["out.json"]).read_text())["beta"]
    np.testing.assert_allclose(beta[8::2], DRAG, rtol=0.05)  # after 8 of the bodies: drag and viscous of each drive
    told = with_guest("-m", "dynident", "list", "friction")
    assert re.search(r"cubic_drag +Torque Fc3 dq\^3", told.stdout)


def test_a_part_is_there_once_its_package_is(install: Callable[[str, str, str], None]) -> None:
    with pytest.raises(UnknownChoice):
        FRICTION.get("guest_a")
    install("guest_a", "guest_a = guest_a", _FRICTION)
    assert "guest_a" in FRICTION.names() and "guest_a" in part_names(FRICTION.package)
    part = FRICTION.make("guest_a")
    assert FRICTION.name_of(part) == "guest_a" and FRICTION.summary("guest_a") == "A guest."
    assert "guest_a" in sys.modules and FRICTION.get("viscous").__name__ == "Viscous"


@pytest.mark.parametrize(
    ("package", "point", "text", "message"),
    [
        ("guest_b", "viscous = guest_b", _FRICTION, "guest_b would take a name that is taken; uninstall what adds it"),
        ("guest_c", "honey = guest_c", _FRICTION, "the package 'guest_c' must add a module called as the part is"),
        ("guest_d", "guest_d = guest_d", "1 / 0", "ZeroDivisionError: division by zero; fix or uninstall the package"),
        ("guest_e", "guest_e = guest_e", "", "guest_e must define exactly one Friction, found 0; fix or uninstall"),
        ("guest_f", "guest_f = guest_f.no", _FRICTION, "guest_f.no'; the package 'guest_f' must add a module"),
    ],
)  # fmt: skip
def test_a_part_that_cannot_be_used_is_named_with_its_package(
    install: Callable[[str, str, str], None], package: str, point: str, text: str, message: str
) -> None:
    install(package, point, text)
    name = point.partition(" = ")[0]
    with pytest.raises(BrokenPart) as caught:
        FRICTION.get(name)
    assert str(caught.value).startswith(f"the friction model '{name}' cannot be used: ") and message in str(
        caught.value
    )
    assert FRICTION.get("coulomb").__name__ == "Coulomb"  # the others are not harmed
