// Stage 4: findings of the log checks, with evidence and remedy.

import { choose, known, ofKind } from "./api.js";
import { el, field, fill, name, next, options, several } from "./dom.js";
import { runner } from "./runner.js";

export const title = "Check";

export function build() {
  const choice = el("select", { "data-shared": "", on: { change: () => choose({ case: choice.value }) } });
  const logs = several("Logs", "None: those of the case. To repair, choose one.");
  const found = el("div");
  const ask = (fix) => () => ({ case: choice.value, logs: logs.picked(), fix });
  const repairs = (run) => run.arguments.includes("--fix");
  const check = runner("check", "Check the logs", ask(false), (run, place) => show(run, place, found), (run) => !repairs(run));
  const fix = runner("check", "Apply safe repairs", ask(true), (run, place) => show(run, place, found), repairs);
  fix.button.className = "";
  return {
    whole: [
      el("p", { class: "lead" }, "Log checks before a fit: time, units, signs, order of joints, delays, saturation, excitation."),
      el("div", { class: "row" }, field("Case", choice), logs),
      check.whole, fix.whole, found,
    ],
    enter() {
      options(choice, ofKind("case"), known.case || choice.value);
      logs.offer(ofKind("log"));
    },
    leave() {},
  };
}

function show(run, place, found) {
  let data = null;
  try {
    data = JSON.parse(run.answer);
  } catch {
    const error = run.progress.findLast((line) => line.startsWith("error:"));
    place.append(el("p", { class: "fault", role: "alert" }, error ? error.slice(7) : "the command gave no answer"));
    return;
  }
  fill(found,
    el("p", { class: data.sound ? "good" : "fault" }, data.sound ? "No finding stands against a fit." : "A finding stands against a fit: see the errors below."),
    data.logs.map((log) => [el("h2", {}, name(log.log ?? log.path ?? "log")), findings(log.findings)]),
    data.fixes ? el("ul", {}, data.fixes.map((fix) => el("li", {}, fix))) : null,
    next("identify", "Identify the model"));
}

function findings(list) {
  if (!list.length) return el("p", { class: "soft" }, "Nothing found.");
  return el("ul", { class: "findings" }, list.map((one) => el("li", { class: one.severity },
    el("p", {}, el("strong", {}, one.severity), " ", one.name.replaceAll("_", " "), one.joint ? [" of ", name(one.joint)] : null),
    [["", one.evidence], ["soft", one.remedy]].map(([kind, text]) => el("p", { class: kind }, text.replaceAll("+-", "±"))))));
}
