"""The page in a real browser with the network cut: nothing from outside, no complaint, hostile names, three widths."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident import FourierSeries, read_robot
from dynident.identification.files.estimate_file import read_estimate
from dynident.model.robot import joint_pose

DATA = Path(os.environ.get("DYNIDENT_DATA") or Path(__file__).resolve().parents[3] / "shared" / "data")

STAGES = ("robot", "log", "case", "check", "excite", "identify", "results", "compare", "session")

HOSTILE_URDF = """<robot name="&lt;script&gt;window.hurt = 1&lt;/script&gt;">
<link name="base"/>
<link name="&lt;img src=x onerror='window.hurt=1'&gt;"><inertial><mass value="1"/><origin xyz="0 0 0.1"/>
<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="\u05d0\u05d1 c"/>
<joint name="{long}" type="revolute"><parent link="base"/><child link="&lt;img src=x onerror='window.hurt=1'&gt;"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
<joint name="=HYPERLINK('x')" type="prismatic"><parent link="&lt;img src=x onerror='window.hurt=1'&gt;"/>
<child link="\u05d0\u05d1 c"/><axis xyz="1 0 0"/><limit lower="-1" upper="1" velocity="1" effort="1"/></joint>
</robot>""".format(long="x" * 300)

HOSTILE_LOG = 't,"<script>window.hurt=1</script>",\u202ecba,{long}\n' + "".join(f"{k},1,{k % 7},3\n" for k in range(30))


def _section(stage: str) -> str:
    return f"document.querySelector('section[aria-labelledby=\"title-{stage}\"]')"


def _go(page: Any, stage: str) -> None:
    page.js(f"location.hash = '/{stage}'")
    page.until(f"{_section(stage)} && !{_section(stage)}.hidden")


def _click(page: Any, stage: str, text: str) -> None:
    page.js(f"[...{_section(stage)}.querySelectorAll('button')].find(one => one.textContent === {text!r}).click()")


def _choose(page: Any, stage: str, label: str, *values: str) -> None:
    """Choose in the control with a label, as a user does."""
    page.js(
        f"(() => {{ const field = [...{_section(stage)}.querySelectorAll('.field')]"
        f".find(one => one.querySelector('legend, label').textContent === {label!r});"
        f"if (field.choose) return field.choose({list(values)!r});"
        f"const control = field.querySelector('select, input');"
        f"control.value = {values[0]!r};"
        f"control.dispatchEvent(new Event('change')); }})()"
    )


def _nothing_wrong(page: Any, running: Any) -> None:
    here = f"http://127.0.0.1:{running.session.gate.port}/"
    assert page.complaints == []
    assert [one for one in page.requests if not one.startswith((here, "data:", "about:"))] == []
    assert page.js("window.hurt") is None


@pytest.fixture
def page(new_browser: Callable[[], Any], running: Any) -> Any:
    pytest.importorskip("trimesh", reason="the studio extra is not installed")
    opened = new_browser()
    opened.open(running.address)
    opened.until("document.querySelectorAll('.sliders input').length")
    return opened


def test_the_first_view_moves_as_the_robot_does(page: Any, running: Any) -> None:
    assert page.js("location.search") == ""  # the token has left the address bar
    page.until("document.querySelector('.viewer canvas')")
    robot = read_robot("generic-7r")
    _choose(page, "robot", "Robot", "generic-7r")
    page.until("document.querySelectorAll('.sliders input').length === 7")
    page.js("import('/static/viewer.js').then(one => { window.viewer = one.viewer; })")
    page.until("viewer.robot && viewer.robot.scene.robot === 'generic-7r'")
    q = np.linspace(-1.0, 1.2, 7)
    page.js(f"viewer.set({q.tolist()})")
    seen = np.array(page.js("viewer.robot.movers.map(one => one.matrixWorld.elements)")).reshape(-1, 4, 4)
    places: list[tuple[np.ndarray, np.ndarray]] = []
    for joint, position in zip(robot.joints, q, strict=True):
        turn, shift = joint_pose(joint, float(position))
        parent, at = places[joint.parent] if joint.parent >= 0 else (np.eye(3), np.zeros(3))
        places.append((parent @ turn, parent @ shift + at))
    for matrix, (turn, shift) in zip(seen.transpose(0, 2, 1), places, strict=True):
        np.testing.assert_allclose(matrix[:3, :3], turn, atol=1e-6)
        np.testing.assert_allclose(matrix[:3, 3], shift, atol=1e-6)
    _nothing_wrong(page, running)


def test_hostile_names_are_text_at_every_width(page: Any, running: Any, client: Any, tmp_path: Path) -> None:
    client.upload("empty.bin", b"")
    robot, log = tmp_path / "arm.urdf", tmp_path / "<img src=x onerror=window.hurt=1>.csv"
    robot.write_text(HOSTILE_URDF, encoding="utf-8")
    log.write_text(HOSTILE_LOG.replace("{long}", "y" * 300), encoding="utf-8")
    page.choose_files("section:not([hidden]) input[type=file]", robot)
    page.until("document.querySelectorAll('.sliders input').length === 2")
    _go(page, "log")
    page.choose_files("section:not([hidden]) input[type=file]", log)
    page.until(f"{_section('log')}.querySelector('svg')")
    assert "<script>window.hurt=1</script>" in page.js(f"{_section('log')}.textContent")
    (client.folder / "case.yaml").write_text(
        f"case: 1\nrobot: arm.urdf\nnote: '<b>'\ntrain: {log.name[:0]}nothing.csv\n"
    )
    for width, dark in ((1440, False), (900, True), (360, False)):
        page.size(width, 800, dark)
        for stage in STAGES:
            _go(page, stage)
            assert page.js("document.documentElement.scrollWidth") <= width, (stage, width)
    cut = "[...document.querySelectorAll('.scroll')].filter(one => one.scrollWidth > one.clientWidth).length"
    for stage in ("robot", "log", "session"):  # on a phone rows are cards: nothing of them is out of sight
        _go(page, stage)
        assert page.js(cut) == 0, stage
    assert "empty.binother0 B" in page.js(f"{_section('session')}.textContent")
    assert page.js("[...document.querySelectorAll('img, script:not([src])')].length") == 0
    unnamed = (
        "[...document.querySelectorAll('select, input, textarea')].filter(one => !one.getAttribute('aria-label')"
        " && !one.getAttribute('aria-hidden') && !(one.labels && one.labels.length)).length"
    )
    assert page.js(unnamed) == 0
    _nothing_wrong(page, running)


def test_a_page_that_is_loaded_again_goes_on_with_the_command(page: Any, running: Any, client: Any) -> None:
    choices = {"case": "generic-6r", "friction": ["viscous"], "time_limit": 600}
    assert client.post("/api/run", {"verb": "excite", "choices": choices})[0] == 200
    page.call("Page.reload")
    page.until("document.querySelectorAll('.sliders input').length")
    _go(page, "excite")
    page.until(f"({_section('excite')}.querySelector('.state') || {{}}).textContent?.startsWith('running')")
    _click(page, "excite", "Cancel")
    page.until(f"{_section('excite')}.querySelector('.state').textContent.startsWith('cancelled')")
    assert client.names() == []
    _nothing_wrong(page, running)


@pytest.mark.battery
@pytest.mark.skipif(importlib.util.find_spec("axe_core_python") is None, reason="axe needs the package axe-core-python")
def test_axe_finds_no_fault_in_any_stage(page: Any, client: Any, logs: tuple[Path, Path]) -> None:
    spec = importlib.util.find_spec("axe_core_python")
    assert spec is not None and spec.origin is not None
    names = [client.upload(log.name, log.read_bytes()) for log in logs]
    text = f"case: 1\nrobot: generic-scara\ntrain: {names[0]}\nfriction: [coulomb, viscous]\n"
    case = client.upload("arm.yaml", text.encode())
    done = client.run("identify", case=case, estimator="wls", quick=True)
    assert done["state"] == "done", done["progress"]
    page.call("Page.setBypassCSP", enabled=True)  # for axe alone
    page.call("Page.reload")
    page.until("document.querySelectorAll('.sliders input').length")
    page.js(Path(spec.origin).with_name("axe.min.js").read_text(encoding="utf-8") + ";0")
    faults = (
        "axe.run(document, {resultTypes: ['violations'], iframes: false}).then(found => found.violations"
        ".map(one => `${one.id}: ${one.nodes[0].html.slice(0, 200)}`))"
    )
    for width, dark in ((1440, False), (360, True)):
        page.size(width, 900, dark)
        for stage in STAGES:
            _go(page, stage)
            if stage == "results":
                page.until(f"{_section('results')}.querySelector('iframe')", 60)
            assert page.js(faults) == [], (stage, width)


@pytest.mark.battery
def test_the_main_path_on_the_er16(page: Any, running: Any, client: Any, tmp_path: Path) -> None:
    logs = [_er16_log(tmp_path / f"run{k}.csv", k) for k in (1, 2)]
    _go(page, "log")
    page.choose_files("section:not([hidden]) input[type=file]", *logs)
    page.until(f"{_section('log')}.querySelector('svg')")
    _go(page, "case")
    _choose(page, "case", "Robot", "er16")
    _choose(page, "case", "Training logs", "run1.csv")
    _choose(page, "case", "Test logs", "run2.csv")
    _click(page, "case", "Draft the case file")
    page.until(f"{_section('case')}.querySelector('textarea')", 60)
    assert "asks for the joints" in page.js(f"{_section('case')}.querySelector('.fault').textContent")
    _choose(page, "case", "Unit of torque", "N m")
    _click(page, "case", "Save columns and units")
    page.until(f"{_section('case')}.querySelector('p.good')")
    _go(page, "check")
    _click(page, "check", "Check the logs")
    page.until(f"{_section('check')}.querySelector('h3')", 120)
    _go(page, "identify")
    _choose(page, "identify", "Friction", "coulomb", "viscous")
    page.js("document.querySelector('#quick').click()")
    _click(page, "identify", "Identify")
    page.until(f"{_section('identify')}.querySelector('a.go')", 240)
    _go(page, "results")
    page.until(f"{_section('results')}.querySelector('.answers') && {_section('results')}.querySelector('iframe')", 60)
    assert page.js(f"{_section('results')}.querySelector('.answer dt').textContent").endswith("%")
    time.sleep(0.5)
    page.js("import('/static/api.js').then(one => { window.known = one.known; })")
    page.until("window.known")
    status = page.js("fetch('/file?name=estimate_1.json').then(one => one.json()).then(one => one.kind)")
    assert status == "dynident estimate"
    _go(page, "session")
    page.until(f"{_section('session')}.querySelector('.command code')")
    commands = page.js(f"{_section('session')}.querySelector('.command code').textContent")
    ran = [line.split()[:2] for line in commands.splitlines() if line.startswith(("dynident ", "cat "))]
    assert [words[1] if words[0] == "dynident" else words[0] for words in ran] == ["init", "cat", "check", "identify"]
    _nothing_wrong(page, running)
    again = tmp_path / "again"
    again.mkdir()
    for log in logs:
        shutil.copy(log, again)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["sh", "-e"], input=commands, text=True, cwd=again, env={**os.environ, "PATH": path}, check=True)
    first, second = (read_estimate(folder / "estimate_1.json") for folder in (client.folder, again))
    np.testing.assert_array_equal(first.beta, second.beta)


@pytest.mark.battery
def test_the_main_path_on_a_real_set(page: Any, running: Any, client: Any) -> None:
    folder = DATA / "panda_gaz2019"
    if not folder.is_dir():
        pytest.skip(f"no folder {folder.name} under DYNIDENT_DATA or ../shared/data")
    _go(page, "robot")
    page.choose_files("section:not([hidden]) input[type=file]", folder / "robot.urdf")
    _go(page, "log")
    page.choose_files("section:not([hidden]) input[type=file]", folder / "exciting_traj_1.csv")
    page.until(f"{_section('log')}.querySelector('svg')", 30)
    _go(page, "case")
    _choose(page, "case", "Robot", "robot.urdf")
    _choose(page, "case", "Training logs", "exciting_traj_1.csv")
    _click(page, "case", "Draft the case file")
    page.until(f"{_section('case')}.querySelector('textarea')", 60)
    assert page.js(f"{_section('case')}.querySelector('.fault')?.textContent ?? ''") == ""  # this log answers all
    _go(page, "check")
    _click(page, "check", "Check the logs")
    page.until(f"{_section('check')}.querySelector('h3')", 120)
    _go(page, "identify")
    page.js("document.querySelector('#quick').click()")
    _click(page, "identify", "Identify")
    page.until(f"{_section('identify')}.querySelector('a.go')", 240)
    _go(page, "results")
    page.until(f"{_section('results')}.querySelector('.answers') && {_section('results')}.querySelector('iframe')", 120)
    error = page.js(f"{_section('results')}.querySelector('.answer dt').textContent")
    assert float(error.split()[0].rstrip("%")) < 1.0  # per cent, on the last third of the log
    robot = read_estimate(client.folder / "estimate_1.json").model.robot
    assert robot.dof == 7
    _nothing_wrong(page, running)


def _er16_log(path: Path, seed: int) -> Path:
    from dynident import DynamicModel, Log, write_log
    from dynident.model.friction import FRICTION, Motion

    full = read_robot("er16")
    robot = full.locked(dict.fromkeys(full.joint_names[3:], 0.0))
    model = DynamicModel(robot, (FRICTION.make("coulomb"), FRICTION.make("viscous")))
    assert robot.nominal is not None
    generator = np.random.default_rng(seed)
    sine, cosine = 0.25 * generator.normal(size=(2, 3, 4))
    t = np.arange(2000) / 100.0
    q, dq, ddq = FourierSeries(np.array([0.2, -0.3, 0.1]), sine, cosine, 10.0).evaluate(t)
    torque = model.torque(Motion(q, dq, ddq), np.concatenate([robot.nominal, np.tile([8.0, 5.0], 3)]))
    torque += generator.normal(size=torque.shape)
    write_log(Log(("joint1", "joint2", "joint3"), t, q, torque=torque), path)
    return path
