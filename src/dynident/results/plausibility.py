"""What plausible bodies cost, and where the data contradict the robot model, in sentences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from dynident.identification.estimate.estimate import Estimate
from dynident.identification.estimate.plausibility import TOTAL_MASS, ContradictedBound, Plausibility
from dynident.identification.estimate.validation import Validation
from dynident.model.plausible import consistency_defects, is_too_light, mean_density, shape_points
from dynident.model.robot import Link, Robot
from dynident.results.text import Column, Table, format_number, format_percent, label
from dynident.robot_files.tree import PLACEHOLDERS, weightless


def plausibility_lines(estimate: Estimate, test: Validation | None) -> list[str]:
    """Return what the bounds cost, which bounds the data contradict, and what is wrong with nominal inertias."""
    facts = Plausibility.of(estimate.run)
    if facts is None:
        return []
    is_default = estimate.options.get("bodies") == "auto"
    usual = "plausible links are the default: --bodies free, or bodies: free in the case, fits without their bounds"
    lines = [cost_line(test, is_default) or (usual if is_default else "")]
    lines += contradictions(facts.contradicted)
    if names := ", ".join(map(label, links_without_size(estimate.model.robot))):
        step = "give shapes in the robot model, or body: in the constraints"
        lines.append(f"no size known for {names}: taken from the nominal centre of mass; {step}")
    lines += mesh_lines(estimate.provenance.get("meshes") or ())
    lines += nominal_lines(estimate.model.robot, facts)
    return [line for line in lines if line]


def ranges_table(estimate: Estimate) -> Table:
    """Return the mass of each link with its range; without rows where no ranges were asked for."""
    facts, links, theta = Plausibility.of(estimate.run), estimate.model.robot.links, estimate.theta
    heads = ("nominal", "identified", "least", "largest")
    note = "links within their bounds at a cost within the noise of the data; all ten parameters: --json, --report FILE"
    rows: list[tuple[str, ...]] = []
    for i, link in enumerate(links if facts is not None and facts.ranges and theta is not None else ()):
        assert facts is not None and theta is not None
        nominal = None if link.inertia is None else link.inertia.mass
        rows.append((label(link.name), *map(range_end, (nominal, theta[10 * i + 9], *facts.ranges[10 * i + 9]))))
    return Table((Column("link"), *(Column(name, "kg", numeric=True) for name in heads)), tuple(rows), note)


def range_end(value: float | None) -> str:
    """Return a value, and a dash where nothing holds it, or where none is proven."""
    return "–" if value is None or not np.isfinite(value) else format_number(value, 3)


def nominal_lines(robot: Robot, facts: Plausibility) -> list[str]:
    """Return which nominal inertias are missing, impossible or no bodies of their link's size, and what is taken."""
    lines, defects, light = [], consistency_defects(robot.links), _weightless(robot)
    if links := links_of_unknown_mass(robot, facts):
        stated = "placeholders" if PLACEHOLDERS in robot.note else "none"
        why = f"the log does not determine them, and the robot model states {stated}"
        lines.append(
            f"masses of {links} are not known: {why}; state them there, or mass or total_mass in the constraints"
        )
    if names := ", ".join(label(name) for name in facts.uniform if name not in (*defects, *facts.massless)):
        lines.append(f"no inertia of {names} in the robot model: a uniform body is the reference; state it there")
    if names := "; ".join(f"{label(name)}, {defects[name]}" for name in facts.uniform if name in defects):
        what = f"impossible inertia in the robot model: {names}"
        lines.append(f"{what}: a uniform body is the reference; correct the robot model")
    hidden = {link.name: link.impossible for link in robot.links if link.impossible and link.name not in defects}
    if names := "; ".join(f"{label(why)}, in the sum of {label(name)}" for name, why in hidden.items()):
        what = f"impossible inertia in the robot model: {names}"
        lines.append(f"{what}, which is possible and the reference; correct the robot model")
    if names := ", ".join(map(label, facts.widened)):
        what = f"the robot model's inertia of {names} reaches beyond the link's shapes: its size holds both"
        lines.append(f"{what}; where the inertia is a guess, state body: in the constraints")
    fitted = [link for link in robot.links if link.name in facts.fitted and link.name not in light]
    solid = {link.name: link.inertia and link.inertia.solid() for link in fitted}
    large = {name: body for name, body in solid.items() if body and is_too_light(body)}
    if names := ", ".join(
        f"{label(name)} ({mean_density(body):.2g} kg/m³ at equal density)" for name, body in large.items()
    ):
        what = f"the robot model's inertia is too large for the mass, as a placeholder is: {names}"
        lines.append(f"{what}; a uniform body of that mass is the reference; correct it in the robot model")
        light = light | set(large)
    bare = [link.name for link in robot.links if not len(shape_points(link))]
    thin = "thinner than links of its size are, or outside its constraints", "correct it"
    wide = "outside the size and thickness assumed from frames and mass, as there are no shapes", "give shapes"
    for (what, step), is_bare in ((thin, False), (wide, True)):
        names = [name for name in facts.fitted if name not in light and (name in bare) == is_bare]
        if names:
            links = "all links" if len(names) == len(robot.links) > 1 else ", ".join(map(label, names))
            fate = f"the nearest inside is the reference; {step} in the robot model"
            end = "or state body: and thickness: in the constraints"
            lines.append(f"the robot model's inertia of {links} is {what}: {fate}, {end}")
    return lines


def links_of_unknown_mass(robot: Robot, facts: Plausibility | None) -> str:
    """Return the links whose mass neither data nor robot model determine, as words; empty where there are none."""
    names = () if facts is None else facts.massless
    return "all links" if len(names) == len(robot.links) else ", ".join(map(label, names))


def nominal_state(link: Link) -> str:
    """Return whether a body can have the inertia of a link: why none can, that it is flat or a point, or hides one."""
    inertia = link.inertia
    if inertia is None or inertia.defect():
        return "not stated" if inertia is None else consistency_defects([link])[link.name]
    shape = "" if inertia.is_consistent() else ", flat" if inertia.solid() else ", a point"
    return f"consistent{shape}" + (f", but not {link.impossible}" if link.impossible else "")


def mesh_lines(faults: Sequence[Mapping[str, str]]) -> list[str]:
    """Return which meshes say nothing about the size of their link, and why: the first in full."""
    if not faults:
        return []
    first, names = faults[0], ", ".join(label(fault["link"]) for fault in faults)
    return [f"size of {names} from frames, not from meshes ({label(first['evidence'])}); {first['remedy']}"]


def _weightless(robot: Robot) -> set[str]:
    return weightless({link.name: link.inertia for link in robot.links})


def links_without_size(robot: Robot) -> list[str]:
    """Return the links of a mass without shapes, children and named frames away from their own frame."""
    found, light = [], _weightless(robot)
    for i, link in enumerate(robot.links):
        places = [joint.translation for joint in robot.joints if joint.parent == i]
        places += [frame.translation for frame in robot.frames.values() if frame.link == i]
        if (
            link.name not in light
            and link.inertia is not None
            and link.inertia.mass > 0
            and not len(shape_points(link))
            and not np.any(places)
        ):
            found.append(link.name)
    return found


def cost_line(test: Validation | None, is_default: bool) -> str:
    """Return the test error with plausible bodies and without their bounds; empty without a test."""
    if test is None or test.free_bodies_error is None or not test.free_bodies_error > 0:
        return ""
    errors = [format_percent(value) for value in (test.total_relative_error, test.free_bodies_error)]
    links = "plausible links (the default)" if is_default else "plausible links"
    return f"{links}: test error {errors[0]}; with --bodies free {errors[1]}"


def contradictions(found: Sequence[ContradictedBound]) -> list[str]:
    """Return which bounds the data contradict, and what became of them, those of one kind and fate in one line."""
    alike: dict[tuple[str, bool], list[ContradictedBound]] = {}
    for one in found:
        alike.setdefault((one.bound, one.is_relaxed), []).append(one)
    return [_contradiction(bound, is_relaxed, each) for (bound, is_relaxed), each in alike.items()]


def _contradiction(bound: str, is_relaxed: bool, found: Sequence[ContradictedBound]) -> str:
    most = max(found, key=lambda one: one.gain)
    they, more = (("it", ""), ("them", f", most by {label(most.name)}"))[len(found) > 1]
    bounds = "its bound is" if len(found) == 1 else "their bounds are"
    fate = f"{bounds} relaxed" if is_relaxed else f"{bounds.replace('bound', 'stated bound')} kept: check {they}"
    if bound != "mass" and is_relaxed:
        fate += "; check inertia and shapes in the robot model (without shapes the size is assumed)"
    numbers = f"chi-square {format_number(most.statistic, 3)} > {format_number(most.limit, 3)}"
    gain = f"training error {format_number(100 * most.gain, 2)} % lower without the bound"
    names = [TOTAL_MASS if one.name == TOTAL_MASS else label(one.name) for one in found]
    subject = bound_name(found[0]) if len(found) == 1 else f"{bound} of {', '.join(names)}"
    return f"{subject}: the data contradict {they} ({numbers}; {gain}{more}); {fate}"


def bound_name(found: ContradictedBound) -> str:
    """Return what a bound is of, such as ``mass of upper``."""
    return TOTAL_MASS if found.name == TOTAL_MASS else f"{found.bound} of {label(found.name)}"


def plausible_words(facts: Plausibility | None) -> str:
    """Return `` and plausible`` with the bounds that were relaxed; empty where the links have no bounds."""
    if facts is None:
        return ""
    relaxed = ", ".join(bound_name(one) for one in facts.contradicted if one.is_relaxed)
    return f" and plausible but for {relaxed} (bound relaxed)" if relaxed else " and plausible"
