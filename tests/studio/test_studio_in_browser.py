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
from dynident.model.joint import joint_pose
from dynident.studio import views
from real_data import real

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
    choices = {"case": "generic-6r", "friction": ["viscous"], "starts": 1000, "time_limit": 600}
    assert client.post("/api/run", {"verb": "excite", "choices": choices})[0] == 200
    page.call("Page.reload")
    page.until("document.querySelectorAll('.sliders input').length")
    _go(page, "excite")
    page.until(f"({_section('excite')}.querySelector('.state') || {{}}).textContent?.startsWith('running')")
    _click(page, "excite", "Cancel")
    page.until(f"{_section('excite')}.querySelector('.state').textContent.startsWith('cancelled')")
    assert client.names() == []
    _nothing_wrong(page, running)


def test_what_is_entered_is_there_after_a_reload(page: Any, running: Any, client: Any, logs: tuple[Path, Path]) -> None:
    """Numbers, lists, boxes and columns that are not saved; a choice that all stages share stays theirs."""
    train, test = (client.upload(log.name, log.read_bytes()) for log in logs)
    client.upload("arm.yaml", f"case: 1\nrobot: generic-scara\ntrain: {train}\n".encode())
    client.upload("other.yaml", f"case: 1\nrobot: generic-scara\ntrain: {test}\n".encode())
    page.call("Page.reload")
    page.until("document.querySelectorAll('#stages a').length")
    entered = {
        "excite": {"Period [s]": "7.5", "Criterion": "condition", "Case or robot": "generic-7r", "Target": "krl"},
        "identify": {"Case": "other.yaml", "Estimator": "wls", "Cut-off [Hz]": "4.5"},
        "case": {"Unit of position": "deg"},
        "compare": {"Longest time of each [s]": "9"},
    }
    ticked = {"excite": ("Friction parts", "viscous"), "case": ("Test logs", test), "compare": ("Estimators", "huber")}

    def control(stage: str, label: str) -> str:
        return (
            f"[...{_section(stage)}.querySelectorAll('.field')]"
            f".find(one => one.querySelector('legend, label').textContent === {label!r})"
            "?.querySelector('select, input')"
        )

    def several(stage: str, label: str) -> str:
        lists = f"[...{_section(stage)}.querySelectorAll('.several')]"
        return f"{lists}.find(one => one.querySelector('legend').textContent === {label!r})"

    for stage, fields in entered.items():
        _go(page, stage)
        for label, value in fields.items():
            page.until(f"{control(stage, label)}?.tagName === 'INPUT' || {control(stage, label)}?.options.length > 1")
            _choose(page, stage, label, value)
    for stage, (label, name) in ticked.items():
        page.js(f"[...{several(stage, label)}.querySelectorAll('input')].find(one => one.value === {name!r}).click()")
    page.js(f"{_section('identify')}.querySelector('#quick').click()")
    page.call("Page.reload")
    page.until("document.querySelectorAll('#stages a').length")
    for stage, fields in entered.items():
        _go(page, stage)
        for label, value in fields.items():
            page.until(f"{control(stage, label)}?.value === {value!r}")
    for stage, (label, name) in ticked.items():
        page.until(f"{several(stage, label)}.picked().includes({name!r})")
    assert page.js(f"{_section('identify')}.querySelector('#quick').checked")
    assert page.js(f"{control('compare', 'Case')}.value") == "other.yaml"
    _nothing_wrong(page, running)


@pytest.mark.battery
def test_a_mesh_that_was_missing_is_drawn_when_it_is_dropped(page: Any, running: Any, tmp_path: Path) -> None:
    robot, mesh = tmp_path / "arm.urdf", tmp_path / "arm.stl"
    robot.write_text(
        "<robot name='arm'><link name='base'/><link name='arm'><collision><geometry>"
        "<mesh filename='package://arm_description/meshes/arm.stl'/></geometry></collision></link>"
        "<joint name='j' type='continuous'><parent link='base'/><child link='arm'/></joint></robot>"
    )
    corners = 0.3 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.0]])
    facets = [corners[list(three)].astype("<f4").tobytes() for three in ((0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3))]
    mesh.write_bytes(bytes(80) + (4).to_bytes(4, "little") + b"".join(bytes(12) + one + bytes(2) for one in facets))
    page.choose_files("section:not([hidden]) input[type=file]", robot)
    remarks = f"[...{_section('robot')}.querySelectorAll('.remark')].map(one => one.textContent).join()"
    page.until(f"{remarks}.includes('arm_description/meshes/arm.stl')")
    page.js("import('/static/viewer.js').then(one => { window.viewer = one.viewer; })")
    page.until("window.viewer && viewer.robot && viewer.robot.scene.robot === 'arm'")
    assert page.js("viewer.robot.layers.shapes.length") == 0
    page.choose_files("section:not([hidden]) input[type=file]", mesh)
    page.until("viewer.robot.layers.shapes.length === 1 && viewer.robot.layers.shapes[0].visible")
    assert page.js("viewer.robot.layers.shapes[0].geometry.attributes.position.count") == 12
    assert page.js(remarks) == "" and page.js("viewer.robot.layers.capsules.every(one => !one.visible)")
    _nothing_wrong(page, running)


@pytest.mark.battery
def test_a_slow_disk_mixes_nothing_up(page: Any, running: Any, client: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("slow.yaml", "fast.yaml"):
        client.upload(name, f"case: 1\nrobot: generic-scara\nnote: {name}\n".encode())
    page.call("Page.reload")
    page.until("document.querySelectorAll('#stages a').length")
    _go(page, "case")
    _choose(page, "case", "Case file", "fast.yaml")
    area = f"{_section('case')}.querySelector('textarea')"
    page.until(f"{area}?.value.includes('note: fast.yaml')")
    answer = views.case_view

    def slow(folder: Any, name: str) -> dict[str, Any]:
        time.sleep(1.0 if name == "slow.yaml" else 0.0)
        return answer(folder, name)

    monkeypatch.setattr(views, "case_view", slow)
    _choose(page, "case", "Case file", "slow.yaml")
    _choose(page, "case", "Case file", "fast.yaml")
    page.until(f"{area}?.value.includes('note: fast.yaml')")
    time.sleep(1.3)
    assert "note: fast.yaml" in page.js(f"{area}.value")  # the answer for the other one came later
    _choose(page, "case", "Case file", "slow.yaml")
    page.until(f"{area}?.value.includes('note: slow.yaml')")
    page.js(f"{area}.value += '# more\\n'")
    walk = Walk(page)
    walk.press("section:not([hidden]) button", "Save the text")
    assert page.js(f"{area}.closest('[inert]') !== null")  # a second click meets nothing
    page.until(f"!{area}.closest('[inert]')")
    assert client.get("/api/case?name=slow.yaml")["text"].endswith("# more\n")
    said = page.js("document.querySelector('#said').textContent")
    assert said.startswith("saved")
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
    second = client.run("identify", case=case, estimator="ols", quick=True)
    estimates = [done["outputs"][0], second["outputs"][0]]
    for verb, choices in (
        ("check", {"case": case}),
        ("validate", {"estimate": estimates[0], "logs": names[1:]}),
        ("diff", {"estimates": estimates}),
        ("export", {"file": estimates[0], "to": "urdf"}),
    ):
        ended = client.run(verb, **choices)
        assert ended["state"] == "done", ended["progress"]
    page.call("Page.setBypassCSP", enabled=True)  # for axe alone
    page.call("Page.reload")
    page.until("document.querySelectorAll('.sliders input').length")
    page.js(Path(spec.origin).with_name("axe.min.js").read_text(encoding="utf-8") + ";0")
    faults = (
        "axe.run(document, {resultTypes: ['violations'], iframes: false}).then(found => found.violations"
        ".map(one => `${one.id}: ${one.nodes[0].html.slice(0, 200)}`))"
    )
    shown = {"check": ".good, .fault", "results": ".run .answers", "compare": ".run .chart svg"}
    for width, dark in ((1440, False), (768, False), (390, True)):
        page.size(width, 900, dark)
        for stage in STAGES:
            _go(page, stage)
            if stage in shown:
                page.until(f"{_section(stage)}.querySelector({shown[stage]!r})", 60)
            assert page.js("document.documentElement.scrollWidth") <= width, (stage, width)
            if stage == "results":
                page.until(f"{_section('results')}.querySelector('iframe')", 60)
            assert page.js(faults) == [], (stage, width)


class Walk:
    """A user with a mouse: every press is a click of the browser on what lies on top there.

    Attributes:
        clicks: How many there were, a choice in a list or a file dialog counted as two.
    """

    def __init__(self, page: Any) -> None:
        self.page, self.clicks = page, 0

    def press(self, selector: str, text: str) -> None:
        """Click on the one element of the stage that is shown with this text."""
        found = f"[...document.querySelectorAll({selector!r})].find(one => one.textContent.startsWith({text!r})"
        found = f"({found} && one.offsetParent && !one.disabled))"
        self.page.until(found)
        place = (
            f"(() => {{ const one = {found}; one.scrollIntoView({{block: 'center', behavior: 'instant'}});"
            "const box = one.getBoundingClientRect(), [x, y] = [box.x + box.width / 2, box.y + box.height / 2];"
            "const top = document.elementFromPoint(x, y); return [x, y, one === top || one.contains(top)]; })()"
        )
        x, y, hit = self.page.js(place)
        while (now := self._later(place)) != [x, y, hit]:  # the page is still growing
            x, y, hit = now
        assert hit, f"something lies over {text}"
        for kind in ("mousePressed", "mouseReleased"):
            self.page.call("Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1)
        self.clicks += 1

    def _later(self, place: str) -> Any:
        time.sleep(0.15)
        return self.page.js(place)

    def go(self, stage: str) -> None:
        """Wait until a stage is shown, which a button has led to."""
        self.page.until(f"location.hash === '#/{stage}' && {_section(stage)} && !{_section(stage)}.hidden")

    def choose(self, stage: str, label: str, value: str) -> None:
        _choose(self.page, stage, label, value)
        self.clicks += 2

    def identify(self, *friction: str) -> None:
        """From a case that can be used over the checks to the result of a quick identification."""
        self.page.until(f"{_section('case')}.querySelector('p.good')", 30)
        self.press("section:not([hidden]) a.go", "Check the logs")
        self.go("check")
        self.press("section:not([hidden]) button", "Check the logs")
        self.page.until(f"{_section('check')}.querySelector('h2')", 120)
        self.press("section:not([hidden]) a.go", "Identify the model")
        self.go("identify")
        self.press("section:not([hidden]) summary", "More choices")
        if friction:
            _choose(self.page, "identify", "Friction", *friction)
        self.clicks += len(friction)
        self.press("section:not([hidden]) label", "quick")
        self.press("section:not([hidden]) button", "Identify")
        self.page.until(f"{_section('identify')}.querySelector('a.go')", 240)
        assert self.page.js(f"{_section('identify')}.querySelector('.answer dt').textContent").endswith("%")
        self.press("section:not([hidden]) a.go", "See the result")
        self.go("results")
        self.page.until(f"{_section('results')}.querySelector('.chart svg[role=img]')", 120)
        data = f"[...{_section('results')}.querySelectorAll('select')].map(one => one.value)"
        assert "test" in self.page.js(data)  # curves of data that had no part in the fit

    def export(self, target: str) -> None:
        """Export the estimate of the stage of results."""
        results = _section("results")
        self.page.until(f"[...{results}.querySelectorAll('option')].some(one => one.value === {target!r})")
        self.choose("results", "Target", target)
        self.press("section:not([hidden]) button", "Export")
        self.page.until(f"{results}.querySelector('.run table[role=table]')", 120)


@pytest.mark.battery
def test_from_an_empty_folder_to_an_exported_model_of_the_er16(
    page: Any, running: Any, client: Any, tmp_path: Path
) -> None:
    logs = [_er16_log(tmp_path / f"run{k}.csv", k) for k in (1, 2)]
    walk, begin = Walk(page), time.monotonic()
    walk.press("#stages a", "Log")
    walk.go("log")
    page.choose_files("section:not([hidden]) input[type=file]", *logs)
    walk.clicks += 2
    page.until(f"{_section('log')}.querySelector('.chart svg[role=img]')")
    log_plot = page.js(
        f"{_section('log')}.querySelector('.chart svg[role=img]').getBoundingClientRect().bottom + scrollY"
    )
    walk.press("section:not([hidden]) a.go", "Draft the case file")
    walk.go("case")
    walk.choose("case", "Robot", "er16")
    _choose(page, "case", "Training logs", "run1.csv")
    _choose(page, "case", "Test logs", "run2.csv")
    walk.clicks += 3  # the log that is shown is ticked already
    walk.press("section:not([hidden]) button", "Draft the case file")
    page.until(f"{_section('case')}.querySelector('textarea')", 60)
    assert "asks for the joints" in page.js(f"{_section('case')}.querySelector('.fault').textContent")
    walk.choose("case", "Unit of torque", "N m")
    walk.press("section:not([hidden]) button", "Save columns and units")
    walk.identify("coulomb", "viscous")
    results = _section("results")
    page.until(
        f"{results}.querySelector('.answers') && {results}.querySelectorAll('.chart svg[role=img]').length === 6", 60
    )
    plot = page.js(f"{results}.querySelector('.chart svg[role=img]').getBoundingClientRect().bottom + scrollY")
    assert max(plot, log_plot) < 900  # pixels: the first plot of a log and of a result stand on the first screen
    walk.export("mjcf")
    assert "MuJoCo" in page.js(f"{results}.querySelector('.run table[role=table]').textContent")
    seconds = time.monotonic() - begin
    sys.stdout.write(f"from an empty folder to an exported model: {walk.clicks} clicks, {seconds:.1f} s\n")
    assert walk.clicks <= 28 and "exported_1.xml" in client.names()
    walk.press("section:not([hidden]) a.go", "All files of the session")
    walk.go("session")
    page.until(f"{_section('session')}.querySelector('.command code')")
    commands = page.js(f"{_section('session')}.querySelector('.command code').textContent")
    ran = [line.split()[:2] for line in commands.splitlines() if line.startswith(("dynident ", "cat "))]
    verbs = [words[1] if words[0] == "dynident" else words[0] for words in ran]
    assert verbs == ["init", "cat", "check", "identify", "export"]
    _nothing_wrong(page, running)
    again = tmp_path / "again"
    again.mkdir()
    for log in logs:
        shutil.copy(log, again)
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    subprocess.run(["sh", "-e"], input=commands, text=True, cwd=again, env={**os.environ, "PATH": path}, check=True)
    first, second = (read_estimate(folder / "estimate_1.json") for folder in (client.folder, again))
    np.testing.assert_array_equal(first.beta, second.beta)
    assert (again / "exported_1.xml").is_file()
    _stands_after_reload_and_in_a_second_tab(page, running)


def _stands_after_reload_and_in_a_second_tab(page: Any, running: Any) -> None:
    """The result of each stage, and text that is not saved, are there again."""
    _go(page, "case")
    page.js(
        f"(() => {{ const text = {_section('case')}.querySelector('textarea'); text.value += '# mine';"
        "text.dispatchEvent(new Event('input')); })()"
    )
    page.call("Page.reload")
    page.until("document.querySelectorAll('#stages a[data-state=done]').length >= 5")
    shown = {"check": ".findings, p.good", "identify": ".answers", "results": ".run table"}
    for stage, what in shown.items():
        _go(page, stage)
        page.until(f"{_section(stage)}.querySelector({what!r})")
    _go(page, "case")
    page.until(f"{_section('case')}.querySelector('textarea')?.value.endsWith('# mine')")
    states = page.js("[...document.querySelectorAll('#stages a')].map(one => one.dataset.state)")
    assert states == ["done", "done", "done", "done", "ready", "done", "done", "ready", ""]
    _nothing_wrong(page, running)


@pytest.mark.battery
def test_curves_and_robot_stand_at_one_time(page: Any, running: Any, client: Any, logs: tuple[Path, Path]) -> None:
    names = [client.upload(log.name, log.read_bytes()) for log in logs]
    text = f"case: 1\nrobot: generic-scara\ntrain: {names[0]}\nfriction: [coulomb, viscous]\n"
    done = client.run("identify", case=client.upload("arm.yaml", text.encode()), estimator="wls", quick=True)
    assert done["state"] == "done", done["progress"]
    page.call("Page.reload")
    page.until("document.querySelectorAll('#stages a').length")
    _go(page, "results")
    results = _section("results")
    page.until(f"{results}.querySelectorAll('.chart svg[role=img]').length === 8")
    page.until(f"!{results}.querySelector('.player button').disabled")
    page.js("import('/static/viewer.js').then(one => { window.viewer = one.viewer; })")
    page.until("window.viewer && viewer.robot && viewer.robot.positions")
    assert page.js("viewer.robot.layers.ellipsoids.length && viewer.robot.layers.ellipsoids.every(one => !one.visible)")
    chart = f"{results}.querySelector('.chart svg[role=img]')"
    page.js(f"{chart}.scrollIntoView({{block: 'center'}})")
    x, y, wide = page.js(
        f"(() => {{ const box = {chart}.getBoundingClientRect(); return [box.x, box.y, box.width]; }})()"
    )
    page.call("Input.dispatchMouseEvent", type="mouseMoved", x=x + 0.6 * wide, y=y + 60)
    lines = f"[...{results}.querySelectorAll('.chart .cursor')].map(one => +one.getAttribute('x1'))"
    page.until(f"{lines}.every(at => Math.abs(at - {0.6 * wide}) < 2)")
    motion = client.get("/api/estimate?name=estimate_1.json")["motion"]
    clock = page.js(f"{results}.querySelector('.stage3d output.soft').textContent")
    seconds = float(clock.split()[0])
    expected = [np.interp(seconds, motion["time"], column) for column in np.transpose(motion["q"])]
    np.testing.assert_allclose(page.js("viewer.robot.positions"), expected, atol=2e-3)
    before = page.js(lines)
    page.js(f"{results}.querySelector('.player button').click()")
    page.until(f"{lines}[7] > {before[7] + 3}")  # the player moves the cursor of the last curve
    _nothing_wrong(page, running)
    done = client.run("identify", case="arm.yaml", estimator="ols", quick=True)
    assert done["state"] == "done", done["progress"]
    page.call("Page.reload")
    page.until("document.querySelectorAll('#stages a').length")
    _go(page, "compare")
    _choose(page, "compare", "Estimates", "estimate_1.json", "estimate_2.json")
    _click(page, "compare", "Put them side by side")
    page.until(f"{_section('compare')}.querySelectorAll('.run .chart svg[role=img]').length === 4", 60)
    assert page.js(f"{_section('compare')}.querySelector('.run table').rows.length") == 3
    _nothing_wrong(page, running)


#: Folder, training and test logs, drive gains in N m/A where logs hold currents (UR10e: De Luca's), largest error in %.
REAL = [
    ("panda_gaz2019", ["exciting_traj_1.csv"], [], [], 1.0),
    (
        "ur10e_mamedov",
        ["ident_20_02_06_20sec_10harm.csv", "ident_20_02_10_30sec_12harm.csv"],
        ["ident_20_02_12_40sec_12harm.csv"],
        [14.87, 13.26, 11.13, 10.62, 11.03, 11.47],
        6.0,
    ),
]


@pytest.mark.battery
@pytest.mark.parametrize(("name", "train", "test", "gains", "worst"), REAL, ids=[one[0] for one in REAL])
def test_the_main_path_on_a_real_set(
    page: Any,
    running: Any,
    client: Any,
    name: str,
    train: list[str],
    test: list[str],
    gains: list[float],
    worst: float,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    folder = real(name, monkeypatch)
    walk, begin = Walk(page), time.monotonic()
    page.choose_files("section:not([hidden]) input[type=file]", folder / "robot.urdf")
    page.until("document.querySelector('#robot-choice').value === 'robot.urdf'")
    walk.press("section:not([hidden]) a.go", "Add logs")
    walk.go("log")
    page.choose_files("section:not([hidden]) input[type=file]", *(folder / log for log in (*train, *test)))
    page.until(f"{_section('log')}.querySelector('svg')", 30)
    walk.press("section:not([hidden]) a.go", "Draft the case file")
    walk.go("case")
    for label, logs in (("Training logs", train), ("Test logs", test)):
        if logs:
            _choose(page, "case", label, *logs)
    walk.clicks += 4 + len(train) + len(test)  # with the two file dialogs
    walk.press("section:not([hidden]) button", "Draft the case file")
    area = f"{_section('case')}.querySelector('textarea')"
    page.until(area, 60)
    assert page.js(f"{area}.value.split('gain: ask').length - 1") == len(gains)
    for gain in gains:
        page.js(f"{area}.value = {area}.value.replace('gain: ask', 'gain: {gain}')")
    if gains:
        walk.press("section:not([hidden]) button", "Save the text")
    walk.identify()
    page.until(f"{_section('results')}.querySelector('.answers') && {_section('results')}.querySelector('iframe')", 120)
    error = page.js(f"{_section('results')}.querySelector('.answer dt').textContent")
    assert float(error.split()[0].rstrip("%")) < worst
    walk.export("urdf")
    sys.stdout.write(f"{name}: {walk.clicks} clicks, {time.monotonic() - begin:.1f} s, test error {error}\n")
    assert read_estimate(client.folder / "estimate_1.json").model.robot.dof == read_robot(folder / "robot.urdf").dof
    assert read_robot(client.folder / "exported_1.urdf").nominal is not None
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
