// Stage 5: a motion that tells the parameters, designed within the limits, watched, and written for a controller.

import { choose, fileAddress, guarded, known, offerTargets, ofKind } from "./api.js";
import { el, field, fill, next, options, put, several } from "./dom.js";
import { exported, plannedMotion } from "./answers.js";
import { Stage3D } from "./playback.js";
import { runner } from "./runner.js";
import { robots } from "./stage_robot.js";

export const title = "Excite";

function entry(value, min, max, step) {
  return el("input", { type: "number", value, min, max, step });
}

export function build() {
  const choice = el("select", { on: { change: () => show() } });
  const criterion = el("select");
  const trajectory = el("select");
  const earlier = el("select");
  const friction = several("Friction parts", "None: those of the case. A part that needs the torque of the bodies, as load does, has to be left out.");
  const [period, harmonics, starts, limit, margin, torque] = [entry(10, 0.5, 600, 0.5), entry(5, 1, 50, 1), entry(4, 1, 1000, 1), entry(60, 1, 86400, 1), entry(0.05, 0, 0.9, 0.01), entry(0.2, 0, 0.9, 0.01)];
  const plan = el("select", { "data-shared": "", on: { change: () => watch() } });
  const target = el("select");
  const speed = entry(20, 10, 100, 5);
  const posture = el("input", { type: "text", value: "start" });
  const links = el("div");
  const view = new Stage3D({ motions: () => ofKind("plan"), caseOf: () => choice.value, label: "Plan to watch" });

  async function show() {
    if (choice.value && view.scene?.source !== choice.value) await guarded(links, async () => {
      fill(links);
      await view.load(choice.value);
    });
  }

  async function watch() {
    if (!plan.value) return;
    choose({ plan: plan.value });
    await show();
    await view.open(plan.value);
    fill(links, el("p", {}, el("a", { href: fileAddress(plan.value), download: "" }, `Download ${plan.value}`)));
  }

  const design = runner("excite", "Design the motion", () => ({
    case: choice.value, criterion: criterion.value, trajectory: trajectory.value, period: period.value, harmonics: harmonics.value,
    starts: starts.value, time_limit: limit.value, margin: margin.value, torque_margin: torque.value, earlier: earlier.value, friction: friction.picked(),
  }), async (run, place, again) => {
    put(place, plannedMotion(await (await fetch(fileAddress(run.outputs[0]))).json()), next("log", "Play it on the robot, record it, and drop the log"));
    if (again) return;
    options(plan, ofKind("plan"), run.outputs[0]);
    await watch();
  });
  const write = runner("export", "Write it", () => ({ file: plan.value, to: target.value, speed: speed.value, posture: posture.value }), (run, place) => {
    put(place, exported(JSON.parse(run.answer)), el("p", {}, el("a", { href: fileAddress(run.outputs[0]), download: "" }, `Download ${run.outputs[0]}`)));
  }, (run) => ofKind("plan").includes(run.arguments[1]));
  return {
    whole: [
      el("p", { class: "lead" }, "The motion that determines the model as well as the limits allow. Watch the first run on the robot at low speed."),
      el("div", { class: "row" }, field("Case or robot", choice, "A case with a workspace keeps its clearances."), field("Criterion", criterion), field("Trajectory", trajectory), field("What is known from", earlier)),
      el("div", { class: "row" }, field("Period [s]", period), field("Harmonics", harmonics), field("Random starts", starts), field("Longest search [s]", limit), field("Unused share of limits", margin), field("Unused share of torque", torque)),
      el("details", {}, el("summary", {}, "Friction"), friction),
      design.whole, el("h2", {}, "Watch it"), field("Plan", plan), links, view.whole,
      el("h2", {}, "For the controller"), el("div", { class: "row" }, field("Target", target), field("Speed [%]", speed), field("Where the robot stands", posture, "start: at the first posture; or joint positions in rad and m with commas; empty for a controller that drives there by itself.")), write.whole,
    ],
    enter() {
      const { choices } = known;
      options(choice, [...ofKind("case", "robot"), ...choices.robots.map((one) => ({ value: one, text: `${one} (ships)` }))], choice.value || known.case || known.robot);
      for (const [select, key, first] of [[criterion, "criteria", "d_optimal"], [trajectory, "trajectories", "rest_fourier"]]) {
        options(select, choices[key], select.value || first);
      }
      guarded(links, () => offerTargets(target, "plan"));
      options(earlier, [{ value: "", text: "nothing" }, ...ofKind("estimate")]);
      friction.offer(choices.friction);
      options(plan, ofKind("plan"), known.plan || plan.value);
      view.enter();
      show();
    },
    leave: () => view.leave(),
  };
}
