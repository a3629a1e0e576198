// Stage 8: estimates side by side, and estimators on one case.

import { contest as ranking, difference } from "./answers.js";
import { get, known, ofKind } from "./api.js";
import { el, field, next, options, put, several } from "./dom.js";
import { runner } from "./runner.js";
import { page } from "./stage_results.js";

export const title = "Compare";

export function build() {
  const estimates = several("Estimates");
  const choice = el("select", { "data-shared": "" });
  const methods = several("Estimators");
  const limit = el("input", { type: "number", value: 60, min: 1, max: 86400, step: 1 });
  const whole = (file) => el("details", {}, el("summary", {}, "The whole comparison as a page"), page(file));
  const beside = runner("diff", "Put them side by side", () => ({ estimates: estimates.picked() }), async (run, place) => {
    const files = run.arguments.slice(1, run.arguments.indexOf("--html"));
    const views = await Promise.all(files.map(async (one) => ({ ...await get("estimate", { name: one }), tested: (await get("test-torques", { name: one })).torques })));
    put(place, difference(JSON.parse(run.answer), views), whole(run.outputs[0]), next("results", "Export the model"));
  });
  const contest = runner("compare", "Compare the estimators", () => ({ case: choice.value, estimators: methods.picked(), time_limit: limit.value }), (run, place) => {
    put(place, ranking(JSON.parse(run.answer)), whole(run.outputs[0]), next("identify", "Identify with the best"));
  });
  return {
    whole: [
      el("h2", {}, "Estimates of one robot"), estimates, beside.whole,
      el("h2", {}, "Estimators on one case"),
      el("div", { class: "row" }, field("Case", choice), field("Longest time of each [s]", limit)), methods, contest.whole,
    ],
    enter() {
      estimates.offer(ofKind("estimate"), ofKind("estimate").slice(-2));
      methods.offer(known.choices.estimators, ["ols", "wls", "consistent"]);
      options(choice, ofKind("case"), known.case || choice.value);
    },
    leave() {},
  };
}
