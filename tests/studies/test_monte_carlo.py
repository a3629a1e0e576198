"""The benchmark: conditions from a file, records that survive anything, figures of merit by closed forms."""

import itertools
import json
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dynident.errors import BadOption, DescriptionError, FileError, UnknownChoice
from dynident.excitation.trajectories.rest_fourier import RestFourier
from dynident.studies.benchmark.experiment import Experiment, read_experiment, shipped_benchmarks
from dynident.studies.benchmark.runner import Records, run_tasks, worth_another_try
from dynident.studies.benchmark.summary import summary_of
from dynident.studies.benchmark.virtual_tasks import Motions, VirtualWork, recorded
from dynident.workers.processes import Here

SMALL = """\
benchmark: 1
title: a small one
robots: [generic-scara]
friction: [{coulomb: {width: 0.1}}, viscous, offset]
cell: {controller: {pd: {rate: 400}}, recorder: {rate: 400}, truth: {friction: {F0: [0.3, -0.2, 0.1, 0.05]}}}
rates_hz: [100]
duration_s: 4
noise:
  - {name: none, position: 0, torque: 0}
  - {name: some, position: 1.0e-4, torque: 0.3}
draws: 2
guess: 0.15
preparations:
  filtered: {filter: {butterworth: {cutoff_hz: 25}}, trim_s: 0.2}
  raw: {unfiltered: true, trim_s: 0.2}
methods:
  filtered: [ols, {huber: {bound: 2}}]
  raw: [ols]
quick: {draws: 1, noise: some, methods: {filtered: [ols]}}
"""


@pytest.fixture
def small(tmp_path: Path) -> Path:
    path = tmp_path / "small.yaml"
    path.write_text(SMALL)
    return path


def work_of(experiment: Experiment) -> VirtualWork:
    (model,) = experiment.models.values()
    motions = []
    for seed in (1, 2):
        generator, free = np.random.default_rng(seed), RestFourier.free_map(4)
        rows = []
        for joint in model.robot.active:
            middle = 0.5 * (joint.limits.lower + joint.limits.upper)
            reach = 0.2 * (joint.limits.upper - joint.limits.lower)
            rows.append(free @ np.r_[middle, reach * generator.uniform(-0.4, 0.4, free.shape[1] - 1)])
        motions.append(RestFourier.from_table(rows, 4.0))
    return VirtualWork(experiment, {model.robot.name: Motions(*motions)})


@dataclass(frozen=True)
class NumberedTask:
    number: int

    @property
    def label(self) -> str:
        return str(self.number)

    @property
    def facts(self) -> Mapping[str, Any]:
        return {"number": self.number}


class Counted:
    def result(self, task: NumberedTask) -> dict[str, Any]:
        return {"failure": None, "number": task.number}


def without_times(result: dict) -> dict:
    return {key: value for key, value in result.items() if key != "seconds"}


def test_the_shipped_benchmark_states_the_conditions_of_its_source(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert "tx40" in shipped_benchmarks()
    (tmp_path / "tx40").mkdir()  # a folder of results does not hide it
    monkeypatch.chdir(tmp_path)
    found = read_experiment("tx40")
    assert {level.position for level in found.noise} == {1e-4, 1e-3, 1e-2}
    assert {level.torque for level in found.noise} == {0.05, 0.1}
    assert found.rates == (500.0, 100.0) and found.draws == 25 and found.guess == 0.15
    labels = [entrant.label for entrant in found.entrants]
    assert "didim with controller (filtered)" in labels and "ols (raw)" in labels
    quick = read_experiment("tx40", quick=True)
    assert quick.draws == 2 and len(quick.noise) == 2 and len(quick.entrants) < len(found.entrants)
    truth = VirtualWork(found, {}).truth("tx40-like", found.noise[0], 0)
    (model,) = found.models.values()
    named = {p.name: float(v) for p, v in zip(model.parameters, truth, strict=True)}
    assert named["Ia[joint6]"] == 0.0096 and named["Fv[joint1]"] == 8.05 and named["F0[joint2]"] == 1.37


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("draws: 2", "draws: 0", "draws = 0"),
        ("guess: 0.15", "guess: 1.5", "guess = 1.5"),
        ("  raw: [ols]", "  raw: [{didim: {controller: known}}]", "a plain pd controller and its gains"),
        ("noise: some", "noise: other", "no noise 'other'"),
        ("F0: [0.3, -0.2, 0.1, 0.05]", "F0: [0.3, 1]", "for each of the 4 joints"),
        ("title: a small one", "tilte: a small one", "title"),
        ("torque: 0.3}", "torque: 0.3, set: riple.amplitude=1}", "ripple"),
        ("torque: 0.3}", "torque: 0.3, set: [ripple.high=1]}", r"line 10, noise\.2\.set: ripple: unknown key 'high'"),
        ("torque: 0.3}", "torque: 0.3, set: ripple}", r"line 10, noise\.2\.set: --set = 'ripple' is not possible"),
        ("truth: {friction", "truth: {believed: nominal, friction", "parameters or believed"),
        ("  raw: [ols]", "  raw: ols", r"methods.*raw.*not a list; write a list of estimators, such as \[ols, wls\]"),
        ("  raw: [ols]", "  raw: [{iv: {controller: guessed}}]", "controller: guessed; write controller: known"),
        ("  raw: [ols]", "  raw: [ols, ols]", r"methods = \[.*\] is not possible; give at least one, each once"),
        ("robots: [generic-scara]\n", "", "robots: no robot; name at least one robot or case file"),
        ("[generic-scara]", "[]", "robots: neither a text nor a list of texts; write one"),
        (
            "[generic-scara]",
            "[generic-scara, generic-scara]",
            "two robots called 'generic-scara'; benchmark them apart",
        ),
        ("benchmark: 1", "benchmark: 7", "a benchmark of version 7; this dynident reads versions up to 1"),
        ("quick: {draws: 1, noise: some", "other: {draws: 1, noise: some", "unknown key 'other'"),
    ],
)
def test_faults_of_a_file_are_named(small: Path, old: str, new: str, words: str) -> None:
    assert old in SMALL
    small.write_text(SMALL.replace(old, new))
    with pytest.raises(DescriptionError, match=words):
        read_experiment(str(small), quick="other" in new)
    with pytest.raises(UnknownChoice, match="tx40"):
        read_experiment("tx4")


def test_a_file_may_lack_its_short_form_or_a_method(small: Path) -> None:
    small.write_text(SMALL.partition("quick:")[0])
    with pytest.raises(DescriptionError, match="it states no short form; run it without --quick, or with --draws 1"):
        read_experiment(str(small), quick=True)
    with pytest.raises(UnknownChoice, match="no method of this benchmark called 'wls'"):
        read_experiment(str(small), methods=["wls"])
    kept = read_experiment(str(small), methods=["ols"], draws=5)
    assert [entrant.label for entrant in kept.entrants] == ["ols (filtered)", "ols (raw)"] and kept.draws == 5
    small.write_text(SMALL[: SMALL.index("methods:")] + "methods: {raw: [ols]}\n")
    assert [entrant.label for entrant in read_experiment(str(small)).entrants] == ["ols (raw)"]
    with pytest.raises(FileError, match=r"nowhere\.yaml: there is no such file"):
        read_experiment(str(small.parent / "nowhere.yaml"))


def test_a_run_that_is_broken_off_goes_on_with_the_same_results_in_any_order(small: Path, tmp_path: Path) -> None:
    work = work_of(read_experiment(str(small)))
    tasks = work.tasks()
    assert len(tasks) == 2 * 2 * 3 and len({json.dumps(task.facts, sort_keys=True) for task in tasks}) == len(tasks)
    whole = {task.label: result for task, result in run_tasks(work, tasks, Records(tmp_path / "whole"))}
    list(itertools.islice(run_tasks(work, tasks, Records(tmp_path / "parts")), 5))  # broken off after five
    kept = sorted((tmp_path / "parts").iterdir())
    assert len(kept) == 5
    kept[0].write_text(kept[0].read_text()[:40])  # as if a disk had lost the end
    begun: list[str] = []
    again = list(run_tasks(work, tasks[::-1], Records(tmp_path / "parts"), progress=begun.append))
    assert len(begun) == len(tasks) - 4
    for task, result in again:
        assert without_times(result) == without_times(whole[task.label])
    assert [row.figures() for row in summary_of(again)] == [row.figures() for row in summary_of(again[::-1])]


def test_more_draws_and_other_methods_take_what_is_there(small: Path, tmp_path: Path) -> None:
    records, begun = Records(tmp_path / "kept"), list[str]()
    first = work_of(read_experiment(str(small), methods=["ols"], draws=1))
    assert len(list(run_tasks(first, first.tasks(), records))) == 4
    more = work_of(read_experiment(str(small), methods=["ols"]))
    assert len(list(run_tasks(more, more.tasks(), records, progress=begun.append))) == 8 and len(begun) == 4
    other = replace(more.experiment, guess=0.1)
    assert all(records.read(task) is None for task in work_of(other).tasks())


def test_figures_of_merit(small: Path, tmp_path: Path) -> None:
    work = work_of(read_experiment(str(small)))
    results = list(run_tasks(work, work.tasks(), Records(tmp_path)))
    rows = {(row.noise, row.method): row for row in summary_of(results)}
    assert set(rows) == {
        (n, m) for n in ("none", "some") for m in ("ols (filtered)", "huber:bound=2 (filtered)", "ols (raw)")
    }
    clean, noisy = rows["none", "ols (filtered)"], rows["some", "ols (filtered)"]
    assert clean.medians["torque_distance"] < 0.01 < 1 and clean.failures == 0
    assert clean.medians["torque_distance"] < noisy.medians["torque_distance"]
    assert rows["some", "huber:bound=2 (filtered)"].means["iterations"] >= 1
    for row in rows.values():
        assert 0 <= row.coverage <= 1 and 0 <= row.consistent <= 1 and row.draws == 2
        assert row.medians["parameter_distance"] <= row.tails["parameter_distance"]


def test_conditions_may_differ_in_any_effect_of_the_cell(small: Path) -> None:
    rough = (
        "  - {name: rough, position: 0, torque: 0, set: [ripple.amplitude=3, payload.mass=0.7, truth.friction.F0=0]}"
    )
    small.write_text(SMALL.replace("draws: 2", f"{rough}\ndraws: 1").replace("raw: [ols]", "raw: []"))
    work = work_of(read_experiment(str(small), methods=["ols"]))
    found = {task.noise.name: (task, work.result(task)) for task in work.tasks()}
    clean, rippled = (found[name][1]["torque_distance"] for name in ("none", "rough"))
    assert clean < 0.01 < rippled
    cells = [found[name][0].facts for name in ("none", "rough")]
    assert [facts["cell"]["ripple"]["amplitude"] for facts in cells] == [[0.0], [3.0]]
    (model,) = work.experiment.models.values()
    logged = [recorded(work, model.robot.name, found[name][0].noise, 0)[1] for name in ("none", "rough")]
    masses, offsets = ([p.symbol == symbol for p in model.parameters] for symbol in ("m", "F0"))
    assert np.sum(logged[1][masses]) == pytest.approx(np.sum(logged[0][masses]) + 0.7)
    assert logged[0][offsets].tolist() == [0.3, -0.2, 0.1, 0.05] and not logged[1][offsets].any()


def test_a_case_brings_its_own_cell(small: Path) -> None:
    case = "case: 1\nrobot: generic-scara\nfriction: [viscous]\ncell: {controller: pid, recorder: {rate: 200}}\n"
    (small.parent / "arm.yaml").write_text(case)
    cell = next(line for line in SMALL.splitlines() if line.startswith("cell:"))
    small.write_text(SMALL.replace("robots: [generic-scara]", "robots: [arm.yaml]").replace(cell, ""))
    found = read_experiment(str(small))
    ((name, setup),) = found.cells.items()
    assert setup.cell.recorder.rate == 200 and type(setup.cell.controller).__name__ == "Pid"
    assert [type(part).__name__ for part in found.models[name].friction] == ["Viscous"]


def test_jobs_and_time_limits_that_cannot_be(small: Path, tmp_path: Path) -> None:
    work, records = work_of(read_experiment(str(small))), Records(tmp_path)
    with pytest.raises(BadOption, match="jobs"):
        list(run_tasks(work, work.tasks(), records, jobs=0))
    with pytest.raises(BadOption, match="time limit"):
        list(run_tasks(work, work.tasks(), records, time_limit=0.0))
    with pytest.raises(BadOption, match="a cluster does not count it"):
        list(run_tasks(work, work.tasks(), records, processor_limit=5.0, pool=Here()))


def test_a_task_that_ended_at_a_limit_is_tried_again_with_a_longer_one(tmp_path: Path) -> None:
    records, work, tasks = Records(tmp_path), Counted(), [NumberedTask(1), NumberedTask(2), NumberedTask(3)]
    records.write(tasks[0], {"failure": "ended", "seconds": 5.0, "time_limit": 5.0})
    records.write(tasks[1], {"failure": "ended", "seconds": 5.0, "processor_limit": 5.0})
    records.write(tasks[2], {"failure": "it cannot be", "seconds": 0.1})
    for limits, tried in (
        ({"time_limit": 5.0, "processor_limit": 5.0}, []),
        ({"time_limit": 6.0, "processor_limit": 5.0}, [1]),
        ({"time_limit": 5.0, "processor_limit": 6.0}, [2]),
        ({"time_limit": None, "processor_limit": 5.0}, [1]),
        ({"time_limit": 5.0, "processor_limit": None}, [2]),
    ):
        for task in tasks:
            kept = records.read(task)
            assert kept is not None and worth_another_try(kept, limits) == (task.number in tried)
    done = dict(run_tasks(work, tasks, records))
    assert [done[task].get("number") for task in tasks] == [1, 2, None]


@pytest.mark.battery
def test_processes_give_the_same_and_a_late_task_fails(small: Path, tmp_path: Path) -> None:
    work = work_of(read_experiment(str(small)))
    tasks = work.tasks()
    alone = {task.label: result for task, result in run_tasks(work, tasks, Records(tmp_path / "alone"))}
    for task, result in run_tasks(work, tasks, Records(tmp_path / "two"), jobs=2):
        assert without_times(result) == without_times(alone[task.label])
    late = Records(tmp_path / "late")
    ((_, failed),) = run_tasks(work, tasks[:1], late, time_limit=1e-3)
    assert "time limit" in failed["failure"]
    ((_, kept),) = run_tasks(work, tasks[:1], late, time_limit=1e-3)
    assert kept == failed
    ((_, better),) = run_tasks(work, tasks[:1], late, time_limit=100.0)
    assert better["failure"] is None
