// The page: stages in the order of the work, one at a time, named in the address.

import { choose, get, guarded, known, listen, refresh } from "./api.js";
import { el, fill } from "./dom.js";
import { keepForm } from "./forms.js";
import * as robot from "./stage_robot.js";
import * as log from "./stage_log.js";
import * as setting from "./stage_case.js";
import * as check from "./stage_check.js";
import * as excite from "./stage_excite.js";
import * as identify from "./stage_identify.js";
import * as results from "./stage_results.js";
import * as compare from "./stage_compare.js";
import * as session from "./stage_session.js";

const STAGES = { robot, log, case: setting, check, excite, identify, results, compare, session };
const built = {};
let current = "";

// What a stage is done by, and what it needs first; the others are always ready.
const has = (kind) => known.files.some((file) => file.kind === kind);
const ran = (verb) => known.runs.some((run) => run.verb === verb && run.state === "done");
const DONE = {
  robot: () => has("robot") || has("case"), log: () => has("log"), case: () => has("case"), check: () => ran("check"), excite: () => has("plan"),
  identify: () => has("estimate"), results: () => ran("validate") || ran("export"), compare: () => ran("compare") || ran("diff"),
};
const NEEDS = { case: "log", check: "case", identify: "case", results: "estimate", compare: "case" };

function mark() {
  for (const link of document.querySelectorAll("#stages a[data-stage]")) {
    const stage = link.dataset.stage, needed = NEEDS[stage];
    const state = DONE[stage]?.() ? "done" : needed && !has(needed) ? "blocked" : DONE[stage] ? "ready" : "";
    if (link.dataset.state === state) continue;
    link.dataset.state = state;
    link.title = state === "blocked" ? `needs ${needed === "estimate" ? "an" : "a"} ${needed} first` : "";
    fill(link.querySelector(".state-word"), state && ` (${state})`);
  }
}

function enter() {
  const wanted = location.hash.replace(/^#\/?/, ""); // with a slash: a stage, no place on the page that a skip link goes to
  const key = STAGES[wanted] ? wanted : "robot";
  if (current) built[current].leave();
  if (current && current !== key) built[current].place.hidden = true;
  const main = document.getElementById("stage");
  if (!built[key]) {
    const made = STAGES[key].build();
    made.place = el("section", { "aria-labelledby": `title-${key}` }, el("h1", { id: `title-${key}` }, STAGES[key].title), made.whole);
    main.append(made.place);
    made.restore = keepForm(made.place, `form of ${key}`);
    built[key] = made;
  }
  built[key].place.hidden = false;
  for (const link of document.querySelectorAll("#stages a")) {
    if (link.hash === `#/${key}`) {
      link.setAttribute("aria-current", "page");
      link.scrollIntoView({ block: "nearest", inline: "nearest" }); // on a phone the stages are a row that scrolls
    } else link.removeAttribute("aria-current");
  }
  document.title = `${STAGES[key].title} · dynident studio`;
  const moved = current !== "" && current !== key;
  current = key;
  arrive();
  if (moved) {
    main.focus({ preventScroll: true });
    scrollTo(0, 0);
  }
}

// The stage that is shown offers the files that are there by now.
function arrive() {
  built[current].enter();
  built[current].restore();
}

async function begin() {
  if (location.search) history.replaceState(null, "", `/${location.hash}`); // the token leaves the address bar
  const list = Object.entries(STAGES).map(([key, stage]) => el("li", {}, el("a", { href: `#/${key}`, "data-stage": key }, stage.title, el("span", { class: "state-word" }))));
  fill(document.getElementById("stages"), el("ol", {}, list));
  listen(mark);
  await guarded(document.getElementById("stage"), async () => {
    const [choices] = await Promise.all([get("choices"), refresh()]);
    choose({ choices });
    fill(document.getElementById("where"), el("bdi", {}, known.folder));
    addEventListener("hashchange", enter);
    enter();
    addEventListener("made", arrive);
    addEventListener("focus", () => guarded(null, async () => { // another tab, or a command in a terminal, may have made files
      await refresh();
      arrive();
    }));
  });
}

// A file that misses its drop zone must not replace the page.
for (const event of ["dragover", "drop"]) addEventListener(event, (one) => one.preventDefault());
begin();
