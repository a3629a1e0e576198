"""The C header: no warning, the functions against closed forms and differences, names that are attacks, refusals."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from compiled_header import COMPILER, Header, needs_compiler

from bare_estimates import bare_estimate
from dynident.errors import BadOption, DynidentError, FileError
from dynident.exports.models import MODEL_EXPORTERS, ModelContent, export_model
from dynident.exports.models.c_header import CHeader
from dynident.exports.models.writing import c_programs
from dynident.identification.estimate.estimate import Estimate
from dynident.model.dynamic_model import DynamicModel
from dynident.model.friction import Friction, Motion
from dynident.model.friction.base import Inputs, Number
from dynident.model.kernels import batched
from dynident.model.robot import Robot
from presliding import Presliding

WARNINGS = ("-Wall", "-Wextra", "-pedantic", "-Werror", "-Wconversion", "-Wshadow", "-Wdouble-promotion")

EVERYTHING = ("coulomb", "viscous", "offset", "rotor_inertia", "load", "stribeck", "polynomial", "periodic")


def bare(robot: Robot, friction: tuple[str | Friction, ...]) -> Estimate:
    """Return an estimate with drawn friction."""
    model = DynamicModel(robot, friction)  # type: ignore[arg-type]
    nominal = model.nominal()
    assert nominal is not None
    theta = nominal.copy()
    theta[model.inertial_count :] = np.random.default_rng(1).uniform(0.1, 0.5, len(theta) - model.inertial_count)
    return bare_estimate(model, theta)


def states(model: DynamicModel, count: int = 20) -> Motion:
    motion = model.random_motion(count, seed=5)
    return replace(motion, torque=None)


def compiles(folder: Path, prefix: str, language: tuple[str, ...]) -> None:
    upper, lower = prefix.upper(), prefix
    source = folder / "use.c"
    source.write_text(
        f'#include "{folder.name}.h"\n#define {upper}_FLOAT\n#include "{folder.name}.h"\n#include "{folder.name}.h"\n'
        f"int main(void) {{ double q[{upper}_JOINTS] = {{0}}, g[{upper}_JOINTS];"
        f" {lower}_gravity(q, g); return g[0] > 1e9; }}\n",
        encoding="ascii",
    )
    assert COMPILER is not None
    command = [COMPILER, *language, *WARNINGS, "-fsyntax-only", str(source)]
    found = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert found.returncode == 0, found.stderr[:2000]


@needs_compiler
@pytest.mark.parametrize("friction", [(), EVERYTHING, ("asymmetric", "degressive", "temperature", "presliding")])
def test_it_compiles_without_a_warning_as_c99_and_cpp17(
    coupled_arm: Robot, friction: tuple[str, ...], tmp_path: Path
) -> None:
    found = export_model(
        bare(coupled_arm, friction),
        MODEL_EXPORTERS.make("c_header", {"prefix": "arm"}),
        tmp_path / f"{tmp_path.name}.h",
    )
    assert found.proofs and all(proof.relative is not None for proof in found.proofs)
    compiles(tmp_path, "arm", ("-std=c99",))
    if shutil.which("g++") or shutil.which("clang++"):
        compiles(tmp_path, "arm", ("-x", "c++", "-std=c++17"))


@pytest.fixture(scope="module")
def six(random_tree: Callable[..., Robot]) -> Estimate:
    return bare(random_tree(3, 5), EVERYTHING)


@pytest.fixture(scope="module")
def header(six: Estimate, tmp_path_factory: pytest.TempPathFactory) -> Header:
    if COMPILER is None:
        pytest.skip("no C compiler on the path")
    path = tmp_path_factory.mktemp("header") / "arm.h"
    export_model(six, MODEL_EXPORTERS.make("c_header", {"velocity_scale": 0.3}), path, proof=False)
    functions = [("gravity", 1), ("coriolis", 2), ("mass_matrix", 1), ("momentum_", 2), ("rigid", 3)]
    functions += [("friction", 3), ("friction_compensation", 3), ("feed_forward", 3), ("inverse_dynamics", 3)]
    functions += [("gravity_compensation", 1), ("regressor", 3), ("base_parameters", 0), ("known_torque", 1)]
    lines = [(name, count) for name, count in functions if name != "base_parameters"]
    return Header(path, lines, observer=True)


def test_the_parts_are_those_of_the_kernels(six: Estimate, header: Header) -> None:
    model, motion = six.model, states(six.model)
    chain, size = model.robot.chain, model.robot.dof
    theta = np.asarray(six.theta)[: model.inertial_count]
    zero = np.zeros_like(motion.q)
    gravity = batched.inverse_dynamics(chain, theta, motion.q, zero, zero)
    speed = batched.inverse_dynamics(chain, theta, motion.q, motion.dq, zero) - gravity
    rotors = model.robot.reflected_inertia + np.diag(model.rotors(np.asarray(six.theta)))
    mass = batched.mass_matrix(chain, theta, motion.q) + rotors
    np.testing.assert_allclose(header.rows("gravity", size, motion.q), gravity, atol=1e-12)
    np.testing.assert_allclose(header.rows("coriolis", size, motion.q, motion.dq), speed, atol=1e-11)
    found = header.rows("mass_matrix", size * size, motion.q).reshape(-1, size, size)
    np.testing.assert_allclose(found, mass, atol=1e-12)
    np.testing.assert_allclose(
        header.rows("inverse_dynamics", size, motion.q, motion.dq, motion.ddq),
        model.torque(motion, np.asarray(six.theta)),
        atol=1e-10,
    )


def test_the_rate_of_momentum_is_that_of_differences(six: Estimate, header: Header) -> None:
    """C' dq = dM/dt dq - c, with dM/dt by central differences along the speed."""
    motion, size = states(six.model), six.model.robot.dof
    found = header.rows("momentum_", 2 * size, motion.q, motion.dq)
    step = 1e-6
    ahead, back = (
        header.rows("mass_matrix", size * size, motion.q + s * motion.dq).reshape(-1, size, size) for s in (step, -step)
    )
    mass = header.rows("mass_matrix", size * size, motion.q).reshape(-1, size, size)
    np.testing.assert_allclose(found[:, :size], np.einsum("nij,nj->ni", mass, motion.dq), atol=1e-11)
    slope = np.einsum("nij,nj->ni", (ahead - back) / (2 * step), motion.dq)
    rate = slope - header.rows("coriolis", size, motion.q, motion.dq)
    np.testing.assert_allclose(found[:, size:], rate, atol=1e-6 * np.abs(rate).max())


def test_compensation_has_the_stated_smooth_sign(six: Estimate, header: Header) -> None:
    """The model with every width raised to the velocity scale gives the same torques."""
    model, motion, size = six.model, states(six.model), six.model.robot.dof
    slow = replace(motion, dq=0.1 * motion.dq)
    wide = tuple(replace(part, width=0.3) if hasattr(part, "width") else part for part in model.friction)  # type: ignore[call-arg]
    smooth = DynamicModel(model.robot, wide)
    arrays = (slow.q, slow.dq, slow.ddq)
    whole = smooth.torque(slow, np.asarray(six.theta))
    rigid = header.rows("rigid", size, *arrays)
    np.testing.assert_allclose(header.rows("feed_forward", size, *arrays), whole, atol=1e-10)
    np.testing.assert_allclose(header.rows("friction_compensation", size, *arrays), whole - rigid, atol=1e-10)
    still = replace(slow, dq=np.zeros_like(slow.dq), ddq=np.zeros_like(slow.dq))
    held = model.torque(still, np.asarray(six.theta))
    np.testing.assert_allclose(header.rows("gravity_compensation", size, slow.q), held, atol=1e-10)


def test_the_observer_follows_a_torque_from_outside(six: Estimate, header: Header) -> None:
    """Along a given motion drives give what the model asks less a torque from outside: a first-order lag of it."""
    size, dt, rate, gain = six.model.robot.dof, 1e-4, 3.0, 40.0
    time = np.arange(4000)[:, None] * dt
    phase = np.arange(size)
    q, dq = 0.5 * np.sin(rate * time + phase), 0.5 * rate * np.cos(rate * time + phase)
    ddq = -0.5 * rate**2 * np.sin(rate * time + phase)
    contact = np.where(time > 0.1, np.linspace(2.0, -3.0, size), 0.0)
    rigid = header.rows("rigid", size, q, dq, ddq)
    friction = header.rows("friction_compensation", size, q, dq, np.zeros_like(q))
    tau = rigid + friction - contact
    header.library.reset()
    gains, step = np.full((len(q), size), gain), np.full((len(q), 1), dt)
    found = header.rows("observe", size, q, dq, tau, gains, step)
    expected = np.where(time > 0.1, contact * (1.0 - np.exp(-gain * (time - 0.1))), 0.0)
    assert np.abs(found - expected).max() < 0.03
    assert np.abs(found[-1] - contact[-1]).max() < 0.02


@needs_compiler
@pytest.mark.parametrize(
    "name", ["*/ int x; /*", "a??/", "a\\", '"', "/* *", "// \\", "#define x", "ü", "x" * 300, "%s%n"]
)
def test_names_cannot_leave_a_comment(pendulum: Robot, name: str, tmp_path: Path) -> None:
    joints = (replace(pendulum.joints[0], name=name),)
    robot = replace(pendulum, name=name, joints=joints, links=(replace(pendulum.links[0], name=f"{name}1"),))
    found = export_model(bare(robot, ("coulomb", "viscous")), "c_header", tmp_path / "arm.h")
    assert all(proof.relative is not None for proof in found.proofs)
    text = (tmp_path / "arm.h").read_text("ascii")
    assert "??" not in text and "int x;" not in text and max(map(len, text.splitlines())) < 200
    (tmp_path / f"{tmp_path.name}.h").write_text(text, encoding="ascii")
    compiles(tmp_path, "arm", ("-std=c99", "-Wtrigraphs", "-Wcomment"))


@pytest.mark.parametrize("prefix", ["Arm", "1arm", "a b", "a__b", "a_", "_a", "a*/", "a" * 31, "é"])
def test_a_prefix_is_a_plain_word(prefix: str) -> None:
    with pytest.raises(BadOption, match="prefix"):
        CHeader(prefix=prefix)


@pytest.mark.parametrize("scale", [0.0, -1.0, np.nan, np.inf])
def test_a_velocity_scale_is_a_speed(scale: float) -> None:
    with pytest.raises(BadOption, match="velocity_scale"):
        CHeader(velocity_scale=scale)


@pytest.mark.parametrize(
    ("name", "prefix"), [("My Arm-2.h", "my_arm_2"), ("7dof.h", "arm_7dof"), ("é.h", "arm"), ("int.h", "int")]
)
def test_the_name_of_the_file_gives_the_prefix(pendulum: Robot, name: str, prefix: str, tmp_path: Path) -> None:
    found = export_model(bare(pendulum, ("viscous",)), "c_header", tmp_path / name)
    assert f"{prefix}_gravity" not in found.notes and any(f"begin with {prefix}_;" in note for note in found.notes)
    assert f"#define {prefix.upper()}_JOINTS 1" in (tmp_path / name).read_text("ascii")


def test_without_a_compiler_it_says_that_it_is_not_proved(
    pendulum: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.delenv("CC", raising=False)
    found = export_model(bare(pendulum, ("viscous",)), "c_header", tmp_path / "arm.h")
    assert [proof.relative for proof in found.proofs] == [None] and "set CC" in found.proofs[0].why_not
    assert (tmp_path / "arm.h").is_file()


@needs_compiler
@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("return ARM_M(tanh)(v / w);", "return v / w;", "differ by"),
        ("typedef struct {", "typedef strict {", "refuses it"),
    ],
)
def test_a_header_that_is_wrong_is_not_written(
    pendulum: Robot, old: str, new: str, told: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    right = CHeader.content

    def wrong(self: CHeader, subject: object, path: Path) -> ModelContent:
        content = right(self, subject, path)  # type: ignore[arg-type]
        assert old.encode() in content.files[path]
        return replace(content, files={path: content.files[path].replace(old.encode(), new.encode())})

    monkeypatch.setattr(CHeader, "content", wrong)
    with pytest.raises(FileError, match=rf"{told}|self_test ends with 1"):
        export_model(bare(pendulum, ("coulomb",)), "c_header", tmp_path / "arm.h")
    assert not (tmp_path / "arm.h").exists()


@dataclass(frozen=True)
class Creeping(Presliding):
    """Springs that relax, in a time."""

    def update(self, at: Inputs) -> tuple[Number, ...]:
        return tuple(z - at.dq * z for z in super().update(at))  # type: ignore[operator]


@pytest.mark.parametrize(
    ("target", "told"), [("c_header", "the C header"), ("casadi", "the CasADi module"), ("numpy", "the NumPy module")]
)
def test_a_state_that_needs_more_than_positions_is_refused(
    pendulum: Robot, tmp_path: Path, target: str, told: str
) -> None:
    export_model(bare(pendulum, (Presliding(), "viscous")), target, tmp_path / "arm")  # type: ignore[arg-type]
    subject = bare(pendulum, (Creeping(), "viscous"))  # type: ignore[arg-type]
    with pytest.raises(
        BadOption,
        match=rf"depends on dq.*{told} keeps states of positions and the time; identify without it, or export to json",
    ):
        export_model(subject, target, tmp_path / "arm")


def test_a_robot_that_no_compiler_takes_is_refused(
    pendulum: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(c_programs, "LARGEST", 10)
    with pytest.raises(DynidentError, match=r"operations.*too long for a compiler"):
        export_model(bare(pendulum, ("viscous",)), "c_header", tmp_path / "arm.h")


def test_base_parameters_of_the_bodies_shorten_the_program(spatial_3r: Robot) -> None:
    """The same torques from fewer parameters; friction and rotors stay apart."""
    model = DynamicModel(spatial_3r, ("viscous", "rotor_inertia"))  # type: ignore[arg-type]
    theta = model.nominal()
    assert theta is not None
    short = c_programs.folded(model, theta)
    own = theta[: model.inertial_count]
    assert np.count_nonzero(short) < np.count_nonzero(own)
    motion = model.random_motion(20, seed=9)
    full, found = (
        batched.inverse_dynamics(spatial_3r.chain, values, motion.q, motion.dq, motion.ddq) for values in (own, short)
    )
    np.testing.assert_allclose(found, full, atol=1e-11 * np.abs(full).max())
