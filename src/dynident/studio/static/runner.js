// A command that runs: its line to copy, its steps as they come, a button that breaks it off, its answer.

import { get, guarded, known, post, refresh } from "./api.js";
import { el, fill, say } from "./dom.js";

export function commandLine(text) {
  const copy = el("button", { type: "button", class: "quiet", on: { click: () => copied(text) } }, "Copy");
  return el("div", { class: "command" }, el("pre", { tabIndex: 0 }, el("code", {}, text)), copy);
}

async function copied(text) {
  try {
    await navigator.clipboard.writeText(text);
    say("copied");
  } catch {
    say("the browser does not allow it; select the line and copy it", true);
  }
}

function clock(seconds) {
  const whole = Math.floor(seconds);
  return whole < 60 ? `${seconds.toFixed(1)} s` : `${Math.floor(whole / 60)} min ${String(whole % 60).padStart(2, "0")} s`;
}

const taken = new Set(); // commands that a button shows

// A button with the place below it where the command tells of itself. `ask` returns the choices; `done` gets the run,
// and whether it is shown again. Of several buttons with one command, `mine` says whose a run is.
export function runner(verb, label, ask, done = () => {}, mine = () => true) {
  const place = el("div", { class: "run" });
  const button = el("button", { type: "button", class: "go" }, label);
  async function watch(begin, again = false) {
    button.disabled = !again;
    await guarded(place, async () => {
      await follow(place, await begin());
      const last = place.run;
      if (!again) await refresh();
      if (last.state === "done") await done(last, place, again);
      if (!again) dispatchEvent(new Event("made")); // the stage that is shown by now offers the new files
    });
    button.disabled = false;
  }
  button.addEventListener("click", () => watch(() => post("run", { verb, choices: ask() })));
  // A page that was loaded again, or opened on another day, goes on with the command that runs, and shows the last result.
  const left = known.runs.findLast((run) => run.verb === verb && !taken.has(run.number) && mine(run) && shown(run));
  if (left) {
    taken.add(left.number);
    setTimeout(() => watch(() => get("run", { number: left.number }), left.state !== "running"));
  }
  return { whole: el("div", {}, el("p", { class: "actions" }, button), place), button, place };
}

// A result whose files are gone is not shown.
function shown(run) {
  const files = new Set(known.files.map((file) => file.name));
  return run.state === "running" || (run.state === "done" && (run.outputs.every((name) => files.has(name)) || run.verb === "export"));
}

async function follow(place, first) {
  const state = el("p", { class: "state", role: "status" });
  const steps = el("ol", { class: "steps" });
  const bar = el("progress", { max: 1, "aria-label": "progress" });
  const cancel = el("button", { type: "button", class: "quiet", on: { click: () => guarded(null, () => post("cancel", { number: first.number })) } }, "Cancel");
  fill(place, commandLine(first.command), el("p", { class: "actions" }, state, cancel), bar, steps);
  let run = first;
  let seen = 0;
  const lines = [];
  while (true) {
    for (const line of run.progress) {
      lines.push(line);
      steps.append(el("li", {}, line.trim()));
      while (steps.children.length > 12) steps.firstChild.remove();
    }
    seen = run.lines;
    if (run.limit_s) bar.value = Math.min(1, run.took_s / run.limit_s);
    fill(state, run.state === "running" ? `running, ${clock(run.took_s)}` : `${words(run)}, ${clock(run.took_s)}`);
    if (run.state !== "running") break;
    await new Promise((next) => setTimeout(next, seen ? 300 : 120));
    run = await get("run", { number: first.number, since: seen });
  }
  cancel.remove();
  bar.remove();
  place.run = { ...run, progress: lines };
  if (run.state === "done") {
    if (lines.length > 3) {
      const folded = el("details", {}, el("summary", {}, `${lines.length} lines of progress`));
      steps.before(folded);
      folded.append(steps);
    }
    return;
  }
  const error = lines.findLast((line) => line.startsWith("error:"));
  if (run.state === "failed") place.append(el("p", { class: "fault", role: "alert" }, error ? error.slice(7) : "the command failed; its lines are above"));
}

function words(run) {
  const judged = { 3: ", criteria not met", 4: ", not accepted" };
  return { done: `done${judged[run.code] ?? ""}`, failed: "failed", cancelled: "cancelled, nothing was left behind" }[run.state];
}
