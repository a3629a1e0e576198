"""Several logs of one case: what a fit shows is looked for in those together that one set of parameters explains."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.faults import injections as put
from benchmarks.faults.trials import Trial, smooth_motion, virtual

from dynident.case.case import Case
from dynident.diagnosis.causes.pooled_logs import pooled_fit, pooled_logs
from dynident.diagnosis.causes.quick_fit import QuickFit
from dynident.diagnosis.causes.thin_fit import quick_fit
from dynident.diagnosis.examination import examine, examine_logs
from dynident.diagnosis.verdict import Verdict, check_lines, logs_apart
from dynident.model.friction import Motion
from dynident.model.inertia import Inertia
from dynident.results.verdict import reason_of


@pytest.fixture(scope="module")
def trials(case: Case) -> list[Trial]:
    return [virtual(case, seed, rate=rate) for seed, rate in ((0, 100.0), (1, 250.0), (2, 100.0))]


def written(trials: list[Trial], folder: Path) -> list[str]:
    return [str(trial.written(folder, f"run{k}")) for k, trial in enumerate(trials)]


def fits_of(trials: list[Trial], folder: Path) -> list[QuickFit]:
    found = [quick_fit(trials[0].case, trials[0].case.read(path)) for path in written(trials, folder)]
    return [fit for fit in found if fit is not None]


def turned(trial: Trial, joint: int) -> Trial:
    """Return a log with the torque of a joint turned in its sign."""
    tau = trial.columns["tau"].copy()
    tau[:, joint] *= -1.0
    return trial.with_columns(tau=tau)


def scaled(trial: Trial, joint: int, factor: float) -> Trial:
    """Return a log with the torque of a joint in another unit."""
    tau = trial.columns["tau"].copy()
    tau[:, joint] *= factor
    return trial.with_columns(tau=tau)


def test_rows_of_logs_together_are_those_of_each(trials: list[Trial], tmp_path: Path) -> None:
    """Logs of two rates; a fit of its own has rows nearer to the ends of its log."""
    fits = fits_of(trials, tmp_path)
    whole = pooled_fit(fits)
    time = np.asarray(whole.rows.prepared.kept.time)
    clock = whole.clock(time)
    assert clock.min() >= 0.0 and clock.max() < 20.0 and len(whole.starts) == 3
    at = 0
    for k, fit in enumerate(fits):
        mine = (time >= whole.starts[k]) & (time < (np.append(whole.starts, np.inf))[k + 1])
        own = np.asarray(fit.rows.prepared.kept.time) - fit.log.time[0]
        assert mine.sum() > 0.9 * len(own)
        for i in range(3):
            expected = np.column_stack(
                [np.interp(clock[mine], own, column) for column in (*fit.rows.blocks[i].T, fit.rows.torque[:, i])]
            )
            found = np.column_stack([whole.rows.blocks[i][mine], whole.rows.torque[mine, i]])
            close = np.abs(found - expected) < 0.02 * np.abs(expected).max(axis=0)
            assert close.mean() > 0.99
        at += int(mine.sum())
    assert at == len(time)


def test_logs_of_one_robot_are_alike(trials: list[Trial], tmp_path: Path) -> None:
    found = pooled_logs(fits_of(trials, tmp_path))
    assert found.together == (0, 1, 2)
    assert 0.5 < found.ratios.min() and found.ratios.max() < 1.5


def test_a_short_log_beside_longer_ones_is_a_note(trials: list[Trial], tmp_path: Path) -> None:
    """A right log of 600 s and one of 1.6 s had not been accepted."""
    case, first = trials[0].case, trials[0]
    part = first.with_columns(**{name: values[:150] for name, values in first.columns.items()})
    apart = part.with_columns(tau=2.0 * part.columns["tau"])
    for logs, severity in (([trials[1], part], []), ([trials[1], apart], ["note"]), ([part, part], ["error"])):
        found = examine_logs(case, written(logs, tmp_path))
        assert [one.severity for one in found[1].findings if one.name == "short log"] == severity


def at_rest(trial: Trial, joints: tuple[int, ...]) -> Trial:
    """Return a log with joints that stay where they are; their torques are not those of a rest."""
    q, dq = trial.columns["q"].copy(), trial.columns["dq"].copy()
    q[:, joints], dq[:, joints] = q[0, joints], 0.0
    return trial.with_columns(q=q, dq=dq)


def moved_at_rest(trial: Trial, case: Case, joint: int) -> Trial:
    """Return a log with a joint that stays where it is, with the torques of that motion."""
    rest = at_rest(trial, (joint,))
    t = rest.columns["t"]
    before, after = (
        case.model.torque(Motion(c["q"], c["dq"], np.gradient(c["dq"], t, axis=0)), case.model.nominal())
        for c in (trial.columns, rest.columns)
    )
    return rest.with_columns(tau=trial.columns["tau"] + after - before)


def test_a_joint_at_rest_in_one_log_that_others_move_is_a_note(trials: list[Trial], tmp_path: Path) -> None:
    case, last = trials[0].case, trials[0].case.robot.joint_names[2]
    first, *rest = examine_logs(case, written([moved_at_rest(trials[0], case, 2), *trials[1:]], tmp_path))
    assert [(one.severity, one.name, one.joint) for one in first.findings if one.joint == last] == [
        ("note", "at rest in one log", last)
    ]
    assert not first.left_out and all(one.sound for one in rest)
    apart, *_ = examine_logs(case, written([at_rest(trials[0], (2,)), *trials[1:]], tmp_path))  # of another motion
    assert [one.severity for one in apart.findings if one.joint == last] == ["warning"] and apart.left_out
    both = examine_logs(case, written([at_rest(trial, (2,)) for trial in trials[:2]], tmp_path))
    assert [[one.name for one in each.findings if one.severity == "error"] for each in both[:2]] == [
        ["joint never moved"]
    ] * 2
    paths = written([at_rest(trials[0], (2,)), trials[1]], tmp_path)  # moved by a log to test on alone
    first, *_ = examine_logs(replace(case, train=(paths[0],), test=(paths[1],)), paths)
    assert [one.name for one in first.findings if one.severity == "error"] == ["joint never moved"]


def test_logs_that_each_rest_another_joint_are_examined_together(trials: list[Trial], tmp_path: Path) -> None:
    """Each alone says too little; a torque that is turned in all of them is named, right ones are silent."""
    case = trials[0].case
    rested = [moved_at_rest(trial, case, joint) for joint, trial in enumerate(trials)]
    assert all(one.sound for one in examine_logs(case, written(rested, tmp_path)))
    found = examine_logs(case, written([turned(trial, 1) for trial in rested], tmp_path))
    assert "torque sign" in [each.name for one in found for each in one.findings if each.severity == "error"]


def test_right_logs_have_no_finding_together(trials: list[Trial], tmp_path: Path) -> None:
    *each, together = examine_logs(trials[0].case, written(trials, tmp_path))
    assert together.path == "all 3 logs" and together.sound
    assert [finding.name for finding in together.findings if finding.severity != "note"] == []
    assert not any("unlike" in finding.name for one in each for finding in one.findings)


def test_a_cause_that_logs_share_is_told_once(trials: list[Trial], tmp_path: Path) -> None:
    faulty = [scaled(trial, 1, 1.2) for trial in trials[:2]]
    first, second, together = examine_logs(trials[0].case, written(faulty, tmp_path))
    assert together.path == "both logs" and together.figures()["logs"] == [first.path, second.path]
    (error,) = [finding for finding in together.findings if finding.severity == "error"]
    assert error.name == "torque scale" and error.joint == trials[0].case.robot.joint_names[1]
    assert all(finding.severity != "error" for one in (first, second) for finding in one.findings)


def test_a_log_that_is_unlike_the_others_is_left_to_itself(trials: list[Trial], tmp_path: Path) -> None:
    joint = trials[0].case.robot.joint_names[1]
    mixed = [trials[0], turned(trials[1], 1), trials[2]]
    first, second, third, together = examine_logs(trials[0].case, written(mixed, tmp_path))
    assert together.path == "2 of 3 logs (run0.npz, run2.npz)" and together.sound and first.sound and third.sound
    alone = examine(trials[0].case, str(mixed[1].written(tmp_path, "alone")))
    assert ("error", "torque sign", joint) in {(one.severity, one.name, one.joint) for one in second.findings}
    assert [one.figures() for one in second.findings] == [one.figures() for one in alone.findings]


def test_what_only_tells_a_log_from_the_others_is_told(trials: list[Trial], tmp_path: Path) -> None:
    """Friction three times that of the other days: no fault of the log alone."""
    speed = trials[1].columns["dq"][:, 2]
    tau = trials[1].columns["tau"].copy()
    tau[:, 2] += 6.0 * np.tanh(speed / 0.01)
    mixed = [trials[0], trials[1].with_columns(tau=tau), trials[2]]
    first, second, third, together = examine_logs(trials[0].case, written(mixed, tmp_path))
    assert together.path == "2 of 3 logs (run0.npz, run2.npz)"
    (finding,) = [one for one in second.findings if one.name == "unlike other logs"]
    assert finding.severity == "warning" and finding.joint == trials[0].case.robot.joint_names[2]
    assert not any(one.name == "unlike other logs" for each in (first, third, together) for one in each.findings)


@pytest.mark.parametrize(("more", "severity"), [(0.2, "note"), (6.0, "warning")])
def test_a_log_far_from_the_others_is_a_warning_beside_any_other(
    more: float, severity: str, trials: list[Trial], tmp_path: Path
) -> None:
    """All have a spring that the case lacks; friction of one day is somewhat or far above that of the others."""
    spring = np.array([0.0, 8.0, 0.0])
    sprung = [one.with_columns(tau=one.columns["tau"] + spring * one.columns["q"]) for one in trials]
    tau = sprung[1].columns["tau"].copy()
    tau[:, 2] += more * np.tanh(trials[1].columns["dq"][:, 2] / 0.01)
    mixed = [sprung[0], sprung[1].with_columns(tau=tau), sprung[2]]
    found = examine_logs(trials[0].case, written(mixed, tmp_path))
    (finding,) = [one for one in found[1].findings if one.name == "unlike other logs"]
    is_warning = severity == "warning"
    assert finding.severity == severity and (found[1].findings[0] == finding) == is_warning
    assert ("do not fit it with the others" in finding.remedy) == is_warning
    quality = [one.figures() for one in found]
    assert ("unlike other logs" in "".join(check_lines(quality)[:1])) == is_warning


def test_of_two_logs_that_differ_each_is_examined_alone(trials: list[Trial], tmp_path: Path) -> None:
    mixed = [trials[0], turned(trials[2], 0)]
    first, second = examine_logs(trials[0].case, written(mixed, tmp_path))
    assert first.sound and not second.sound
    assert all(finding.name != "unlike other logs" for one in (first, second) for finding in one.findings)


def test_two_logs_that_contradict_each_other_say_so(trials: list[Trial], tmp_path: Path) -> None:
    """Friction three times that of the other day: no log shows it alone."""
    speed = trials[1].columns["dq"][:, 2]
    tau = trials[1].columns["tau"].copy()
    tau[:, 2] += 6.0 * np.tanh(speed / 0.01)
    found = examine_logs(trials[0].case, written([trials[0], trials[1].with_columns(tau=tau)], tmp_path))
    assert len(found) == 2
    for one in found:
        (finding,) = [each for each in one.findings if each.name == "unlike other logs"]
        assert finding.severity == "warning" and finding.evidence.startswith("the logs do not agree")
    one, other = (each.figures() for each in found)
    verdict = reason_of(Verdict((), (), True, logs_apart([one, other])))
    assert verdict.endswith("but logs that do not go with the others: run0.npz, run1.npz")
    other["findings"][0]["severity"] = "note"  # less far from it
    assert logs_apart([one, other]) == ("run0.npz", "run1.npz")
    one["findings"][0]["severity"] = "note"
    assert logs_apart([one, other]) == ()


@pytest.mark.parametrize("count", [2, 3])
def test_logs_with_and_without_a_tool_are_an_error_and_friction_of_another_day_is_none(
    count: int, trials: list[Trial], tmp_path: Path
) -> None:
    """What a training on both had identified was of neither, with a warning and exit code 0."""
    case = trials[0].case
    last = case.robot.links[-1]
    assert last.inertia is not None
    body = Inertia.from_centre_of_mass(2.0, np.array([0.05, 0.1, -0.1]), 0.002 * np.eye(3))
    robot = replace(case.robot, links=(*case.robot.links[:-1], replace(last, inertia=last.inertia + body)))
    loaded = replace(virtual(replace(case, robot=robot), 1), case=case)
    tau = trials[1].columns["tau"] + 6.0 * np.tanh(trials[1].columns["dq"] / 0.01) * (np.arange(3) == 2)
    for second, severity in ((loaded, "error"), (trials[1].with_columns(tau=tau), "warning")):
        found = examine_logs(case, written([trials[0], second, trials[2]][:count], tmp_path))
        told = [one for each in found for one in each.findings if one.name == "unlike other logs"]
        assert len(told) == (2 if count == 2 else 1) and {one.severity for one in told} == {severity}


@pytest.mark.parametrize(("mass", "severity"), [(0.0, "note"), (2.0, "error")])
def test_friction_at_far_other_speeds_is_a_note_and_a_tool_is_none(
    mass: float, severity: str, trials: list[Trial], tmp_path: Path
) -> None:
    """A slow joint has friction that plain friction of faster ones lacks; it had been a warning."""
    case, generator = trials[0].case, np.random.default_rng(3)
    last = case.robot.links[-1]
    assert last.inertia is not None
    body = Inertia.from_centre_of_mass(mass, np.array([0.05, 0.1, -0.1]), 0.001 * mass * np.eye(3))
    robot = replace(case.robot, links=(*case.robot.links[:-1], replace(last, inertia=last.inertia + body)))
    model, (t, fast) = replace(case.model, robot=robot), smooth_motion(case, 1)
    theta, share = model.nominal(), np.array([1.0, 1.0, 0.05])
    assert theta is not None
    middle = fast.q.mean(axis=0)
    motion = Motion(middle + share * (fast.q - middle), share * fast.dq, share * fast.ddq)
    tau = model.torque(motion, theta)
    tau = tau + 0.02 * tau.std(axis=0) * generator.normal(size=tau.shape)
    tau[:, 2] += 6.0 * np.tanh(motion.dq[:, 2] / 0.01)
    slow = Trial(case, {"t": t, "q": motion.q + 2e-5 * generator.normal(size=tau.shape), "dq": motion.dq, "tau": tau})
    found = examine_logs(case, written([trials[0], slow], tmp_path))
    told = [one for each in found for one in each.findings if one.name == "unlike other logs"]
    assert {one.severity for one in told} == {severity}
    assert any("friction of its own explains it" in one.evidence for one in told) == (severity == "note")


@pytest.mark.parametrize("factor", [0.45, 1.6, 2.2])
def test_torques_of_all_joints_that_the_masses_contradict_are_told_with_their_factor(
    factor: float, trials: list[Trial], tmp_path: Path
) -> None:
    mixed = [trials[0], trials[1].with_columns(tau=factor * trials[1].columns["tau"])]
    right, wrong = examine_logs(trials[0].case, written(mixed, tmp_path))
    assert not any(one.name == "torque scale" for one in right.findings)
    (scale,) = [one for one in wrong.findings if one.name == "torque scale"]
    assert scale.severity == "warning" and scale.joint == ""
    assert abs(1.0 + scale.numbers["value"] - factor) < 0.02 * factor


def test_a_delay_of_several_logs_has_no_count_of_samples(trials: list[Trial], tmp_path: Path) -> None:
    """Their rates differ."""
    late = [put.delayed(trial, 0.01 / put.step_of(trial)) for trial in trials]
    together = examine_logs(trials[0].case, written(late, tmp_path))[-1]
    alone = examine(trials[0].case, str(late[1].written(tmp_path, "alone")))
    for one, is_counted in ((together, False), (alone, True)):
        (delay,) = [each for each in one.findings if each.name == "torque delay"]
        assert abs(delay.numbers["delay_s"] - 0.01) < 1e-3
        assert ("2.49 samples" in delay.evidence) == is_counted and ("samples" in delay.evidence) == is_counted


def test_a_log_that_cannot_be_read_keeps_its_place(trials: list[Trial], tmp_path: Path) -> None:
    (tmp_path / "bad.csv").write_text("t,q1\n0,one\n", encoding="utf-8")
    paths = written(trials[:2], tmp_path)
    found = examine_logs(trials[0].case, [paths[0], str(tmp_path / "bad.csv"), paths[1]])
    assert [Path(one.path).name for one in found] == [
        "run0.npz",
        "bad.csv",
        "run1.npz",
        "2 of 3 logs (run0.npz, run1.npz)",
    ]
    assert [finding.name for finding in found[1].findings] == ["unreadable"]


def test_many_logs_are_fitted_in_parts(trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("dynident.diagnosis.examination.LONGEST_S", 45.0)
    found = examine_logs(trials[0].case, written([*trials, trials[0]], tmp_path))
    assert [one.path for one in found[4:]] == ["2 of 4 logs, from run0.npz on", "2 of 4 logs, from run2.npz on"]
    assert not any(finding.name == "unlike other logs" for one in found for finding in one.findings)


def test_parts_of_many_logs_are_compared(trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Torques of the last two logs, which are a part, are in another unit: neither part shows it alone."""
    monkeypatch.setattr("dynident.diagnosis.examination.LONGEST_S", 45.0)
    other = [trial.with_columns(tau=1.6 * trial.columns["tau"]) for trial in (trials[2], trials[1])]
    found = examine_logs(trials[0].case, written([*trials[:2], *other, trials[0], trials[2]], tmp_path))
    (first, second, third), alone = found[6:], found[:6]
    (finding,) = [each for each in second.findings if each.name == "unlike other logs"]
    assert finding.evidence.startswith("with parameters of the other logs its residual is")
    assert not any(each.name == "unlike other logs" for one in (first, third, *alone) for each in one.findings)
    monkeypatch.setattr("dynident.diagnosis.examination.LONGEST_S", 25.0)
    last = examine_logs(trials[0].case, written([*trials[:2], other[0]], tmp_path))[2]
    assert "unlike other logs" in [each.name for each in last.findings]  # parts of one log each


def test_a_log_without_torque_has_no_part(trials: list[Trial], tmp_path: Path) -> None:
    first, second, third, together = examine_logs(
        trials[0].case, written([trials[0], trials[1].without("tau"), trials[2]], tmp_path)
    )
    assert together.path == "2 of 3 logs (run0.npz, run2.npz)" and together.sound
    assert [one.name for one in second.findings] == ["no torque"] or second.left_out
    assert not any(one.name == "unlike other logs" for each in (first, second, third) for one in each.findings)


def test_a_part_of_many_logs_is_one_that_moves_each_joint(
    trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A log whose joint rests alone in its part was told that other logs do not go with it: none had been compared."""
    case = trials[0].case
    paths = written([moved_at_rest(trials[0], case, 2), *trials[1:]], tmp_path)
    monkeypatch.setattr("dynident.diagnosis.examination.LONGEST_S", 15.0)
    first, *_, together = examine_logs(case, paths)
    assert not first.left_out and [one.severity for one in first.findings if one.name == "at rest in one log"] == [
        "note"
    ]
    assert together.path == "2 of 3 logs, from run0.npz on"
    monkeypatch.setattr("dynident.diagnosis.examination.FULL", 1.0)
    first, *_ = examine_logs(case, paths)
    assert first.left_out.endswith("joints are at rest, and no log beside it moves them: name some that do as well")
    assert [one.severity for one in first.findings if one.name == "at rest in one log"] == ["note"]


def test_a_training_log_named_alone_is_told_by_the_others_of_its_case(trials: list[Trial], tmp_path: Path) -> None:
    paths = written([at_rest(trials[0], (2,)), trials[1], at_rest(trials[2], (2,))], tmp_path)
    case = replace(trials[0].case, train=tuple(paths[:2]))
    alone = examine(case, paths[0])
    assert [one.severity for one in alone.findings if one.name == "at rest in one log"] == ["note"]
    assert "other logs move it" in alone.findings[-1].evidence and alone.sound
    assert alone.left_out.endswith("name some that do as well")
    for other in (replace(case, train=(paths[0], paths[2])), replace(case, train=(paths[0],))):  # where none moves it
        assert [one.name for one in examine(other, paths[0]).findings if one.severity == "error"] == [
            "joint never moved"
        ]
    stranger = examine(case, paths[2])  # no log of the case: what is identified from it alone would lack the joint
    assert [one.name for one in stranger.findings if one.severity == "error"] == ["joint never moved"]


def test_a_log_to_test_on_is_one_however_its_path_is_written(
    trials: list[Trial], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A joint that a log to test on alone moves has never moved."""
    written([at_rest(trials[0], (2,)), trials[1]], tmp_path)
    monkeypatch.chdir(tmp_path)
    case = replace(trials[0].case, train=("run0.npz",), test=("run1.npz",))
    for name in ("run1.npz", "./run1.npz", str(tmp_path / "run1.npz")):
        first, *_ = examine_logs(case, ["run0.npz", name])
        assert [one.name for one in first.findings if one.severity == "error"] == ["joint never moved"]
    both = replace(case, train=("run0.npz", str(tmp_path / "run1.npz")))
    first, *_ = examine_logs(both, ["./run0.npz", "./run1.npz"])
    assert first.sound
