"""USD stages: torques of Pinocchio from the numbers of the stage; what is no arm on a fixed base is refused by name."""

from __future__ import annotations

import importlib
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from usd_arms import Arm, arm_of, pinocchio_of, random_arm, write_stage

import dynident as di
from dynident.cli.main import main
from dynident.errors import DescriptionError, DynidentError, MissingDependency
from dynident.model.documents.robot_data import robot_to_dict
from dynident.model.joint import Drive
from dynident.model.shapes import Box
from dynident.robot_files import read_robot

Usd: Any = pytest.importorskip("pxr.Usd", reason="robot models in USD need usd-core (extra usd)")
Gf: Any = importlib.import_module("pxr.Gf")
Sdf: Any = importlib.import_module("pxr.Sdf")
UsdGeom: Any = importlib.import_module("pxr.UsdGeom")
UsdPhysics: Any = importlib.import_module("pxr.UsdPhysics")


def compared(arm: Arm, path: Path, gravity: Any) -> di.Robot:
    """Check the torques of the robot in a stage against Pinocchio, and return the robot."""
    pin = pytest.importorskip("pinocchio")
    robot = read_robot(path)
    np.testing.assert_allclose(robot.gravity, gravity, rtol=0.0, atol=1e-12)
    model, names = pinocchio_of(arm, gravity)
    data, order = model.createData(), [names.index(name) for name in robot.joint_names]
    states = np.random.default_rng(4).normal(size=(3, 10, len(names)))
    expected = np.array([pin.rnea(model, data, *state) for state in zip(*states, strict=True)])[:, order]
    q, dq, ddq = states[:, :, order]
    size = np.abs(expected).max()
    np.testing.assert_allclose(di.DynamicModel(robot).torque(q, dq, ddq) / size, expected / size, rtol=0.0, atol=1e-9)
    regressor, theta = di.DynamicModel(robot).regressor(q, dq, ddq), robot.nominal
    assert theta is not None
    np.testing.assert_allclose(regressor @ theta / size, expected / size, rtol=0.0, atol=1e-9)
    return robot


@pytest.mark.parametrize("seed", range(8))
def test_torques_of_random_arms(seed: int, tmp_path: Path) -> None:
    """Frames of joints off the bodies, either body as the far one, fixed bodies, both kinds of joints."""
    arm = random_arm(seed, 5)
    write_stage(tmp_path / "arm.usda", arm)
    robot = compared(arm, tmp_path / "arm.usda", [0, 0, -9.81])
    assert robot.base == "world" and "body0" in robot.frames and robot.name == "arm"


@pytest.mark.parametrize("ending", [".usda", ".usdc", ".usd"])
def test_units_axes_and_kinds_of_files(ending: str, tmp_path: Path) -> None:
    """A stage in cm and g whose y axis is up: what most exporters of animation write."""
    arm = random_arm(20, 4, length=0.01, mass=0.001, up="Y")
    write_stage(tmp_path / f"arm{ending}", arm)
    compared(arm, tmp_path / f"arm{ending}", [0, -9.81, 0])


def test_gravity_of_the_scene(tmp_path: Path) -> None:
    arm = random_arm(21, 3, length=0.01)
    write_stage(tmp_path / "arm.usda", arm, ((0.0, 3.0, -4.0), 162.0))
    compared(arm, tmp_path / "arm.usda", np.array([0.0, 0.6, -0.8]) * float(np.float32(162.0)) * 0.01)


def test_a_built_in_robot_as_converters_write_it(tmp_path: Path) -> None:
    """To single precision, which the schema has: torques to 1e-6, limits, axes, link frames as they were."""
    robot = read_robot("generic-6r")
    robot = robot.with_drives({name: Drive() for name in robot.joint_names})  # the schema has no rotors
    write_stage(tmp_path / "arm.usda", arm_of(robot))
    found = read_robot(tmp_path / "arm.usda")
    q, dq, ddq = np.random.default_rng(1).normal(size=(3, 20, 6))
    expected = di.DynamicModel(robot).torque(q, dq, ddq)
    np.testing.assert_allclose(
        di.DynamicModel(found).torque(q, dq, ddq), expected, rtol=0.0, atol=1e-6 * np.abs(expected).max()
    )
    assert found.frames == {}  # each body turns about the origin of its prim
    for own, other in zip(robot.joints, found.joints, strict=True):
        np.testing.assert_allclose(own.axis, other.axis, rtol=0.0, atol=1e-7)
        np.testing.assert_allclose(own.rotation, other.rotation, rtol=0.0, atol=1e-6)
        assert (own.limits.lower, own.limits.upper) == pytest.approx((other.limits.lower, other.limits.upper))
    assert di.base_parameters(di.DynamicModel(found)).count == di.base_parameters(di.DynamicModel(robot)).count


@pytest.fixture
def stage(tmp_path: Path) -> Any:
    """The stage of a plain arm of two hinges, open for changes; ``save`` by stage.GetRootLayer().Save()."""

    arm = random_arm(3, 2)
    arm.hinges = [replace(hinge, kind="revolute" if k else "fixed") for k, hinge in enumerate(arm.hinges)]
    write_stage(tmp_path / "arm.usda", arm)
    return Usd.Stage.Open(str(tmp_path / "arm.usda"))


def again(stage: Any) -> di.Robot:
    stage.GetRootLayer().Save()
    return read_robot(stage.GetRootLayer().realPath)


def test_drives_and_what_physx_adds(stage: Any) -> None:

    first, second = (stage.GetPrimAtPath(f"/arm/joints/joint{k}") for k in (1, 2))
    passive = UsdPhysics.DriveAPI.Apply(first, "angular")
    passive.CreateDampingAttr(0.5)  # N m s/deg
    passive.CreateMaxForceAttr(80.0)
    servo = UsdPhysics.DriveAPI.Apply(second, "angular")
    servo.CreateStiffnessAttr(1000.0)
    servo.CreateDampingAttr(10.0)
    for name, value in (("armature", 0.25), ("maxJointVelocity", 180.0), ("jointFriction", 0.1)):
        second.CreateAttribute(f"physxJoint:{name}", Sdf.ValueTypeNames.Float).Set(value)
    robot = again(stage)
    one, other = robot.joints
    assert one.damping == pytest.approx(np.degrees(0.5)) and one.limits.effort == 80.0 and other.damping is None
    assert other.limits.velocity == pytest.approx(np.pi) and other.drive.rotor_inertia == 0.25
    assert "stiffness and damping of the drive of joint2 are gains of a controller and not read" in robot.note
    assert "the joint friction of PhysX of joint2 is not read" in robot.note
    passive.CreateTypeAttr("acceleration")
    robot = again(stage)
    assert robot.joints[0].damping is None
    assert "damping of the drive of joint1 is per inertia (type acceleration) and not read" in robot.note


def test_what_newton_adds(stage: Any) -> None:
    """Attributes of newton-usd-schemas, as the converters of URDF and MJCF write them."""
    first, second = (stage.GetPrimAtPath(f"/arm/joints/joint{k}") for k in (1, 2))
    for name, value in (("armature", 0.25), ("damping", 0.5), ("friction", 1.5), ("velocityLimit", 180.0)):
        first.CreateAttribute(f"newton:{name}", Sdf.ValueTypeNames.Float).Set(value)
    body = stage.GetPrimAtPath("/arm/body2")
    six = [0.03, 0.05, 0.04, 0.002, 0.001, -0.003]
    body.CreateAttribute("newton:inertia", Sdf.ValueTypeNames.DoubleArray).Set(six)
    robot = again(stage)
    one = robot.joints[0]
    assert (one.damping, one.friction, one.drive.rotor_inertia) == (pytest.approx(np.degrees(0.5)), 1.5, 0.25)
    assert one.limits.velocity == pytest.approx(np.pi)
    inertia = robot.links[1].inertia
    assert inertia is not None
    values = inertia.about_centre
    np.testing.assert_allclose(values[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], six, rtol=0.0, atol=1e-12)
    second.CreateRelationship("newton:mimicJoint").SetTargets(["/arm/joints/joint1"])
    second.CreateAttribute("newton:mimicCoef0", Sdf.ValueTypeNames.Float).Set(90.0)
    second.CreateAttribute("newton:mimicCoef1", Sdf.ValueTypeNames.Float).Set(-0.5)
    follow = again(stage).joints[1].mimic
    assert follow is not None and (follow.joint, follow.multiplier) == ("joint1", -0.5)
    assert follow.offset == pytest.approx(np.pi / 2)
    second.CreateRelationship("newton:mimicJoint").SetTargets(["/arm/body1"])
    with pytest.raises(DescriptionError, match="newton:mimicJoint names /arm/body1, which is no joint"):
        again(stage)


def test_inertia_that_is_not_stated_is_not_made_up(stage: Any, capsys: pytest.CaptureFixture[str]) -> None:

    mass = UsdPhysics.MassAPI(stage.GetPrimAtPath("/arm/body1"))
    mass.GetDiagonalInertiaAttr().Set(Gf.Vec3f(0, 0, 0))
    robot = again(stage)
    assert robot.links[0].inertia is None and robot.nominal is None
    assert "body1 states no diagonalInertia: simulators compute it from shapes" in robot.note
    assert main(["inspect", stage.GetRootLayer().realPath]) == 0
    told = "note: body1 states no diagonalInertia: simulators compute it from shapes"
    assert told in capsys.readouterr().out.splitlines()
    second, body = stage.GetPrimAtPath("/arm/joints/joint2"), stage.GetPrimAtPath("/arm/body2")
    second.SetTypeName("PhysicsFixedJoint")
    UsdPhysics.MassAPI(stage.GetPrimAtPath("/arm/body1")).GetDiagonalInertiaAttr().Set(Gf.Vec3f(1, 1, 1))
    assert again(stage).links[0].inertia is not None
    UsdPhysics.MassAPI(body).GetCenterOfMassAttr().Clear()
    assert again(stage).links[0].inertia is None  # it carries body2, whose centre is not known
    for name in ("mass", "centerOfMass", "diagonalInertia"):
        body.RemoveProperty(f"physics:{name}")
    assert again(stage).links[0].inertia is not None  # a frame without mass and shapes
    UsdPhysics.CollisionAPI.Apply(UsdGeom.Cube.Define(stage, "/arm/body2/shape").GetPrim())
    assert again(stage).links[0].inertia is None


def _loop(stage: Any) -> None:

    joint = UsdPhysics.RevoluteJoint.Define(stage, "/arm/joints/again")
    joint.CreateBody0Rel().SetTargets(["/arm/body0"])
    joint.CreateBody1Rel().SetTargets(["/arm/body2"])


def _ball(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/joints/joint2").SetTypeName("PhysicsSphericalJoint")


def _floating(stage: Any) -> None:
    stage.RemovePrim("/arm/joints/joint0")


def _scaled(stage: Any) -> None:

    UsdGeom.Xformable(stage.GetPrimAtPath("/arm/body1")).AddScaleOp().Set(Gf.Vec3f(2, 2, 2))


def _kinematic(stage: Any) -> None:

    UsdPhysics.RigidBodyAPI(stage.GetPrimAtPath("/arm/body1")).CreateKinematicEnabledAttr(True)


def _nowhere(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/joints/joint2").GetRelationship("physics:body1").SetTargets(["/arm/body9"])


def _locked(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/joints/joint2").GetAttribute("physics:lowerLimit").Set(1.0)
    stage.GetPrimAtPath("/arm/joints/joint2").GetAttribute("physics:upperLimit").Set(0.0)


def _negative(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/body1").GetAttribute("physics:mass").Set(-1.0)


def _missing_layer(stage: Any) -> None:
    stage.OverridePrim("/arm/tool").GetReferences().AddReference("parts/tool.usda")


def _no_physics(stage: Any) -> None:
    stage.RemovePrim("/arm")


def _still(stage: Any) -> None:
    for k in (1, 2):
        stage.GetPrimAtPath(f"/arm/joints/joint{k}").SetTypeName("PhysicsFixedJoint")


def _turned(stage: Any) -> None:

    stage.GetPrimAtPath("/arm/joints/joint2").GetAttribute("physics:localRot0").Set(Gf.Quatf(0.0))


def _mimic(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/joints/joint2").AddAppliedSchema("PhysxMimicJointAPI:rotX")


def _axis(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/joints/joint2").GetAttribute("physics:axis").Set("W")


def _no_limit(stage: Any) -> None:
    stage.GetPrimAtPath("/arm/joints/joint2").GetAttribute("physics:lowerLimit").Set(float("nan"))


def _unlimited(stage: Any) -> None:
    for name in ("physics:lowerLimit", "physics:upperLimit"):
        stage.GetPrimAtPath("/arm/joints/joint2").GetAttribute(name).Set(float("-inf"))


def _units(stage: Any) -> None:
    stage.SetMetadata("metersPerUnit", 1e300)


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (_axis, r"joint2: physics:axis is 'W'; write X, Y or Z"),
        (_no_limit, r"joint2: physics:lowerLimit is no number; write numbers"),
        (_unlimited, r"joint2: its limits are -inf and -inf; write the lower and the upper"),
        (_units, r"metersPerUnit is 1e\+300 and kilogramsPerUnit 1; write the units"),
        (_loop, r"prim /arm/joints/.*: it closes a loop between .*; remove one joint of the loop"),
        (_ball, r"prim /arm/joints/joint2: a joint of the type PhysicsSphericalJoint is not read; write it with"),
        (_floating, r"body0 and 2 more bodies are not joined to the world: the base floats; fix the base"),
        (_scaled, r"prim /arm/body1: the body is scaled by \(2, 2, 2\); apply the scale"),
        (_kinematic, r"prim /arm/body1: the body is kinematic, or not enabled"),
        (_nowhere, r"joint2: physics:body1 names /arm/body9, which is not there; name a body"),
        (_locked, r"joint2: its lower limit is above the upper one: it is locked; make it a PhysicsFixedJoint"),
        (_negative, r"prim /arm/body1: its mass is -1 "),
        (_missing_layer, r"a layer is missing: .*parts/tool\.usda; put them where the stage names them"),
        (_no_physics, r"no prim has the schema PhysicsRigidBodyAPI; export it with physics"),
        (_still, "no joint moves"),
        (_turned, r"joint2: physics:localRot0 has length 0, not 1"),
        (_mimic, r"joint2: it follows another joint \(a mimic joint of PhysX\)"),
    ],
)  # fmt: skip
def test_what_is_no_arm_is_refused(change: Any, told: str, stage: Any) -> None:
    change(stage)
    with pytest.raises(DescriptionError, match=told) as caught:
        again(stage)
    assert "\n" not in str(caught.value)


def test_objects_beside_an_arm_are_left_out_with_a_note(stage: Any) -> None:
    alone = again(stage)
    for name in ("box", "table", "pot", "lid"):
        prim = UsdGeom.Cube.Define(stage, f"/arm/{name}").GetPrim()
        UsdPhysics.RigidBodyAPI.Apply(prim).CreateKinematicEnabledAttr(name == "table")
        if name == "box":
            UsdGeom.Xformable(prim).AddScaleOp().Set(Gf.Vec3f(0.1, 0.2, 0))
    joint = UsdPhysics.FixedJoint.Define(stage, "/arm/on").GetPrim()
    for side, name in enumerate(("pot", "lid")):
        joint.GetRelationship(f"physics:body{side}").SetTargets([f"/arm/{name}"])
    note = "bodies that float freely beside the robot are left out (box, lid, pot, table)"
    assert robot_to_dict(again(stage)) == robot_to_dict(alone) | {"note": f"{alone.note}; {note}"}
    joint.SetTypeName("PhysicsRevoluteJoint")
    with pytest.raises(DescriptionError, match="box and 3 more bodies are not joined to the world"):
        again(stage)


def test_a_missing_layer_is_one_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """OpenUSD prints warnings of its own, past Python, where a sublayer is missing."""
    file = tmp_path / "arm.usda"
    file.write_text("#usda 1.0\n(\n    subLayers = [@gone.usda@]\n)\n")
    assert main(["inspect", str(file)]) == 1
    told = capfd.readouterr()
    assert told.out == "" and re.fullmatch(r"error: \S+arm\.usda: .*missing: gone\.usda; .*\n", told.err)


def test_no_usd(tmp_path: Path) -> None:
    for name, data, told in (
        ("a.usda", b"#usda 1.0\ndef Xform {", r"^\S+a\.usda: not USD \(line 2: [a-z ]+'def Xform {'"),
        ("b.usd", b"solid", "no USD by its first bytes"),
        ("c.usdc", b"PXR-USDC" + bytes(100), r"not USD \(Cannot read asset"),
    ):
        (tmp_path / name).write_bytes(data)
        with pytest.raises(DynidentError, match=told):
            read_robot(tmp_path / name)


def test_without_the_package(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "pxr.Usd", None)
    with pytest.raises(MissingDependency, match=r"needs the package 'usd-core'; install it with: pip .*\[usd\]"):
        read_robot(stage.GetRootLayer().realPath)


def identified_stage(folder: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Arm, di.Estimate]:
    """Return an arm whose stage is ``parts/arm.usda`` in a folder, and an estimate of it with other inertias."""
    monkeypatch.chdir(folder)
    Path("parts").mkdir()
    arm = random_arm(5, 3, length=0.01)
    arm.hinges = [replace(hinge, kind="revolute" if k else "fixed") for k, hinge in enumerate(arm.hinges)]
    arm.hinges[3] = replace(arm.hinges[3], kind="fixed")
    write_stage(Path("parts/arm.usda"), arm)
    robot = read_robot("parts/arm.usda")
    model = di.DynamicModel(robot, ["viscous"])
    nominal = model.nominal()
    assert nominal is not None
    theta = nominal.copy()
    theta[: model.inertial_count] *= 1.3
    theta[model.inertial_count :] = 0.2
    t = np.arange(0, 10, 0.01)
    rates = np.array([1.7, 2.9])
    phase = t[:, None] * rates
    states = np.sin(phase), rates * np.cos(phase), -(rates**2) * np.sin(phase)
    log = di.Log(robot.joint_names, t, *states, torque=model.torque(*states, theta))
    di.write_log(log, "run.csv")
    return arm, di.identify("parts/arm.usda", "run.csv", "consistent", trust=di.TrustOptions())


def test_identified_values_go_into_a_layer_over_the_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The stage stays as it is, the layer opens with it, and its torques are those of the estimate."""

    _, estimate = identified_stage(tmp_path, monkeypatch)
    open_stage = Usd.Stage.Open("parts/arm.usda")
    numbers = [2.0, 3.0, 2.5, 0.1, 0.2, -0.3]  # in kg cm^2: it goes before the diagonal, and has to change with it
    open_stage.GetPrimAtPath("/arm/body2").CreateAttribute(
        "newton:inertia", Sdf.ValueTypeNames.DoubleArray
    ).Set(numbers)  # fmt: skip
    open_stage.GetRootLayer().Save()
    before = Path("parts/arm.usda").read_bytes()
    found = di.write_usd_layer(estimate, "identified.usda", stage="parts/arm.usda")
    assert Path("parts/arm.usda").read_bytes() == before and found.relative < 2e-6
    text = Path("identified.usda").read_text()
    assert "@./parts/arm.usda@" in text and str(tmp_path) not in text
    stage = Usd.Stage.Open("identified.usda")
    assert UsdGeom.GetStageMetersPerUnit(stage) == pytest.approx(0.01) and stage.GetDefaultPrim().GetName() == "arm"
    robot = read_robot("identified.usda")
    q = np.random.default_rng(2).normal(size=(20, 2))
    gravity, expected = di.DynamicModel(robot).gravity(q), estimate.gravity(q)
    np.testing.assert_allclose(gravity, expected, rtol=0.0, atol=2e-6 * np.abs(expected).max())
    assert any("was identified as one body with the links fixed to it" in note for note in found.notes)


def test_the_command_writes_the_layer(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _, estimate = identified_stage(tmp_path, monkeypatch)
    estimate.save("estimate.json")
    capsys.readouterr()
    assert main(["export", "estimate.json", "--to", "usd", "-o", "identified.usda"]) == 0
    shown, said = capsys.readouterr()
    assert "read again by OpenUSD: torques differ by" in shown
    assert said.splitlines()[-1] == "saved identified.usda, a layer over parts/arm.usda"
    assert read_robot("identified.usda").dof == 2
    assert main(["export", "estimate.json", "--to", "usd", "-o", "b.usda", "--json"]) == 1
    assert "the target usd does without; leave it out" in capsys.readouterr().err and not Path("b.usda").exists()


def test_a_layer_that_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    arm, estimate = identified_stage(tmp_path, monkeypatch)
    with pytest.raises(di.BadArgument, match=r"path: 'a\.usd'; give a file that ends with \.usda"):
        di.write_usd_layer(estimate, "a.usd")
    with pytest.raises(DynidentError, match=r"parts/arm\.usda"):
        di.write_usd_layer(estimate, "parts/arm.usda")
    arm.hinges[2] = replace(arm.hinges[2], frames=(arm.hinges[2].frames[1], arm.hinges[2].frames[0]))
    write_stage(Path("other.usda"), arm)
    with pytest.raises(DescriptionError, match="it is another one than in the estimate"):
        di.write_usd_layer(estimate, "b.usda", stage="other.usda")
    assert not Path("a.usd").exists() and not Path("b.usda").exists()


@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("quatf physics:localRot0", "float3 physics:localRot0", r"faulty|not USD|no value of the type quatf"),
        (
            "float physics:mass = 2",
            "floaty physics:mass = 2",
            r"prim /arm/upper: physics:mass has no value of the type",
        ),
        ("point3f physics:localPos0", "rel physics:localPos0", r"faulty|not USD|no value of the type point3f"),
        (
            "(0, 0, 0.3)\n        uniform",
            "(0, 0, inf)\n        uniform",
            r"its transform holds a value that is no number",
        ),
        ('["xformOp:translate"]', '["xformOp:-0"]', r"faulty USD"),
        ("upAxis", "\xbc", r"not USD"),
    ],
)
def test_text_that_is_faulty_is_refused(old: str, new: str, told: str, tmp_path: Path) -> None:
    """Such files were found by fuzzing."""
    from fuzz.seeds import USD

    (tmp_path / "a.usda").write_text(USD)
    assert read_robot(tmp_path / "a.usda").dof == 2
    assert old in USD
    (tmp_path / "a.usda").write_bytes(USD.replace(old, new).encode("latin-1"))
    with pytest.raises(DescriptionError, match=told):
        read_robot(tmp_path / "a.usda")


def test_shapes_are_read_where_they_stand(stage: Any) -> None:
    """Units of 0.5 m; under a turned and scaled prim, about the link frame, collision shapes apart from drawn ones."""
    UsdGeom.SetStageMetersPerUnit(stage, 0.5)
    holder = UsdGeom.Xform.Define(stage, "/arm/body2/shapes")
    holder.AddTranslateOp().Set((0.1, 0.2, 0.3))
    holder.AddRotateZOp().Set(90.0)
    holder.AddScaleOp().Set((2.0, 2.0, 2.0))
    UsdPhysics.CollisionAPI.Apply(holder.GetPrim())
    path = "/arm/body2/shapes"
    UsdGeom.Sphere.Define(stage, f"{path}/a").CreateRadiusAttr(0.1)
    UsdGeom.Cube.Define(stage, f"{path}/b").AddScaleOp().Set((1.0, 2.0, 3.0))
    for kind, name in ((UsdGeom.Cylinder, "c"), (UsdGeom.Capsule, "d")):
        one = kind.Define(stage, f"{path}/{name}")
        one.CreateAxisAttr("X"), one.CreateRadiusAttr(0.1), one.CreateHeightAttr(0.6)
    UsdGeom.Mesh.Define(stage, f"{path}/without_points")
    mesh = UsdGeom.Mesh.Define(stage, f"{path}/e")
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 2, 0), (0, 0, 3)])
    squeezed = UsdGeom.Sphere.Define(stage, f"{path}/f")
    squeezed.AddScaleOp().Set((1.0, 1.0, 0.5))
    for name, purpose in (("shown", "default"), ("hint", "guide")):
        UsdGeom.Cube.Define(stage, f"/arm/body2/{name}").CreatePurposeAttr(purpose)
    robot = again(stage)
    link = next(one for one in robot.links if one.name == "body2")
    frame = robot.frames["body2_prim"].translation
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])
    middle = frame + 0.5 * np.array([0.1, 0.2, 0.3])
    kinds = {type(shape).__name__: shape for shape in link.shapes}
    assert len(link.shapes) == 6 and set(kinds) == {"Sphere", "Box", "Cylinder", "Capsule"}
    boxes = sorted((one for one in link.shapes if isinstance(one, Box)), key=lambda box: box.size.prod())
    for box, size, at in zip(
        boxes, ((2, 2, 1), (1, 2, 3), (2, 4, 6)), ((0, 0, 0), (0.5, 1, 1.5), (0, 0, 0)), strict=True
    ):
        np.testing.assert_allclose(box.size, size, rtol=1e-6)
        np.testing.assert_allclose(box.translation, middle + turn @ at, atol=1e-6, rtol=0.0)
        np.testing.assert_allclose(box.rotation, turn, atol=1e-6, rtol=0.0)
    assert kinds["Sphere"].radius == pytest.approx(0.1)
    np.testing.assert_allclose(kinds["Sphere"].centre, middle, atol=1e-6, rtol=0.0)
    assert (kinds["Cylinder"].radius, kinds["Cylinder"].length) == pytest.approx((0.1, 0.6))
    np.testing.assert_allclose(kinds["Cylinder"].rotation[:, 2], [0.0, 1.0, 0.0], atol=1e-6, rtol=0.0)
    ends = np.array([kinds["Capsule"].start, kinds["Capsule"].end])
    np.testing.assert_allclose(ends, middle + np.outer([-0.3, 0.3], [0.0, 1.0, 0.0]), atol=1e-6, rtol=0.0)
    assert [type(shape) for shape in link.visuals] == [Box]
    UsdGeom.Sphere(stage.GetPrimAtPath(f"{path}/a")).GetRadiusAttr().Set(-1.0)
    with pytest.raises(DescriptionError, match="its radius -1 is no length; write lengths above 0"):
        again(stage)


def test_a_sheared_shape_has_the_box_about_its_corners(stage: Any) -> None:
    cube = UsdGeom.Cube.Define(stage, "/arm/body2/a")
    shear = np.array([[1.0, 0, 0, 0], [0.7, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]])
    cube.AddTransformOp().Set(Gf.Matrix4d(shear.tolist()))
    (shape,) = next(one for one in again(stage).links if one.name == "body2").visuals
    corners = np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, 8).T @ shear[:3, :3]
    assert isinstance(shape, Box)
    np.testing.assert_allclose(shape.size, np.ptp(corners, axis=0), rtol=1e-6)
