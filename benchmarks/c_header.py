"""The exported C header of a UR10 beside Pinocchio's C++ algorithms, each in a compiled loop, in one program.

Both get the same states and rotors; times do not depend on the bodies. The header is compiled as C99 with the levels
below, Pinocchio's loops as C++17 with -O2 against the compiled library of its package. Times are the processor's own,
and repeats of all rows are interleaved, so that a busy machine slows all alike; the least time tells what the code
needs, the ratio of each repeat (median, quartiles) what stands between the two. Pinocchio's headers come
with its package; Eigen's do not: --eigen names the folder that holds ``Eigen``. Without it, only the header is timed.
Run: python -m benchmarks.c_header [--eigen DIR] [--out FILE]
"""

from __future__ import annotations

import argparse
import json
import platform
import statistics
import subprocess
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from benchmarks.speed.arms import ur10
from dynident.data.log import Log
from dynident.exports.models import export_model
from dynident.identification.identify import identify
from dynident.model.dynamic_model import DynamicModel

STATES, ROUNDS, REPEATS = 1000, 10, 21

#: Levels of optimisation of the header.
LEVELS = ("-O2", "-O3 -march=native")

#: Rows: name, what the header calls, what Pinocchio calls.
ROWS = (
    ("inverse dynamics, no friction", "arm_rigid(q, dq, ddq, out)", "pinocchio::rnea(model, data, q[k], v[k], a[k])"),
    ("inverse dynamics, friction", "arm_inverse_dynamics(q, dq, ddq, out)", ""),
    ("the same in float", "arm_inverse_dynamicsf(qf, dqf, ddqf, outf)", ""),
    ("gravity", "arm_gravity(q, out)", "pinocchio::computeGeneralizedGravity(model, data, q[k])"),
    ("mass matrix", "arm_mass_matrix(q, out)", ""),
    ("regressor", "arm_regressor(q, dq, ddq, out)", ""),
    ("feed-forward", "arm_feed_forward(q, dq, ddq, out)", ""),
    ("momentum observer", "arm_observer_step(&observer, q, dq, ddq, gain, 1e-3)", ""),
)


def write_header(folder: Path) -> DynamicModel:
    """Write arm.h of an estimate of a noisy run, and return the model."""
    robot = ur10()
    drives = [replace(joint.drive, gear_ratio=100.0, rotor_inertia=2e-5) for joint in robot.joints]
    joints = tuple(replace(joint, drive=drive) for joint, drive in zip(robot.joints, drives, strict=True))
    model = DynamicModel(replace(robot, joints=joints), ("coulomb", "viscous", "offset"))  # type: ignore[arg-type]
    theta = model.nominal()
    assert theta is not None
    theta = theta + np.concatenate([np.zeros(model.inertial_count), np.tile([5.0, 8.0, 0.3], 6)])
    motion = model.random_motion(400, seed=1)
    tau = model.torque(motion, theta) + np.random.default_rng(2).normal(0.0, 0.1, motion.q.shape)
    log = Log(model.robot.joint_names, 0.01 * np.arange(400), motion.q, motion.dq, motion.ddq, tau)
    estimate = identify(model, [log], "consistent")
    for proof in export_model(estimate, "c_header", folder / "arm.h").proofs:
        print(f"{proof.engine}: {proof.what}: {proof.relative or 0.0:.1e} relative")
    return model


def header_source() -> str:
    """Return a C file with one loop for each row."""
    lines = ['#include "arm.h"', "#define ARM_FLOAT", '#include "arm.h"', "static arm_observer observer;"]
    for number, (_, call, _) in enumerate(ROWS):
        lines += [
            f"double header{number}(const double *states, const float *single, int count)",
            "{",
            "    static const double gain[6] = {50, 50, 50, 50, 50, 50};",
            "    double sum = 0.0, out[6 * ARM_PARAMETERS] = {0};",
            "    float outf[6] = {0};",
            "    int k;",
            "    for (k = 0; k < count; ++k) {",
            "        const double *q = states + 18 * k, *dq = q + 6, *ddq = q + 12;",
            "        const float *qf = single + 18 * k, *dqf = qf + 6, *ddqf = qf + 12;",
            f"        {call};",
            '        __asm__ volatile("" : : "r"(out), "r"(outf) : "memory");  /* all outputs count */',
            "        sum += out[5] + (double)outf[5];",
            "        (void)dq; (void)ddq; (void)qf; (void)dqf; (void)ddqf; (void)gain;",
            "    }",
            "    return sum;",
            "}",
        ]
    return "\n".join(lines) + "\n"


def model_lines(model: DynamicModel) -> Iterator[str]:
    """Yield C++ that builds the arm in Pinocchio, each joint about its own z."""
    for i, (joint, link) in enumerate(zip(model.robot.joints, model.robot.links, strict=True)):
        rotation = ", ".join(repr(float(v)) for v in np.asarray(joint.rotation).ravel())
        place = ", ".join(repr(float(v)) for v in joint.translation)
        assert link.inertia is not None and np.array_equal(joint.axis, [0.0, 0.0, 1.0])
        body = link.inertia
        centre = ", ".join(repr(float(v)) for v in body.centre_of_mass)
        tensor = ", ".join(repr(float(v)) for v in np.asarray(body.about_centre).ravel())
        yield f"  {{ Eigen::Matrix3d r; r << {rotation}; Eigen::Vector3d p({place}), c({centre});"
        yield f"    Eigen::Matrix3d i; i << {tensor};"
        yield f'    auto id = model.addJoint({i}, pinocchio::JointModelRZ(), pinocchio::SE3(r, p), "j{i}");'
        yield f"    pinocchio::Inertia body({float(body.mass)!r}, c, i);"
        yield "    model.appendBodyToJoint(id, body, pinocchio::SE3::Identity());"
        yield f"    model.armature[{i}] = {joint.drive.reflected_inertia!r}; }}"


def main_source(model: DynamicModel, has_peer: bool) -> str:
    """Return the C++ program that times every row, and prints repeats in ns per call."""
    head = ["#include <time.h>", "#include <cstdio>", "#include <vector>", "#include <algorithm>", "#include <cmath>"]
    peers = [number for number, row in enumerate(ROWS) if row[2] and has_peer]
    if has_peer:
        head += ["#include <pinocchio/algorithm/rnea.hpp>"]
        head += ["pinocchio::Model model;", "std::vector<Eigen::VectorXd> q, v, a;"]
    lines = [*head, "std::vector<double> states; std::vector<float> single; volatile double sink;"]
    lines += [f'extern "C" double header{k}(const double *, const float *, int);' for k in range(len(ROWS))]
    for k in peers:
        lines += [
            f"static void peer{k}(pinocchio::Data &data) {{",
            f"  for (int k = 0; k < {STATES}; ++k) {ROWS[k][2]};",
        ]
        lines += ["  sink = data.tau[5] + data.g[5]; }"]
    lines += ["static double now() { timespec t; clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);"]
    lines += ["  return 1e9 * t.tv_sec + t.tv_nsec; }"]
    lines += ["template <class F> double timed(F f) { f(); double start = now();"]
    lines += [f"  for (int i = 0; i < {ROUNDS}; ++i) f();"]
    lines += [f"  return (now() - start) / {ROUNDS * STATES}; }}", "int main(int, char **names) {"]
    lines += [f'  states.resize({18 * STATES}); FILE *f = fopen(names[1], "rb");']
    lines += ["  if (!f || fread(states.data(), 8, states.size(), f) != states.size()) return 2;"]
    lines += ["  single.assign(states.begin(), states.end());"]
    if has_peer:
        lines += ["  model.gravity.linear(Eigen::Vector3d(0, 0, -9.81));", *model_lines(model)]
        lines += ["  pinocchio::Data data(model);", f"  for (int k = 0; k < {STATES}; ++k) {{"]
        lines += ["    Eigen::Map<Eigen::VectorXd> x(states.data() + 18 * k, 18);"]
        lines += ["    q.push_back(x.segment(0, 6)); v.push_back(x.segment(6, 6)); a.push_back(x.segment(12, 6)); }"]
    lines += [f"  for (int r = 0; r < {REPEATS}; ++r) {{"]
    for k in range(len(ROWS)):
        call = f"[&] {{ sink = header{k}(states.data(), single.data(), {STATES}); }}"
        lines += [f'    printf("header {k} %.3f\\n", timed({call}));']
        if k in peers:
            lines += [f'    printf("peer {k} %.3f\\n", timed([&] {{ peer{k}(data); }}));']
    return "\n".join([*lines, "  }", "  return 0;", "}"]) + "\n"


def timed(folder: Path, model: DynamicModel, level: str, eigen: Path | None) -> dict[tuple[str, int], list[float]]:
    """Compile and run everything, and return the times in ns per call by row."""
    compiling, linking = list[str](), list[str]()
    if eigen is not None:
        spec = find_spec("pinocchio")
        assert spec is not None and spec.origin is not None
        prefix = next(p for p in Path(spec.origin).parents if p.name == "cmeel.prefix")
        library = str(prefix / "lib")
        lists = ["BOOST_MPL_LIMIT_LIST_SIZE=30", "BOOST_MPL_LIMIT_VECTOR_SIZE=30", "BOOST_FUSION_INVOKE_MAX_ARITY=12"]
        words = ["NDEBUG", "PINOCCHIO_ENABLE_TEMPLATE_INSTANTIATION", "BOOST_MPL_CFG_NO_PREPROCESSED_HEADERS", *lists]
        compiling = [f"-I{prefix / 'include'}", f"-I{eigen}", *(f"-D{word}" for word in words)]
        linking = [f"-L{library}", f"-Wl,-rpath,{library}", "-Wl,--allow-shlib-undefined", "-lpinocchio_default"]
    (folder / "loops.c").write_text(header_source(), encoding="ascii")
    (folder / "main.cpp").write_text(main_source(model, eigen is not None), encoding="ascii")
    commands = [["gcc", "-std=c99", *level.split(), "-c", "loops.c", "-o", "loops.o"]]
    if not (folder / "main.o").exists():
        commands.append(["g++", "-std=c++17", "-O2", *compiling, "-c", "main.cpp"])
    for command in (*commands, ["g++", "main.o", "loops.o", *linking, "-o", "timed", "-lm"]):
        subprocess.run(command, check=True, cwd=folder)
    motion = model.random_motion(STATES, seed=4)
    np.concatenate([motion.q, motion.dq, motion.ddq], axis=1).tofile(folder / "states.bin")
    shown = subprocess.run(["./timed", "states.bin"], check=True, cwd=folder, capture_output=True, text=True).stdout
    found: dict[tuple[str, int], list[float]] = {}
    for line in shown.splitlines():
        whose, number, value = line.split()
        found.setdefault((whose, int(number)), []).append(float(value))
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description="Time the exported C header beside Pinocchio in C++.")
    parser.add_argument("--eigen", type=Path, help="folder that holds 'Eigen'")
    parser.add_argument("--out", type=Path, default=Path("out/benchmarks/c_header.json"), help="where the JSON goes")
    asked = parser.parse_args()
    facts: dict[str, object] = {"processor": platform.processor() or platform.machine(), "repeats": REPEATS}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        model = write_header(folder)
        for level in LEVELS:
            times = timed(folder, model, level, asked.eigen)
            rows = {}
            print(f"\n{level}, ns per call{'':28s} {'median':>8s} {'least':>8s}   pinocchio, median, least; ratio")
            for number, (title, _, _) in enumerate(ROWS):
                own, peer = times["header", number], times.get(("peer", number))
                rows[title] = {"median ns": statistics.median(own), "least ns": min(own)}
                line = f"  {title:38s} {statistics.median(own):8.0f} {min(own):8.0f}"
                if peer:
                    ratios = [theirs / ours for theirs, ours in zip(peer, own, strict=True)]
                    low, middle, high = statistics.quantiles(ratios, n=4)
                    rows[title] |= {"pinocchio median ns": statistics.median(peer), "pinocchio least ns": min(peer)}
                    rows[title] |= {"median ratio": middle, "quartiles of the ratio": [low, high]}
                    line += (
                        f"   {statistics.median(peer):8.0f} {min(peer):8.0f}   {middle:.1f}x ({low:.1f} to {high:.1f})"
                    )
                print(line)
            facts[level] = rows
    asked.out.parent.mkdir(parents=True, exist_ok=True)
    asked.out.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
    print(f"written: {asked.out}")


if __name__ == "__main__":
    main()
