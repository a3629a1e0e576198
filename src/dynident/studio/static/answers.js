// The answers of commands as components: headings, tiles and tables in place of what a terminal prints.

import { Cursor, chart } from "./chart.js";
import { el, name, number, percent, pretty, table } from "./dom.js";

const num = (text) => ({ text, number: true });

export function tiles(...rows) {
  return el("dl", { class: "answers" }, rows.map(([value, text, tone = "fair"]) => el("div", { class: `answer ${tone}` }, el("dt", {}, value), el("dd", {}, text))));
}

export function grade(error) {
  return error < 0.05 ? "good" : error < 0.15 ? "fair" : "bad";
}

function warnings(list) {
  return (list ?? []).map((text) => el("p", { class: "remark" }, text));
}

// What a model does on logs: the errors of each joint beside those of the robot model's inertias.
export function validated(found) {
  const { test } = found;
  const fitted = test.nominal?.joints_friction_fitted;
  const rows = test.joints.map((joint, k) => [name(joint.name), ...(fitted ? [percent(fitted[k])] : []), percent(joint.relative_error), number(joint.rmse, 3), pretty(joint.unit), number(joint.r2, 3)]);
  const head = ["joint", ...(fitted ? [num("robot model, friction fitted")] : []), num("identified"), num("RMS error"), "unit", num("R²")];
  return [tiles([percent(test.total_relative_error), `test error of the torque; training error ${percent(found.train.total_relative_error)}`, ["accepted", "no criteria"].includes(found.verdict.word) ? grade(test.total_relative_error) : "fair"],
    [percent(found.extrapolation?.outside), "of the samples outside the training range", found.extrapolation?.beyond_training_range ? "bad" : "good"]),
    warnings(found.warnings), table(head, rows, { label: "relative torque error by joint" })];
}

// Estimates of one robot: their test errors, how far their torques differ, parameters that differ significantly.
export function difference(found, views) {
  const called = found.estimates.map((one) => one.name);
  const rows = found.estimates.map((one, k) => [name(one.name), one.estimator, percent(views[k].test?.total_relative_error), percent(one.training_error), one.physically_consistent ? "yes" : "no"]);
  const torques = found.torques.map((one) => [name(one.joint), ...one.rms.map((value) => number(value, 3)), ...one.rms_gap.slice(1).map((value) => number(value, 3))]);
  const apart = found.parameters.map((one) => ({ ...one, most: Math.max(...one.t.map(Math.abs).filter(Number.isFinite), 0) })).filter((one) => one.most > 1.96).sort((a, b) => b.most - a.most);
  const parameters = apart.slice(0, 30).map((one) => [name(one.name), ...one.values.map((value) => number(value, 3)), pretty(one.unit), number(one.most, 3)]);
  const cursor = new Cursor();
  const kind = views.every((view) => view.tested.length) ? "test" : "training";
  const curves = views.map((view) => kind === "test" ? view.tested : view.torques);
  const joints = curves[0].filter((one) => curves.every((all) => all.some((other) => other.name === one.name)));
  const residuals = joints.map((one) => chart(curves.map((all, k) => ({ label: called[k], ...all.find((other) => other.name === one.name).residual })), { title: one.name, unit: pretty(one.unit), xLabel: "time [s]", height: 150, cursor }));
  return [table(["estimate", "estimator", num("test error"), num("training error"), "physically consistent"], rows, { label: "estimates" }),
    torques.length ? [el("h3", {}, "Torques on the same states"), table(["joint", ...called.map((one) => num(`RMS of ${one}`)), ...called.slice(1).map((one) => num(`RMS difference of ${one}`))], torques, { label: "torques", note: `N·m or N; differences from ${called[0]}` })] : el("p", { class: "remark" }, found.why_no_torques ?? ""),
    residuals.length ? [el("h3", {}, `Residuals, each on its ${kind} data`), el("div", { class: "charts" }, residuals)] : null,
    el("h3", {}, "Base parameters that differ significantly at 95 %"),
    parameters.length ? table(["parameter", ...called.map(num), "unit", num("largest |t|")], parameters, { label: "parameters", note: apart.length > 30 ? `the first 30 of ${apart.length}` : "" }) : el("p", { class: "good" }, `None of ${found.parameters.length}.`)];
}

// Estimators on one case, as the command ranks them.
export function contest(found) {
  const rows = found.methods.map((one) => [name(one.method), one.failure ?? percent(one.test_error), percent(one.training_error), one.physically_consistent === null ? "–" : one.physically_consistent ? "yes" : "no", number(one.seconds, 3)]);
  return [warnings(found.warnings), table(["estimator", num("test error"), num("training error"), "physically consistent", num("time [s]")], rows, { label: "estimators" })];
}

// A file for another program: what was proved of it, what it cannot hold.
export function exported(found) {
  const model = found.left_out !== undefined; // else a motion
  const proofs = (model ? found.proofs : []).map((one) => [one.engine, one.what ?? "", one.relative === null ? one.why_not : number(one.relative, 2), number(one.allowed, 2)]);
  const left = (found.left_out ?? []).map((one) => [name(one.joint), one.part, one.symbol, number(one.value, 3), pretty(one.unit ?? "")]);
  return [proofs.length ? table(["loaded again by", "compared", num("relative difference of torques"), num("allowed")], proofs, { label: "proofs" }) : null,
    left.length ? el("details", {}, el("summary", {}, `Left out of the file: ${left.length} terms`), table(["joint", "part", "symbol", num("value"), "unit"], left, { label: "left out" })) : null,
    found.rows ? limits(found.rows) : null,
    warnings((found.notes ?? []).filter((text) => typeof text === "string"))];
}

// A designed motion: its criterion, and how much of each limit it uses.
export function plannedMotion(plan) {
  const last = Math.max(...plan.check.rows.map((row) => row.used ?? 0));
  return [tiles([number(plan.values.unit_condition ?? plan.values.condition, 3), "condition number of the observation matrix"],
    [percent(last), "of a limit is used at most", last <= 1 ? "good" : "bad"],
    [`${number(plan.trajectory.period, 3)} s`, "period"]), limits(plan.check.rows)];
}

function limits(rows) {
  const shown = rows.map((row) => [name(row.joint), row.quantity, number(row.value, 3), number(row.limit, 3), pretty(row.unit), percent(row.used)]);
  return el("details", {}, el("summary", {}, "Limits, joint by joint"), table(["joint", "quantity", num("largest"), num("limit"), "unit", num("used")], shown, { label: "limits" }));
}
