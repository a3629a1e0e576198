"""Motions of a benchmark: plans that its file names, or motions that are designed once and kept beside the results."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from dynident.errors import DynidentError, FileError
from dynident.excitation.design.excitation import design_excitation
from dynident.excitation.design.options import SearchOptions, TrajectoryOptions
from dynident.excitation.design.plan import Plan, read_plan, write_plan
from dynident.excitation.trajectories.base import Designable
from dynident.model.dynamic_model import DynamicModel
from dynident.studies.benchmark.experiment import Experiment
from dynident.studies.benchmark.virtual_tasks import Motions


def motions_of(
    experiment: Experiment, folder: str | Path, progress: Callable[[str], None] = lambda step: None
) -> dict[str, Motions]:
    """Return the motions of each robot of an experiment.

    Those that are designed are written into the folder; there they are found when the benchmark goes on, so that all
    its logs are of the same motion.

    Args:
        experiment: The benchmark.
        folder: Where its results are kept.
        progress: Called with each design.

    Raises:
        DynidentError: A plan of another robot or a damaged one, or no motion that keeps the limits.
    """
    found = {}
    for number, (name, model) in enumerate(experiment.models.items()):
        pair = []
        for seed, kind, stated in ((0, "train", experiment.motion.train), (1, "test", experiment.motion.test)):
            if stated:
                plan = _stated(experiment.path.parent / stated, model)
            else:
                plan = _designed(
                    experiment, model, Path(folder) / f"{kind}-{number + 1}.plan.json", seed, progress, name
                )
            pair.append(plan)
        found[name] = Motions(*pair)
    return found


def _stated(path: Path, model: DynamicModel) -> Designable:
    plan = read_plan(path)
    return _checked(plan, path, model)


def _designed(
    experiment: Experiment, model: DynamicModel, path: Path, seed: int, progress: Callable[[str], None], name: str
) -> Designable:
    motion = experiment.motion
    try:
        return _checked(read_plan(path), path, model)
    except DynidentError:
        if path.exists():
            raise
    progress(f"design of a motion for {name}")
    plan = design_excitation(
        model,
        trajectory=TrajectoryOptions(period=motion.period, harmonics=motion.harmonics),
        search=SearchOptions(starts=motion.starts, seed=experiment.seed + seed, time_limit=motion.time_limit),
    )
    write_plan(plan, path)
    return plan.trajectory


def _checked(plan: Plan, path: Path, model: DynamicModel) -> Designable:
    if plan.joints != model.robot.joint_names:
        step = f"give a plan for {', '.join(model.robot.joint_names)}, or another folder"
        raise FileError(path, f"a plan for {', '.join(plan.joints)}", step)
    return plan.trajectory
