"""What is asked of the program: one command a step, run in the folder of the recording.

{out} in a command is the folder of the step's own answers; the answers of earlier steps are at answers/NAME.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Step:
    """A command and what is known of it.

    Attributes:
        name: Folder of its answers.
        words: Command line behind ``dynident``.
        iterated: Its numbers come from an iteration, and are compared with the wider tolerance.
        needs: Folder of real logs, below DYNIDENT_DATA, without which it is left out.
    """

    name: str
    words: str
    iterated: bool = False
    needs: str = ""


#: Commands without a step, and why.
LEFT_OUT = {
    "environment": "says what is installed on a machine",
    "studio": "a server; its page shows what the other commands answer",
}

#: Suffix of what each exporter writes, and options that it needs. Others get no suffix and no options.
MOTIONS = {
    "csv": (".csv", "--from-posture start"),
    "joint_trajectory": (".yaml", ""),
    "krl": (".src", ""),
    "libfranka": (".csv", "--from-posture start"),
    "rapid": (".mod", ""),
    "ros2_bag": ("", ""),
    "urscript": (".script", ""),
}
MODELS = {
    "c_header": ".h",
    "casadi": ".py",
    "csv": ".csv",
    "drake": ".yaml",
    "fmu": ".fmu",
    "json": ".json",
    "latex": ".tex",
    "mjcf": ".xml",
    "numpy": ".py",
    "pinocchio": ".urdf",
    "ros2_friction": ".yaml",
    "sdf": ".sdf",
    "urdf": ".urdf",
}

#: Real sets by case file: folder of their logs, and what is validated on, as in the case file.
REAL = {
    "panda": ("panda_gaz2019", "exciting_traj_1.csv --split first:0.6667"),
    "lwr4": ("kuka_lwr4_flobaroid", "measurements_1.csv"),
    "tiago": ("tiago_figaroh", "trajectory.csv --split rows:921:4835,4835:6792"),
    "tx40": ("staubli_tx40_figaroh", "trajectory.csv --split rows:0:24750,29250:45000"),
    "ur10e": ("ur10e_mamedov", "ident_20_02_12_40sec_12harm.csv"),
}
#: Sets whose case is also drafted from robot description and logs.
DRAFTED = {"panda": ("exciting_traj_1.csv",), "lwr4": ("measurements_2.csv", "measurements_3.csv")}

_PLAIN = "--estimator wls --no-sensitivity --cross-validate 0"

QUICK = (
    Step("list", "list"),
    Step("completion", "completion bash"),
    Step("inspect-er16", "inspect er16 --friction coulomb viscous offset"),
    Step("inspect-plan", "inspect inputs/plan.json --case inputs/case.yaml --html {out}/plan.html"),
    Step(
        "excite",
        "excite inputs/case.yaml --period 5 --harmonics 2 --starts 1 --seed 1 -o {out}/plan.json --csv {out}/plan.csv "
        "--rate 20",
        iterated=True,
    ),
    Step(
        "simulate",
        "simulate inputs/case.yaml inputs/plan.json -o {out}/run.csv --seed 3 --set effort.noise=0.3 "
        "--set recorder.rate=100",
    ),
    Step("init", "init inputs/arm.urdf inputs/run.csv -o {out}/case.yaml"),
    Step("check", "check inputs/case.yaml inputs/run.csv inputs/loaded.csv"),
    Step(
        "identify",
        "identify inputs/case.yaml inputs/run.csv --test inputs/other.csv -o {out}/estimate.json",
        iterated=True,
    ),
    Step("identify-wls", f"identify inputs/case.yaml inputs/run.csv {_PLAIN} -o {{out}}/estimate.json"),
    Step("validate", "validate answers/identify-wls/estimate.json inputs/other.csv"),
    Step("validate-older", "validate inputs/estimate.json inputs/other.csv"),
    Step("predict", "predict answers/identify-wls/estimate.json inputs/other.csv -o {out}/torques.csv"),
    Step("payload", "payload answers/identify-wls/estimate.json inputs/loaded.csv", iterated=True),
    Step(
        "monitor",
        "monitor answers/identify-wls/estimate.json inputs/touched.csv --clean inputs/run.csv inputs/other.csv",
    ),
    Step(
        "track",
        "track answers/identify-wls/estimate.json inputs/touched.csv --clean inputs/other.csv -o {out}/course.csv ",
    ),
    Step(
        "gains",
        "gains inputs/currents.yaml inputs/currents.csv --load inputs/currents-loaded.csv --mass 2 -o {out}/case.yaml ",
        iterated=True,
    ),
    Step("reduce", "reduce inputs/case.yaml inputs/fleet-1.csv -o {out}/1.tri"),
    Step("reduce-other", "reduce inputs/case.yaml inputs/fleet-2.csv -o {out}/2.tri"),
    Step("merge", "merge answers/reduce/1.tri answers/reduce-other/2.tri -o {out}/both.tri"),
    Step("identify-from", "identify inputs/case.yaml --from answers/merge/both.tri", iterated=True),
    Step(
        "fleet",
        "fleet inputs/estimate.json answers/reduce/1.tri answers/reduce-other/2.tri -o {out}/fleet",
        iterated=True,
    ),
    Step(
        "compare",
        "compare inputs/case.yaml inputs/run.csv --test inputs/other.csv --estimators ols,wls,consistent,huber",
        iterated=True,
    ),
    Step(
        "diff",
        "diff answers/identify-wls/estimate.json answers/identify/estimate.json --html {out}/page.html",
        iterated=True,
    ),
    Step(
        "report",
        "report answers/identify-wls/estimate.json --test inputs/other.csv -o {out}/report.html "
        "--figures {out}/figures",
        iterated=True,
    ),
    Step(
        "selftest",
        "selftest inputs/scara.yaml --plan inputs/scara-plan.json --rate 100 --control-rate 250",
        iterated=True,
    ),
    Step("benchmark", "benchmark inputs/benchmark.yaml --out benchmark-results", iterated=True),
    Step("demo", "demo article --out {out}/demo --iterations 1", iterated=True),
)

_WIDE = "--period 4 --harmonics 2 --starts 1 --seed 1"
_CELL = "simulate inputs/scara.yaml inputs/scara-plan.json --seed 4 --set recorder.rate=100"
_EFFECTS = {
    "controller-cascade": "--set controller=cascade",
    "controller-computed-torque": "--set controller=computed_torque",
    "controller-pid": "--set controller=pid --set controller.rate=500 --set controller.delay_s=0.002",
    "encoder": "--set encoder.resolution=1e-4 --set encoder.noise=1e-5 --set encoder.velocity=difference",
    "bristles": "--set bristles.presliding=1e-3 --set bristles.stiction=0.2 --set truth.friction.Fc=2",
    "warming": "--set warming.end=45 --set warming.time_constant=5 --set warming.per_kelvin=-0.01",
    "ripple": "--set ripple.amplitude=0.4 --set ripple.cycles=10",
    "tilted": "--set tilt.roll=0.05 --set tilt.pitch=0.02 --set payload.mass=1",
    "recorder": "--set recorder.jitter_s=1e-3 --set recorder.dropped=0.01 --set recorder.velocities=true",
    "effort": "--set effort.noise=0.3 --set effort.resolution=0.05 --set effort.delay_s=0.003 --set truth.spread=0.2",
}
#: Cases with other friction parts, whose models are exported as well, and their logs.
PARTS = {"rich": "scara.csv", "curved": "scara.csv", "warm": "warm.csv"}

FULL = (
    *(Step(f"inspect-{robot}", f"inspect {robot}") for robot in ("generic-7r", "generic-scara", "tx40-like")),
    *(Step(f"excite-{name}", f"excite inputs/scara.yaml {_WIDE} --criterion {name} -o {{out}}/plan.json", True)
      for name in ("a_optimal", "bayesian_d", "condition", "e_optimal", "unit_condition")),
    *(Step(f"excite-{name}", f"excite inputs/scara.yaml {_WIDE} --trajectory {name} -o {{out}}/plan.json", True)
      for name in ("bspline", "fourier")),
    Step("excite-next", f"excite inputs/case.yaml {_WIDE} --model inputs/estimate.json --earlier inputs/estimate.json "
         "--torque-margin 0.1 -o {out}/plan.json", True),
    *(Step(f"simulate-{name}", f"{_CELL} {settings} -o {{out}}/run.csv") for name, settings in _EFFECTS.items()),
    Step("simulate-elastic", f"{_CELL.replace('scara.yaml', 'rotors.yaml')} --set elasticity.stiffness=1e5 "
         "--set elasticity.damping=10 -o {out}/run.csv"),
    *(Step(f"identify-{kind}", f"identify inputs/scara.yaml inputs/scara.{kind} {_PLAIN}")
      for kind in ("npz", "mat", "parquet")),
    Step("identify-mcap", f"identify inputs/ros.yaml inputs/scara.mcap {_PLAIN}"),
    *(Step(f"identify-{name}", f"identify inputs/filter-{name}.yaml inputs/scara.csv {_PLAIN}", True)
      for name in ("five_point", "fourier_fit", "kalman_smoother", "smoothing_spline")),
    Step("identify-chosen", "identify generic-6r inputs/run.csv --cutoff auto --delay auto --split first:0.67", True),
    Step("identify-auto", "identify inputs/scara.yaml inputs/scara.csv --friction auto", True),
    Step("identify-bootstrap", "identify inputs/scara.yaml inputs/scara.csv --bootstrap 40", True),
    Step("identify-prior",
         "identify inputs/case.yaml inputs/run.csv --estimator map --prior inputs/estimate.json", True),
    Step("identify-constrained",
         "identify inputs/case.yaml inputs/run.csv --constraints inputs/constraints.yaml", True),
    *(Step(f"identify-{name}", f"identify inputs/{name}.yaml inputs/{log} -o {{out}}/estimate.json", True)
      for name, log in PARTS.items()),
    Step("validate-rich", "validate answers/identify-rich/estimate.json inputs/scara.csv", True),
    Step("check-rich", "check inputs/rich.yaml inputs/scara.csv", True),
    Step("gains-prior", "gains inputs/currents.yaml inputs/currents.csv --prior-share 0.1", True),
    Step("gains-signed", "gains inputs/currents.yaml inputs/currents.csv --prior-share 0.1 --signed", True),
    Step("payload-poses",
         "payload answers/identify-wls/estimate.json inputs/loaded.csv --mass 2 --mass-std 0.01", True),
    Step("compare-all", "compare inputs/scara.yaml inputs/scara.csv --split first:0.67 --estimators "
         "ols,wls,irls,ml,tls,ridge,huber,tukey,l1,essential,two_step,rls,map,log_cholesky,consistent,"
         "abc:iterations=20,de:iterations=20,ga:iterations=20,pso:iterations=20", True),
    Step("compare-simulating", "compare inputs/scara.yaml inputs/scara.csv --split first:0.67 --estimators "
         "didim,iv,cloe,clie,kalman", True),
    Step("selftest-random",
         "selftest generic-scara --plan inputs/scara-plan.json --truth random --seed 3 --rate 200", True),
)  # fmt: skip


def exports(names: Mapping[str, list[str]], tier: str) -> Iterator[Step]:
    """Yield an export to every format that ``dynident list`` names; in full also of models with other friction parts.

    Args:
        names: Of the exporters of motions (``exporters``) and of models (``model_exporters``).
        tier: ``quick`` or ``full``.
    """
    for name in names["motion_exporters"]:
        suffix, options = MOTIONS.get(name, ("", ""))
        plan = "seven-plan" if name == "libfranka" else "plan"
        words = f"export inputs/{plan}.json --to {name} -o {{out}}/motion{suffix} {options}"
        yield Step(f"export-motion-{name}", words)
    estimates = {"model": "identify"} | ({name: f"identify-{name}" for name in PARTS} if tier == "full" else {})
    for kind, estimate in estimates.items():
        for name in names["model_exporters"]:
            words = f"export answers/{estimate}/estimate.json --to {name} -o {{out}}/model{MODELS.get(name, '')}"
            yield Step(f"export-{kind}-{name}", words, iterated=True)
    if tier == "full":
        yield Step("inspect-exported", "inspect answers/export-model-urdf/model.urdf", iterated=True)


def on_real_logs() -> Iterator[Step]:
    """Yield what is asked about the real sets, each by its shipped case file."""
    for name, (folder, log) in REAL.items():
        case, estimate = f"inputs/cases/{name}.yaml", f"answers/real-{name}/estimate.json"
        yield Step(f"real-{name}", f"identify {case} -o {{out}}/estimate.json", True, folder)
        yield Step(f"real-{name}-validate", f"validate {estimate} data/{folder}/{log}", True, folder)
        yield Step(f"real-{name}-wls", f"identify {case} {_PLAIN}", True, folder)
        yield Step(f"real-{name}-check", f"check {case}", True, folder)
    for name, logs in DRAFTED.items():
        folder, _ = REAL[name]
        paths = " ".join(f"data/{folder}/{log}" for log in logs)
        yield Step(f"real-{name}-init", f"init data/{folder}/robot.urdf {paths} -o {{out}}/case.yaml", True, folder)
        yield Step(f"real-{name}-drafted", f"identify answers/real-{name}-init/case.yaml", True, folder)
    load = "gains inputs/cases/ur10e.yaml data/ur10e_mamedov/ident_20_01_31_unload.csv"
    load += " --load data/ur10e_mamedov/ident_20_01_13_load_2600.csv"
    yield Step("real-ur10e-gains", f"{load} --mass 2.6", True, "ur10e_mamedov")
    yield Step(
        "real-ur10e-payload",
        "payload answers/real-ur10e/estimate.json data/ur10e_mamedov/ident_20_01_13_load_2600.csv",
        True,
        "ur10e_mamedov",
    )
    yield Step("real-lwr4-auto", "identify inputs/cases/lwr4.yaml --friction auto", True, "kuka_lwr4_flobaroid")


def on_strangers(strangers: Mapping[str, Mapping[str, list[str]]]) -> Iterator[Step]:
    """Yield what is asked about the strangers.

    Args:
        strangers: By name: ``train``, ``test``, and ``options`` of ``init``; made with the inputs.
    """
    for name, one in strangers.items():
        place = f"inputs/strangers/{name}"
        train, test = (" ".join(f"{place}/{log}" for log in one[key]) for key in ("train", "test"))
        options, case = " ".join(one["options"]), f"{place}/case.yaml"
        words = f"init {place}/robot.urdf {train} --test {test} -o {{out}}/case.yaml {options}"
        yield Step(f"stranger-{name}-init", words, True)
        yield Step(f"stranger-{name}-check", f"check {case}", True)
        yield Step(f"stranger-{name}", f"identify {case} -o {{out}}/estimate.json", True)
        yield Step(f"stranger-{name}-validate", f"validate answers/stranger-{name}/estimate.json {test}", True)
