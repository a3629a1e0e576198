// Stage 3: the case file: drafted from robot and logs, its columns and units mapped, its questions answered.

import { choose, get, guarded, kept, known, ofKind, post, refresh } from "./api.js";
import { el, field, fill, name, next, options, say, several, table } from "./dom.js";
import { keepForm } from "./forms.js";
import { runner } from "./runner.js";
import { robots } from "./stage_robot.js";

export const title = "Case";

const WORDS = { q: "positions", dq: "velocities", torque: "joint torques", current: "motor currents", q_ref: "commanded positions", dq_ref: "commanded velocities" };

export function build() {
  const robot = el("select", { "data-shared": "" });
  const logs = several("Training logs");
  const tests = several("Test logs", "None: the last third of the log is kept for that.");
  const profile = el("select");
  const choice = el("select", { id: "case-choice", "data-shared": "", on: { change: () => open(choice.value) } });
  const body = el("div");
  let drafted = null;
  let shownFile = "";

  const draft = runner("init", "Draft the case file", () => ({
    robot: robot.value, logs: logs.picked(), test: tests.picked(), profile: profile.value,
  }), async (run, place, again) => {
    drafted = JSON.parse(run.answer);
    options(choice, ofKind("case"), again ? choice.value : drafted.case);
    if (choice.value === drafted.case) await open(drafted.case);
  });

  async function open(file) {
    fill(body);
    if (!file) return;
    choose({ case: file });
    await guarded(body, async () => {
      const found = await get("case", { name: file });
      if (choice.value === file) show(found); // else another one was chosen meanwhile
    });
  }

  function show(found) {
    const file = choice.value;
    const mine = drafted && drafted.case === file ? drafted : null;
    const mapping = completed(found.mapping, mine);
    const state = found.fault
      ? el("p", { class: "fault", role: "alert" }, found.fault)
      : [el("p", { class: "good" }, "This case can be used: robot, columns and units are stated."), next("check", "Check the logs")];
    const unsaved = kept.get(`text of ${file}`);
    const editor = el("textarea", { value: unsaved || found.text, spellcheck: false, rows: 24, wrap: "off" });
    editor.addEventListener("input", () => kept.set(`text of ${file}`, editor.value === found.text ? "" : editor.value));
    shownFile = found.sha256;
    const save = el("button", { type: "button", on: { click: () => saved({ text: editor.value }) } }, "Save the text");
    const drop = el("button", { type: "button", class: "quiet", on: { click: () => {
      kept.set(`text of ${file}`, "");
      open(file);
    } } }, "Take the file as it is");
    const asks = found.questions.map((question) => el("li", { class: question.needed ? "needed" : "" },
      el("button", { type: "button", class: "line", on: { click: () => jump(editor, question.line) } }, `line ${question.line}`),
      el("span", {}, question.asks_for)));
    fill(body, state,
      mine ? remarks(mine) : null,
      asks.length ? [el("h3", {}, "What it asks"), el("ul", { class: "asks" }, asks)] : null,
      mapping ? mapper(mapping) : null,
      el("h3", {}, "The file"), field("Text of the case file", editor, "docs/case-file.md describes every key."),
      unsaved && unsaved !== found.text ? el("p", { class: "remark" }, "This text has changes that are not saved. ", drop) : null, el("p", { class: "actions" }, save));
  }

  function mapper(mapping) {
    const header = mapping.header;
    const time = options(el("select"), ["", ...header].map(blank), mapping.time);
    const grid = mapping.all_joints.map((joint) => ({ joint, at: mapping.joints.indexOf(joint), cells: {} }));
    const signals = known.choices.signals;
    const rows = grid.map((row) => [name(row.joint), ...signals.map((signal) => {
      const cell = options(el("select", { "aria-label": `${WORDS[signal]} of ${row.joint}` }), ["", ...header].map(blank), mapping.signals[signal]?.[row.at] ?? "");
      row.cells[signal] = cell;
      return cell;
    })]);
    const units = Object.fromEntries(Object.entries(known.choices.units).map(([quantity, words]) => {
      const now = mapping.units[quantity];
      const several = Array.isArray(now) ? [{ value: JSON.stringify(now), text: now.join(", ") }] : [];
      return [quantity, options(el("select"), [{ value: "", text: "not stated" }, ...several, ...words], several.length ? several[0].value : now || "")];
    }));
    const used = () => grid.filter((row) => row.cells.q.value);
    const unsaved = `columns of ${choice.value} ${shownFile}`;
    const keep = el("button", { type: "button", on: { click: () => saved({
      joints: used().map((row) => row.joint),
      time: time.value,
      signals: Object.fromEntries(signals.map((signal) => [signal, used().map((row) => row.cells[signal].value)]).filter(([, cells]) => cells.some(Boolean))),
      units: Object.fromEntries(Object.entries(units).map(([quantity, unit]) => [quantity, unit.value.startsWith("[") ? JSON.parse(unit.value) : unit.value])),
    }, unsaved) } }, "Save columns and units");
    const whole = el("div", {}, el("h3", {}, "Columns and units"), field("Column of the time", time),
      table(["joint", ...signals.map((signal) => WORDS[signal])], rows, { label: "columns of each joint", note: "A joint without a column of positions is not in the log." }),
      el("div", { class: "row" }, Object.entries(units).map(([quantity, unit]) => field(`Unit of ${quantity}`, unit))),
      el("p", { class: "hint" }, "SI: rad, rad/s and N·m for joints that turn, m, m/s and N for joints that slide."),
      el("p", { class: "actions" }, keep));
    keepForm(whole, unsaved)();
    return whole;
  }

  async function saved(changes, unsaved = "") {
    const file = choice.value;
    body.inert = choice.disabled = true; // a second click while the disk works would save an older text
    await guarded(null, async () => {
      const found = await post("case", { name: file, sha256: shownFile, ...changes });
      drafted = null;
      if (changes.text !== undefined) kept.set(`text of ${file}`, "");
      if (unsaved) kept.set(unsaved, "");
      await refresh();
      show(found);
      say(found.fault ? "saved; it cannot be used yet" : "saved");
    });
    body.inert = choice.disabled = false;
  }

  return {
    whole: [
      el("p", { class: "lead" }, "A case file says which columns are which signals, in which units, and what is to be identified. It is drafted from robot and logs; what they do not determine, it asks for."),
      el("div", { class: "row" }, field("Robot", robot), field("Profile of the log", profile, "Found from the columns where none is chosen.")),
      el("div", { class: "row" }, logs, tests),
      draft.whole, el("h2", {}, "Case file"), field("Case file", choice), body,
    ],
    enter() {
      options(robot, robots().filter((one) => !ofKind("case", "estimate").includes(one)), known.robot || robot.value);
      for (const list of [logs, tests]) list.offer(ofKind("log"));
      if (!logs.picked().length && known.log) logs.choose([known.log]);
      options(profile, [{ value: "", text: "as found" }, ...known.choices.profiles]);
      const before = choice.value;
      options(choice, ofKind("case"), known.case || choice.value);
      if (choice.value && (choice.value !== before || !body.children.length)) open(choice.value);
    },
    leave() {},
  };
}

function blank(column) {
  return column === "" ? { value: "", text: "–" } : column;
}

// What a profile reads stands in no column of the file, only in what was recognised.
function completed(mapping, draft) {
  if (!mapping || !draft || Object.keys(mapping.signals).length) return mapping;
  const signals = Object.fromEntries(Object.entries(draft.signals).map(([signal, one]) => [signal, one.columns]));
  const words = (quantity) => mapping.units[quantity] || draft.units[quantity]?.unit || "";
  const units = Object.fromEntries(Object.keys(mapping.units).map((quantity) => [quantity, words(quantity)]));
  return { ...mapping, signals, units, time: mapping.time || draft.time };
}

function remarks(draft) {
  const told = Object.entries(draft.signals).map(([signal, one]) => [WORDS[signal] || signal, el("span", {}, one.columns.length > 3 ? `${one.columns[0]} … ${one.columns.at(-1)}` : one.columns.join(", ")), one.evidence]);
  for (const [quantity, unit] of Object.entries(draft.units)) told.push([`unit of ${quantity}`, `${unit.unit} (${unit.confidence})`, unit.evidence]);
  return [el("h3", {}, "What was recognised"), table(["what", "found", "by what"], told, { label: "what was recognised" }),
    draft.remarks.map((text) => el("p", { class: "remark" }, text))];
}

function jump(editor, line) {
  const lines = editor.value.split("\n");
  const start = lines.slice(0, line - 1).reduce((sum, text) => sum + text.length + 1, 0);
  editor.focus();
  editor.setSelectionRange(start, start + lines[line - 1].length);
  editor.scrollTop = (line - 4) * (editor.scrollHeight / lines.length);
}
