// Stage 7: what an estimate says: its figures, its parameters, its torques; its report, files and exports.

import { choose, fileAddress, get, guarded, known, offerTargets, ofKind, reportAddress } from "./api.js";
import { exported, grade, tiles, validated } from "./answers.js";
import { Cursor, chart } from "./chart.js";
import { el, field, fill, name, next, options, percent, pretty, put, several, table } from "./dom.js";
import { Stage3D } from "./playback.js";
import { commandLine, runner } from "./runner.js";

export const title = "Results";

export function build() {
  const choice = el("select", { id: "estimate-choice", "data-shared": "", on: { change: () => open(choice.value) } });
  const body = el("div");
  const logs = several("Logs");
  const cursor = new Cursor();
  const view = new Stage3D({ cursor });
  const charts = el("div");
  const linked = el("div", { class: "linked" });
  const data = el("select", { on: { change: () => curves() } });
  let drawn = {}; // torques and motion of each kind of data
  const target = el("select");
  const description = el("select");
  const force = el("input", { type: "checkbox", id: "force" });
  let shown = "";

  const again = runner("validate", "Compare with these logs", () => ({ estimate: choice.value, logs: logs.picked() }), (run, place) => {
    put(place, validated(JSON.parse(run.answer)), page(run.outputs[0]), next("compare", "Compare with another estimate"));
  });
  const report = runner("report", "Write a report", () => ({ estimate: choice.value, test: logs.picked(), plan: "" }), (run, place) => place.append(page(run.outputs[0])));
  const write = runner("export", "Export", () => ({ file: choice.value, to: target.value, description: description.value, force: force.checked }), (run, place) => {
    const made = known.files.filter((file) => file.name.startsWith(run.outputs[0].split(".")[0])).map((file) => file.name);
    put(place, el("ul", {}, made.map((file) => el("li", {}, download(file)))), exported(JSON.parse(run.answer)), next("session", "All files of the session"));
  }, (run) => ofKind("estimate").includes(run.arguments[1]));

  async function open(file) {
    shown = file;
    fill(body);
    if (!file) return fill(body, el("p", { class: "soft" }, "There is no estimate yet."));
    choose({ estimate: file });
    fill(body, el("p", { class: "soft" }, "reading …"));
    await guarded(body, async () => {
      const found = await get("estimate", { name: file });
      if (shown === file) show(found, file); // else another one was chosen meanwhile
    });
  }

  function show(found, file) {
    const written = file.replace("estimate", "report").replace(".json", ".html");
    fill(body, judged(found), answers(found), found.warnings.map((text) => el("p", { class: "remark" }, text)),
      el("p", { class: "actions" }, download(file), ofKind("report").includes(written) ? [download(written), opened(written)] : null),
      el("h2", {}, "Torques over time"), charts,
      el("h2", {}, "Parameters"), parameters(found),
      el("h2", {}, "Nominal and identified"), beside(found),
      found.command ? [el("h3", {}, "The command of this estimate"), commandLine(found.command)] : null,
      ofKind("report").includes(written) ? [el("h2", {}, "Report"), page(written)] : null);
    draw(found, file);
  }

  // Torques on the test data where they can be read, else on the training data.
  async function draw(found, file) {
    fill(charts, el("p", { class: "soft" }, "reading the test data …"));
    await guarded(charts, async () => {
      const tested = await get("test-torques", { name: file });
      if (shown !== file) return;
      drawn = { test: tested, training: found };
      const kinds = Object.keys(drawn).filter((kind) => drawn[kind].torques.length);
      if (!kinds.length) return fill(charts, el("p", { class: "soft" }, tested.missing));
      options(data, kinds.map((kind) => ({ value: kind, text: `${kind} data` })), kinds[0]);
      fill(charts, field("Data", data), tested.missing ? el("p", { class: "soft" }, tested.missing) : null,
        el("p", { class: "soft" }, "Point at a curve, or play the log: the robot stands as it did at that time."), linked);
      view.enter();
      await view.load(file);
      if (shown === file) curves();
    });
  }

  // The curves of all joints and the robot share a cursor: the pointer over a curve, or the time of the player.
  function curves() {
    const { torques, motion } = drawn[data.value];
    cursor.listeners.length = 1; // that of the robot; the curves before are gone
    fill(linked, view.whole, el("div", { class: "charts" }, torques.map((joint) => el("div", {},
      chart([{ label: "measured", ...joint.measured, colour: 1, width: 1.8 }, { label: "predicted", ...joint.predicted, colour: 2, dashed: true }], { title: joint.name, unit: pretty(joint.unit), xLabel: "", cursor }),
      chart([{ label: "residual", ...joint.residual, colour: 3 }], { title: `${joint.name}, measured - predicted`, unit: pretty(joint.unit), xLabel: "time [s]", height: 120, cursor })))));
    view.follow(motion);
  }

  return {
    whole: [
      field("Estimate", choice), body,
      el("h2", {}, "Validation on test logs"), logs, again.whole, report.whole,
      el("h2", {}, "Export the model"),
      el("div", { class: "row" }, field("Target", target), field("Robot model file to write into", description, "For targets that take one; none: that of the identification.")),
      el("p", { class: "tick" }, force, el("label", { for: "force" }, "export an estimate that is not accepted")), write.whole,
    ],
    enter() {
      options(choice, ofKind("estimate"), known.estimate || choice.value);
      logs.offer(ofKind("log"));
      guarded(null, () => offerTargets(target, "estimate"));
      options(description, [{ value: "", text: "none" }, ...ofKind("robot")]);
      if (choice.value !== shown || !shown) open(choice.value);
      else if (charts.firstChild) view.enter();
    },
    leave: () => view.leave(),
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
  const praised = ["accepted", "no criteria"].includes(found.verdict.word); // else figures praise nothing
  const [error, fit] = [(found.test ?? found.train).total_relative_error, percent(found.train.total_relative_error)];
  const said = found.test ? `test error of the torque; training error ${fit}` : "training error of the torque; no test log yet";
  const known_ = found.parameters.filter((one) => one.relative_std !== null && one.relative_std < 0.1).length;
  const toned = (tone) => (tone === "good" && !praised ? "fair" : tone);
  return tiles([percent(error), said, toned(grade(error))],
    [`${known_} of ${found.parameters.length}`, "base parameters with relative std below 10\u00a0%", toned(known_ * 2 > found.parameters.length ? "good" : "fair")],
    [found.physically_consistent ? "consistent" : "inconsistent", "physical consistency", toned(found.physically_consistent ? "good" : "bad")]);
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
