// Stage 2: the log, as it is: columns, first rows, ranges, curves.

import { choose, get, guarded, known, ofKind } from "./api.js";
import { chart } from "./chart.js";
import { el, field, fill, name, next, number, options, put, say, several, table } from "./dom.js";
import { dropzone } from "./upload.js";

export const title = "Log";

export function build() {
  const choice = el("select", { "data-shared": "", on: { change: () => open(choice.value) } });
  const columns = several("Columns to draw", "At most 12 are drawn.", () => draw());
  const place = el("div");
  const curves = el("div", { class: "curves" });
  const box = el("div", { class: "pair", hidden: true }, columns, curves);
  let shown = "";

  async function open(log) {
    shown = log;
    fill(place);
    box.hidden = true;
    if (!log) return;
    choose({ log });
    await guarded(place, async () => {
      fill(place, el("p", { class: "soft" }, "reading …"));
      const found = await get("log", { name: log });
      if (shown !== log) return; // another one was chosen meanwhile
      tell(place, found);
      columns.offer(found.header);
      columns.choose(found.header.slice(1, 4));
      columns.dispatchEvent(new Event("offered", { bubbles: true }));
      box.hidden = found.rows === null;
      if (found.rows !== null) await draw();
      put(place, next("case", "Draft the case file"));
    });
  }

  async function draw() {
    const names = columns.picked().slice(0, 12);
    if (!names.length) return fill(curves);
    const log = shown;
    await guarded(curves, async () => {
      const found = await get("log", { name: log, columns: JSON.stringify(names) });
      if (shown !== log || JSON.stringify(names) !== JSON.stringify(columns.picked().slice(0, 12))) return;
      fill(curves, chart(names.map((label, k) => ({ label, ...found.curves[k] })), { title: "Columns of the log", xLabel: found.across, height: 280 }));
    });
  }

  return {
    whole: [
      el("p", { class: "lead" }, "Drop logs of motions: time, joint positions, and joint torques or motor currents."),
      dropzone("CSV, TwinCAT Scope, NumPy, Parquet, MATLAB, ROS bags", async (files) => {
        const logs = files.filter((file) => ofKind("log").includes(file));
        if (!logs.length) return say("none of these files is a log; they are kept with the other files of the session", true);
        options(choice, ofKind("log"), logs[0]);
        await open(choice.value);
      }),
      field("Log", choice), box, place,
    ],
    enter() {
      options(choice, ofKind("log"), known.log || choice.value);
      if (choice.value !== shown) open(choice.value);
      if (!choice.value) fill(place, el("p", { class: "soft" }, "There is no log yet."));
    },
    leave() {},
  };
}

function tell(place, found) {
  const rows = found.header.map((column, k) => {
    const range = found.ranges[k];
    const first = found.first.map((row) => el("span", { class: "cell" }, number(row[k], 6)));
    return [name(column), range ? number(range.lowest) : "–", range ? number(range.largest) : "–", range ? number(range.bad) : "–", first];
  });
  const count = found.rows === null ? "too large to be drawn here" : `${found.rows} rows`;
  fill(place,
    el("p", {}, `${found.header.length + found.more} columns, ${count}; ${found.how}`),
    table(["column", { text: "smallest", number: true }, { text: "largest", number: true }, { text: "not finite", number: true }, "first rows"], rows, { label: "columns of the log" }));
}
