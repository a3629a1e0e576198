// Stage 6: from logs to the model, with its progress.

import { choose, get, known, ofKind } from "./api.js";
import { el, field, next, options, put, several } from "./dom.js";
import { runner } from "./runner.js";
import { answers, judged } from "./stage_results.js";

export const title = "Identify";

export function build() {
  const choice = el("select", { "data-shared": "", on: { change: () => choose({ case: choice.value }) } });
  const estimator = el("select");
  const friction = several("Friction", "None: as the case says; auto chooses as a draft does.");
  const cutoff = el("input", { type: "number", min: 0.01, max: 10000, step: 0.1, placeholder: "as the case says" });
  const quick = el("input", { type: "checkbox", id: "quick" });
  const run = runner("identify", "Identify", () => ({
    case: choice.value, estimator: estimator.value, friction: friction.picked(), cutoff: cutoff.value, quick: quick.checked,
  }), async (done, place, again) => {
    if (!again) choose({ estimate: done.outputs[0] });
    const found = await get("estimate", { name: done.outputs[0] });
    put(place, judged(found), answers(found), found.warnings.map((text) => el("p", { class: "remark" }, text)),
      next("results", "See the result"));
  });
  return {
    whole: [
      el("p", { class: "lead" }, "From the logs of a case to a physically consistent model with the standard deviation of each parameter."),
      el("div", { class: "row" }, field("Case", choice), field("Estimator", estimator), field("Cut-off [Hz]", cutoff)),
      el("details", {}, el("summary", {}, "More choices"),
        friction,
        el("p", { class: "tick" }, quick, el("label", { for: "quick" }, "quick: without cross-validation and without fits at other cut-offs"))),
      run.whole,
    ],
    enter() {
      options(choice, ofKind("case"), known.case || choice.value);
      options(estimator, [{ value: "", text: "as the case says" }, ...known.choices.estimators]);
      friction.offer(["auto", ...known.choices.friction]);
    },
    leave() {},
  };
}
