// Stage 7: what an estimate says: its figures, its parameters, its torques; its report, files and exports.

import { choose, fileAddress, get, guarded, known, offerTargets, ofKind, reportAddress } from "./api.js";
import { chart } from "./chart.js";
import { el, field, fill, name, options, percent, picked, pretty, table } from "./dom.js";
import { answerText, commandLine, runner } from "./runner.js";

export const title = "Results";

export function build() {
  const choice = el("select", { id: "estimate-choice", on: { change: () => open(choice.value) } });
  const body = el("div");
  const logs = el("select", { multiple: true, size: 4 });
  const target = el("select");
  const description = el("select");
  const force = el("input", { type: "checkbox", id: "force" });
  let shown = "";

  const again = runner("validate", "Compare with these logs", () => ({ estimate: choice.value, logs: picked(logs) }), (run, place) => {
    place.append(answerText(run.answer), page(run.outputs[0]));
  });
  const report = runner("report", "Write a report", () => ({ estimate: choice.value, test: picked(logs), plan: "" }), (run, place) => place.append(page(run.outputs[0])));
  const write = runner("export", "Export", () => ({ file: choice.value, to: target.value, description: description.value, force: force.checked }), (run, place) => {
    const made = known.files.filter((file) => file.name.startsWith(run.outputs[0].split(".")[0])).map((file) => file.name);
    place.append(answerText(run.answer), el("ul", {}, made.map((file) => el("li", {}, download(file)))));
  });

  async function open(file) {
    shown = file;
    fill(body);
    if (!file) return fill(body, el("p", { class: "soft" }, "There is no estimate yet."));
    choose({ estimate: file });
    fill(body, el("p", { class: "soft" }, "reading …"));
    await guarded(body, async () => show(await get("estimate", { name: file }), file));
  }

  function show(found, file) {
    const written = file.replace("estimate", "report").replace(".json", ".html");
    fill(body, judged(found), answers(found), found.warnings.map((text) => el("p", { class: "remark" }, text)),
      el("p", { class: "actions" }, download(file), ofKind("report").includes(written) ? [download(written), opened(written)] : null),
      el("h2", {}, "Measured and predicted"),
      el("div", { class: "charts" }, found.torques.map((joint) => chart([
        { label: "measured", ...joint.measured, colour: 0 }, { label: "predicted", ...joint.predicted, colour: 2 },
      ], { title: joint.name, unit: pretty(joint.unit), xLabel: "kept samples of the fit" }))),
      el("h2", {}, "Parameters"), parameters(found),
      el("h2", {}, "Nominal and identified"), beside(found),
      found.command ? [el("h3", {}, "The command of this estimate"), commandLine(found.command)] : null,
      ofKind("report").includes(written) ? [el("h2", {}, "Report"), page(written)] : null);
  }

  return {
    whole: [
      field("Estimate", choice), body,
      el("h2", {}, "Validation on test logs"), field("Logs", logs, "Ctrl or Shift chooses several."), again.whole, report.whole,
      el("h2", {}, "Export the model"),
      el("div", { class: "row" }, field("Target", target), field("Robot model file to write into", description, "For targets that take one; none: that of the identification.")),
      el("p", { class: "tick" }, force, el("label", { for: "force" }, "export an estimate that is not accepted")), write.whole,
    ],
    enter() {
      options(choice, ofKind("estimate"), known.estimate || choice.value);
      const chosen = picked(logs);
      options(logs, ofKind("log"));
      for (const option of logs.options) option.selected = chosen.includes(option.value);
      guarded(null, () => offerTargets(target, "estimate"));
      options(description, [{ value: "", text: "none" }, ...ofKind("robot")]);
      if (choice.value !== shown || !shown) open(choice.value);
    },
    leave() {},
  };
}

export function judged(found) {
  const clean = found.verdict.word === "accepted";
  return [found.headline ? el("p", { class: clean ? "good" : "fault", role: clean ? "status" : "alert" }, found.headline) : null,
    found.causes.map((text) => el("p", { class: "fault" }, text)),
    found.unchecked ? el("p", { class: "remark" }, found.unchecked) : null];
}

// The parameters of the robot model beside those identified: torque errors, then the links.
function beside(found) {
  const shown = ({ heads, numbers, rows }, label) => rows.length ? table(heads.map((text, k) => ({ text, number: numbers[k] })), rows, { label }) : null;
  return [shown(found.nominal, "relative torque error"), shown(found.links, "links"),
    found.bodies.rows.length ? el("details", {}, el("summary", {}, "Masses, centres of mass and inertias"), shown(found.bodies, "bodies")) : null,
    found.no_links ? el("p", { class: "soft" }, found.no_links) : null];
}

export function answers(found) {
  const praised = !found.verdict.causes.length; // figures of a fit to faulty logs praise nothing
  const [error, fit] = [(found.test ?? found.train).total_relative_error, percent(found.train.total_relative_error)];
  const said = found.test ? `test error of the torque; training error ${fit}` : "training error of the torque; no test log yet";
  const known_ = found.parameters.filter((one) => one.relative_std !== null && one.relative_std < 0.1).length;
  const tile = (value, text, grade) => el("div", { class: `answer ${grade === "good" && !praised ? "fair" : grade}` }, el("dt", {}, value), el("dd", {}, text));
  return el("dl", { class: "answers" },
    tile(percent(error), said, error < 0.05 ? "good" : error < 0.15 ? "fair" : "bad"),
    tile(`${known_} of ${found.parameters.length}`, "base parameters known to better than 10 %", known_ * 2 > found.parameters.length ? "good" : "fair"),
    tile(found.physically_consistent ? "consistent" : "inconsistent", "physical consistency", found.physically_consistent ? "good" : "bad"));
}

function parameters(found) {
  const rows = found.table.map(([, called, ...figures]) => [name(called), ...figures.map((text) => text.replace(/^-|(?<=e)-/, "−"))]);
  const head = ["parameter", { text: "value", number: true }, { text: "std", number: true }, "unit", { text: "rel. std [%]", number: true }];
  return table(head, rows, { label: "base parameters" });
}

export function download(file) {
  return el("a", { href: fileAddress(file), download: "" }, `Download ${file}`);
}

export function opened(file) {
  return el("a", { href: reportAddress(file), target: "_blank", rel: "noopener" }, `Open ${file}`);
}

export function page(file) {
  return el("div", {}, el("p", { class: "actions" }, opened(file), download(file)),
    el("iframe", { class: "page", src: reportAddress(file), title: file, sandbox: "allow-scripts" }));
}
