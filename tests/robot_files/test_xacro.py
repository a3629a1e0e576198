"""Xacro files: expanded without ROS, with arguments; each missing thing is one line with file, place and remedy."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

import dynident as di
from dynident.cli.main import main
from dynident.errors import BadOption, DescriptionError, MissingDependency
from dynident.robot_files import read_robot
from dynident.robot_files.xacro import is_xacro, split_arguments, with_arguments
from two_joint_arm import URDF

pytest.importorskip("xacro", reason="xacro files need the package xacro (extra xacro)")

Capture = pytest.CaptureFixture[str]

#: A macro with parameters, an include from a package, a condition, an expression, arguments with and without default.
TOP = """<?xml version="1.0"?>
<robot name="two" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="length"/>
  <xacro:arg name="with_tool" default="false"/>
  <xacro:include filename="$(find arm_description)/urdf/link.xacro"/>
  <link name="base"/>
  <xacro:bar name="upper" parent="base" length="$(arg length)" at="0"/>
  <xacro:bar name="fore" parent="upper" length="${0.5 * $(arg length)}" at="$(arg length)"/>
  <xacro:if value="$(arg with_tool)">
    <xacro:bar name="tool" parent="fore" length="0.1" at="${0.5 * $(arg length)}"/>
  </xacro:if>
</robot>
"""
LINK = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:property name="density" value="4.0"/>
  <xacro:macro name="bar" params="name parent length at">
    <xacro:property name="bent" value="${density * length**3 / 12}"/>
    <link name="${name}">
      <inertial>
        <origin xyz="${length / 2} 0 0"/><mass value="${density * length}"/>
        <inertia ixx="1e-3" ixy="0" ixz="0" iyy="${bent}" iyz="0" izz="${bent}"/>
      </inertial>
      <collision><geometry><mesh filename="package://arm_description/meshes/${name}.stl"/></geometry></collision>
    </link>
    <joint name="${name}_joint" type="continuous">
      <origin xyz="${at} 0 0"/><parent link="${parent}"/><child link="${name}"/><axis xyz="0 1 0"/>
    </joint>
  </xacro:macro>
</robot>
"""


@pytest.fixture
def workspace(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ROS workspace with a package that has macros, and the robot in another one."""
    for name, text in {
        "src/arm_description/package.xml": "<package><name>arm_description</name></package>",
        "src/arm_description/urdf/link.xacro": LINK,
        "src/robot/package.xml": "<package><name>robot</name></package>",
        "src/robot/arm.urdf.xacro": TOP,
    }.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)
    monkeypatch.chdir(tmp_path)
    return tmp_path


FILE = "src/robot/arm.urdf.xacro"


def test_the_torques_are_those_of_the_numbers(workspace: Path) -> None:
    """Two bars of 0.8 and 0.4 m, 3.2 and 1.6 kg, at rest and stretched out: closed form of their weight."""
    robot = read_robot(f"{FILE} length:=0.8")
    assert (robot.name, robot.joint_names) == ("two", ("upper_joint", "fore_joint"))
    model = di.DynamicModel(robot)
    gravity = model.gravity(np.zeros(2))
    np.testing.assert_allclose(np.abs(gravity), 9.81 * np.array([3.2 * 0.4 + 1.6 * 1.0, 1.6 * 0.2]), rtol=1e-12)
    assert read_robot(f"{FILE} length:=0.8 with_tool:=true").dof == 3
    assert robot.note == "read from arm.urdf.xacro (expanded)"


def test_pinocchio_reads_the_same(workspace: Path) -> None:
    pin = pytest.importorskip("pinocchio")
    from dynident.robot_files.reading import robot_text

    found = robot_text(f"{FILE} length:=0.7 with_tool:=true")
    model = pin.buildModelFromXML(found.data.decode())
    robot, data = read_robot(f"{FILE} length:=0.7 with_tool:=true"), model.createData()
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 3))
    turned = np.column_stack([np.cos(q), np.sin(q)]).ravel()  # continuous joints
    expected = pin.rnea(model, data, turned, dq, ddq)
    np.testing.assert_allclose(di.DynamicModel(robot).torque(q, dq, ddq), expected, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        (FILE, "", r"line 3, <xacro:arg name='length'>: the argument length has no value and no default; give it: '"),
        (f"{FILE} lenght:=1 length:=1", "", r"the file has no argument lenght; it has .*; did you mean 'length'\?"),
        (f"{FILE} length:=1", "link.xacro", r"line 5, <xacro:include>: there is no file .*links\.xacro; check"),
        (f"{FILE} length:=1", "find arm_description", r"line 5, <xacro:include>: \$\(find arms\): no package arms"),
        (f"{FILE} length:=1", "</robot>", r"arm\.urdf\.xacro: line \d+: not XML \("),
        (f"{FILE} length:=one", "", r"link.xacro: line 7, <origin>: .*, or the arguments \(given: length:=one\)"),
        (f"{FILE} length:=1", '<xacro:bar name="fore"', r"<xacro:bars name='fore'>: unknown macro bars;.*'bar'"),
    ],
)  # fmt: skip
def test_what_is_missing_is_one_line(name: str, text: str, told: str, workspace: Path) -> None:
    replaced = {
        "link.xacro": "links.xacro",
        "find arm_description": "find arms",
        "</robot>": "</robots>",
        '<xacro:bar name="fore"': '<xacro:bars name="fore"',
    }
    assert not text or text in TOP
    Path(FILE).write_text(TOP.replace(text, replaced[text]) if text else TOP)
    with pytest.raises(DescriptionError, match=told) as caught:
        read_robot(name)
    assert "\n" not in str(caught.value)
    assert main(["inspect", name]) == 1


#: What stands in line 3 of a file, and how the fault is told.
FAULTS = {
    "a name": ('<link name="${foo}"/>', r"line 3, <link name='\$\{foo\}'>: foo is not defined in \$\{foo\}; define it"),
    "an argument as a property": (
        '<xacro:arg name="size" default="1"/><link name="${size}"/>',
        r"size is not defined in \$\{size\}; write \$\(arg size\): it is an argument",
    ),
    "a macro": ('<xacro:wheel a="1"/>', r"line 3, <xacro:wheel>: unknown macro wheel; .* did you mean 'wheels'\?"),
    "a parameter without value": ("<xacro:wheels/>", r"line 3, <xacro:wheels>: the macro needs side, .*; write side="),
    "a parameter too many": (
        '<xacro:wheels side="1" sid="2"/>', r"line 3, <xacro:wheels>: the macro has no parameter sid; it has side; did"
    ),
    "a call without end": ("<xacro:ring/>", r"line 2, <xacro:ring>: recursion without end, .*line 3\); does"),
    "a division": (
        '<xacro:property name="q" value="${1/0}"/><link name="${q}"/>', r"line 3, <link .*division by zero in \$\{1/0\}"
    ),
    "the environment": ('<link name="$(env NOT_SET)"/>', r"line 3, <link .* no variable NOT_SET; set it, or write"),
    "a condition": ('<xacro:if value="maybe"/>', r'line 3, <xacro:if>: conditional "maybe" .*; write true, false,'),
    "an expression of ROS": ('<link name="$(eval 1+)"/>', r"line 3, <link .*: xacro: invalid syntax; correct it$"),
    "a missing YAML": (
        "<xacro:property name='y' value=\"${xacro.load_yaml('no.yaml')}\"/><link name='${y}'/>",
        r"line 3, <link .*: load_yaml: there is no file .*no\.yaml; check the path",
    ),
    "an attribute of xacro": ("<xacro:include/>", r"line 3, <xacro:include>: no attribute 'filename'; write filename="),
    "within a macro": (
        '<xacro:wheels side="${nix}"/>', r"line 3, <xacro:wheels>: nix is not defined in \$\{nix\}; define it above"
    ),
    "within the body of a macro": (
        "<xacro:broken/>", r"line 2, <mass>: nowhere is not defined in .* \(in the call <xacro:broken>, line 3"
    ),
}  # fmt: skip
MACROS = (
    '<xacro:macro name="wheels" params="side"><link name="${side}"/></xacro:macro>'
    '<xacro:macro name="ring"><xacro:ring/></xacro:macro>'
    '<xacro:macro name="broken"><link name="l"><inertial><mass value="${nowhere}"/></inertial></link></xacro:macro>'
)


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_has_its_line_and_element(name: str, workspace: Path) -> None:
    line, told = FAULTS[name]
    head = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
    Path("r.xacro").write_text(f"{head}\n{MACROS}\n{line}\n</robot>\n")
    with pytest.raises(DescriptionError, match=told) as caught:
        read_robot("r.xacro")
    message = str(caught.value)
    assert message.startswith("r.xacro: line ") and "given: none" not in message and "<class" not in message
    assert "\n" not in message


def test_a_fault_in_an_included_file_names_that_file(workspace: Path) -> None:
    link = Path("src/arm_description/urdf/link.xacro")
    link.write_text(LINK.replace("${bent}", "${bend}"))
    with pytest.raises(DescriptionError, match=r"link\.xacro: line 8, <inertia>: bend is not .* did you mean 'bent'\?"):
        read_robot(f"{FILE} length:=1")


def test_an_argument_that_no_element_declares(workspace: Path, capsys: Capture) -> None:
    """The package takes it where the file uses it; so does the remedy of the message that it lacks."""
    Path(FILE).write_text(TOP.replace('  <xacro:arg name="length"/>\n', ""))
    with pytest.raises(DescriptionError, match=r"line 6, <xacro:bar name='upper'>: the argument length has no value"):
        read_robot(FILE)
    assert read_robot(f"{FILE} length:=0.8").dof == 2
    with pytest.raises(DescriptionError, match=r"no argument lengt; it has length, with_tool; did you mean 'length'\?"):
        read_robot(f"{FILE} length:=0.8 lengt:=1")
    Path(FILE).write_text(
        TOP.replace('"true"', '"false"').replace("<link", '<xacro:if value="0">$(arg n)</xacro:if><link')
    )
    assert read_robot(f"{FILE} length:=0.8 n:=1").dof == 2  # used in a part that is left out


def test_an_argument_before_its_declaration(workspace: Path) -> None:
    Path(FILE).write_text(
        TOP.replace('name="two"', 'name="$(arg name)"').replace("  <link", '<xacro:arg name="name" default="x"/><link')
    )
    told = r"line 2, <robot .*: the argument name is used before it is declared \(line 6\); move <xacro:arg .* above"
    with pytest.raises(DescriptionError, match=told):
        read_robot(f"{FILE} length:=1")
    assert read_robot(f"{FILE} length:=1 name:=other").name == "other"


@pytest.mark.parametrize("argument", ["length:='a", "n:=it's", 'n:="'])
def test_a_quote_that_is_left_open(argument: str, workspace: Path) -> None:
    with pytest.raises(BadOption, match="close the quote"):
        read_robot(f"{FILE} {argument}")
    assert main(["inspect", f"{FILE} {argument}"]) == 1


def test_arguments_without_quotes(workspace: Path, capsys: Capture) -> None:
    """As the program xacro takes them: words of their own behind the file, before or after other options."""
    assert main(["inspect", FILE, "length:=0.8", "with_tool:=true", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["joints"][2]["name"] == "tool_joint"
    assert main(["inspect", f"{FILE} length:=0.8", "--json", "with_tool:=true"]) == 0
    assert len(json.loads(capsys.readouterr().out)["joints"]) == 3
    assert main(["inspect", FILE, "length:=it's"]) == 1
    assert "given: length:=it's" in capsys.readouterr().err
    assert main(["inspect", "er16", "length:=0.8"]) == 2
    assert "arguments follow a xacro file: 'inspect FILE.urdf.xacro length:=0.8'" in capsys.readouterr().err


def test_the_expanded_urdf_has_lines(workspace: Path) -> None:
    from dynident.robot_files.reading import robot_text

    lines = robot_text(f"{FILE} length:=0.8").data.decode().splitlines()
    assert lines[0] == '<robot name="two">' and '  <link name="base"/>' in lines and len(lines) > 30


def test_a_remedy_works(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A package elsewhere is found by the variables of ROS 1 and ROS 2, as the message says."""
    (workspace / "elsewhere").mkdir()
    (workspace / "src" / "arm_description").rename(workspace / "elsewhere" / "arms-1.2")
    with pytest.raises(DescriptionError, match=r"no package arm_description .*ROS_PACKAGE_PATH=FOLDER"):
        read_robot(f"{FILE} length:=1")
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(workspace / "elsewhere"))
    assert read_robot(f"{FILE} length:=1").dof == 2
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    (workspace / "install" / "share").mkdir(parents=True)
    (workspace / "elsewhere" / "arms-1.2").rename(workspace / "install" / "share" / "arm_description")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(workspace / "install"))
    assert read_robot(f"{FILE} length:=1").dof == 2


def test_a_macro_that_does_not_end(workspace: Path) -> None:
    Path(FILE).write_text(
        '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:macro name="a"><xacro:a/></xacro:macro>'
        '<xacro:a/><link name="l"/></robot>'
    )
    with pytest.raises(DescriptionError, match="xacro"):
        read_robot(FILE)


@pytest.mark.parametrize(
    ("name", "inside", "told"),
    [("${'a\\ud800'}", "<link name='l'/>", "line 1: not XML"), ("${1}", 5000 * "<a>" + 5000 * "</a>", "recursion")],
)
def test_what_expands_to_no_text_is_refused(name: str, inside: str, told: str, workspace: Path) -> None:
    """Half of a pair of code units, which no file can hold, and elements nested too deep to be written."""
    Path(FILE).write_text(f'<robot name="{name}" xmlns:xacro="http://www.ros.org/wiki/xacro">{inside}</robot>')
    with pytest.raises(DescriptionError, match=told):
        read_robot(FILE)


def test_arguments_of_other_files(workspace: Path) -> None:
    Path("arm.urdf").write_text(URDF)
    with pytest.raises(BadOption, match=r"arm\.urdf is no xacro: it has no arguments"):
        read_robot("arm.urdf length:=1")
    with pytest.raises(BadOption, match="state the argument a once"):
        read_robot("arm.urdf a:=1 a:=2")
    Path("macro.urdf").write_text(URDF.replace("</robot>", '<xacro:arm prefix=""/></robot>'))
    with pytest.raises(DescriptionError, match=r"macro\.urdf: .*unbound prefix"):  # a macro makes any file a xacro
        read_robot("macro.urdf")
    Path("arm.xacro").write_text(URDF)  # without macros it is read as it is
    assert read_robot("arm.xacro").note == "read from arm.xacro"


@pytest.mark.parametrize("arguments", [{}, {"a": "1"}, {"a": "x y", "b": "", "c": "it's"}])
def test_names_with_arguments(arguments: dict[str, str]) -> None:
    assert split_arguments(with_arguments("my arm.xacro", arguments)) == ("my arm.xacro", arguments)


def test_what_is_a_xacro() -> None:
    assert not is_xacro("a.urdf", b"<robot><!-- <xacro:arm/> --><link/><!-- ${n} --></robot>")
    assert is_xacro("a.urdf", b"<robot><!-- old --><xacro:arm/><!-- end --></robot>")
    assert is_xacro("a.urdf", b"<robot><xacro:if/></robot>") and is_xacro("a.xacro", b"<robot name='$(arg n)'/>")
    assert not is_xacro("a.urdf", b"<robot><gazebo>$(find x)</gazebo></robot>") and not is_xacro("a.xacro", b"<robot/>")


def test_a_case_file_and_the_urdf_of_the_result(workspace: Path, capsys: Capture) -> None:
    """From a case with arguments to an estimate, and back: the xacro stays, its expanded URDF gets the values."""
    Path("case.yaml").write_text(
        f"case: 1\nrobot: {{file: {FILE}, arguments: {{length: 0.8, with_tool: false}}}}\nfriction: [viscous]\n"
    )
    case = di.read_case("case.yaml")
    assert case.robot_path == f"{FILE} length:=0.8 with_tool:=false" and case.robot.dof == 2
    theta = np.array(case.model.nominal())
    theta[-2:] = 0.3, 0.2
    t = np.arange(0, 4, 0.01)
    phase = t[:, None] * [1.7, 2.9]
    rates = np.array([1.7, 2.9])
    states = np.sin(phase), rates * np.cos(phase), -(rates**2) * np.sin(phase)
    log = di.Log(case.robot.joint_names, t, *states, torque=case.model.torque(*states, theta))
    di.write_log(log, "run.csv")
    estimate = di.identify("case.yaml", "run.csv", "wls", trust=di.TrustOptions())
    assert estimate.provenance["robot"]["arguments"] == {"length": "0.8", "with_tool": "false"}
    estimate.save("estimate.json")
    before = Path(FILE).read_bytes()
    capsys.readouterr()
    assert main(["export", "estimate.json", "--to", "urdf", "-o", "out.urdf", "--force"]) == 0
    told = " ".join("".join(capsys.readouterr()).split())
    assert "is a xacro, whose numbers are expressions: it is not changed, its expanded URDF is" in told
    assert Path(FILE).read_bytes() == before and b"xacro:" not in Path("out.urdf").read_bytes()
    found = di.DynamicModel(read_robot("out.urdf"), ["viscous"])
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 10, 2))
    np.testing.assert_allclose(found.torque(q, dq, ddq), estimate.predict(q, dq, ddq), rtol=0.0, atol=1e-6)
    assert main(["export", "estimate.json", "--to", "urdf", "-o", FILE, "--force"]) == 1
    assert Path(FILE).read_bytes() == before


def test_a_draft_names_the_arguments(workspace: Path) -> None:
    robot = read_robot(f"{FILE} length:=0.8")
    t = np.arange(0, 3, 0.01)
    q = np.sin(t[:, None] * [1.7, 2.9])
    di.write_log(di.Log(robot.joint_names, t, q, torque=q), "run.csv")
    assert main(["init", f"{FILE} length:=0.8", "run.csv", "-o", "case.yaml"]) == 0
    text = Path("case.yaml").read_text()
    assert re.search(rf"^robot: .*{re.escape(FILE)} length:=0\.8", text, re.MULTILINE), text
    named = next(line for line in text.splitlines() if line.startswith("robot:"))
    Path("short.yaml").write_text(f"case: 1\n{named}\n")
    assert di.read_case("short.yaml").robot.dof == 2


def test_missing_meshes_are_named_one_by_one(workspace: Path, capsys: Capture) -> None:
    assert main(["inspect", f"{FILE} length:=1"]) == 0
    shown = capsys.readouterr().out
    assert "2 of 2 meshes are missing" in shown
    assert "    fore: package://arm_description/meshes/fore.stl" in shown.splitlines() and "  no such file:\n" in shown
    (workspace / "src/arm_description/meshes").mkdir()
    (workspace / "src/arm_description/meshes/fore.stl").write_bytes(b"solid")
    assert main(["inspect", f"{FILE} length:=1"]) == 0
    shown = capsys.readouterr().out
    missing, _, empty = shown.partition("meshes that say nothing about the size of their link:")
    assert "1 of 2 meshes are missing" in missing and "fore.stl" not in missing and "fore.stl" in empty
    assert main(["inspect", f"{FILE} length:=1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["robot"] == "two"


def test_without_the_package(workspace: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynident.robot_files.xacro.find_spec", lambda name: None)
    with pytest.raises(MissingDependency, match=r"needs the package 'xacro'; install it with: pip install .*\[xacro\]"):
        read_robot(f"{FILE} length:=1")
