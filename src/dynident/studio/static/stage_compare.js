// Stage 8: estimates side by side, and estimators on one case.

import { known, ofKind } from "./api.js";
import { el, field, options, picked } from "./dom.js";
import { answerText, runner } from "./runner.js";
import { page } from "./stage_results.js";

export const title = "Compare";

export function build() {
  const estimates = el("select", { multiple: true, size: 6 });
  const choice = el("select");
  const methods = el("select", { multiple: true, size: 8 });
  const limit = el("input", { type: "number", value: 60, min: 1, max: 86400, step: 1 });
  const shown = (run, place) => place.append(page(run.outputs[0]), answerText(run.answer));
  const beside = runner("diff", "Put them side by side", () => ({ estimates: picked(estimates) }), shown);
  const contest = runner("compare", "Compare the estimators", () => ({ case: choice.value, estimators: picked(methods), time_limit: limit.value }), shown);
  return {
    whole: [
      el("h2", {}, "Estimates of one robot"), field("Estimates", estimates, "Ctrl or Shift chooses several."), beside.whole,
      el("h2", {}, "Estimators on one case"),
      el("div", { class: "row" }, field("Case", choice), field("Estimators", methods, "Ctrl or Shift chooses several."), field("Longest time of each [s]", limit)), contest.whole,
    ],
    enter() {
      for (const [select, items, first] of [[estimates, ofKind("estimate"), []], [methods, known.choices.estimators, ["ols", "wls", "consistent"]]]) {
        const chosen = select.options.length ? picked(select) : first;
        options(select, items);
        for (const option of select.options) option.selected = chosen.includes(option.value);
      }
      options(choice, ofKind("case"), known.case || choice.value);
    },
    leave() {},
  };
}
