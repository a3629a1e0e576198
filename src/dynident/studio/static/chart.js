// Curves as SVG: one chart, several lines, axes with round numbers, drawn anew for each width so that letters keep their size.

import { el, number } from "./dom.js";

const SPACE = "http://www.w3.org/2000/svg";
const COLOURS = 6;

function svg(tag, attributes, text = "") {
  const made = document.createElementNS(SPACE, tag);
  for (const [key, value] of Object.entries(attributes)) made.setAttribute(key, value);
  if (text) made.textContent = text;
  return made;
}

function ticks(low, high, count) {
  const rough = (high - low) / count;
  const power = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((k) => k * power).find((size) => size >= rough);
  const found = [];
  for (let at = Math.ceil(low / step) * step; at <= high + 1e-9 * step; at += step) found.push(Math.abs(at) < 1e-9 * step ? 0 : at);
  return found;
}

const widths = new ResizeObserver((seen) => seen.forEach(({ target, contentRect }) => {
  const width = Math.round(contentRect.width);
  if (width) target.replaceChildren(target.drawn(width)); // a stage that is not shown has no width
}));

// A time that several charts and the robot share.
export class Cursor {
  constructor() {
    this.at = null;
    this.listeners = [];
  }

  listen(act) {
    this.listeners.push(act);
  }

  set(at, from = null) {
    this.at = at;
    for (const act of this.listeners) act(at, from);
  }
}

// lines: [{label, x, y}] with width, dashed, colour; gaps where a value is null. Charts with one cursor show the same time.
export function chart(lines, { title, xLabel = "row", unit = "", height = 220, cursor = null } = {}) {
  if (lines.every((line) => line.y.every((y) => y === null))) return el("p", { class: "soft" }, "There is nothing to draw.");
  const place = el("div", { drawn: (width) => {
    const drawn = curves(lines, width, height, title, xLabel);
    if (cursor) follow(drawn, cursor);
    return drawn;
  } });
  place.style.minHeight = `${height}px`;
  widths.observe(place);
  if (cursor) cursor.listen((at) => place.firstChild && mark(place.firstChild, at));
  const legend = el("p", { class: "legend" }, lines.map((line, k) => el("span", {}, swatch(line.colour ?? (k % COLOURS) + 1), el("bdi", {}, line.label))));
  return el("figure", { class: "chart" }, el("figcaption", {}, unit ? `${title} [${unit}]` : title), place, lines.length > 1 ? legend : null);
}

function curves(lines, width, height, title, xLabel) {
  const edge = { left: 64, right: 12, top: 10, bottom: 34 };
  const xs = lines.flatMap((line) => line.x);
  const ys = lines.flatMap((line) => line.y).filter((y) => y !== null);
  const [x0, x1] = [Math.min(...bounds(xs)), Math.max(...bounds(xs))];
  let [y0, y1] = bounds(ys);
  if (y0 === y1) [y0, y1] = [y0 - 1, y1 + 1];
  const pad = 0.04 * (y1 - y0);
  [y0, y1] = [y0 - pad, y1 + pad];
  const px = (x) => edge.left + ((x - x0) / (x1 - x0 || 1)) * (width - edge.left - edge.right);
  const py = (y) => height - edge.bottom - ((y - y0) / (y1 - y0)) * (height - edge.top - edge.bottom);
  const drawn = svg("svg", { viewBox: `0 0 ${width} ${height}`, class: "fig", role: "img", "aria-label": `${title}: ${lines.map((l) => l.label).join(", ")}` });
  drawn.scale = { left: edge.left, right: edge.right, x0, x1, width, top: edge.top, bottom: height - edge.bottom };
  for (const at of ticks(y0, y1, height > 160 ? 6 : 4)) {
    drawn.append(svg("line", { x1: edge.left, x2: width - edge.right, y1: py(at), y2: py(at), class: "rule" }));
    drawn.append(svg("text", { x: edge.left - 8, y: py(at) + 4, "text-anchor": "end", class: "soft" }, number(at)));
  }
  for (const at of ticks(x0, x1, Math.min(6, width / 90))) {
    drawn.append(svg("text", { x: px(at), y: height - edge.bottom + 16, "text-anchor": "middle", class: "soft" }, number(at, 6)));
  }
  drawn.append(svg("text", { x: width - edge.right, y: height - 3, "text-anchor": "end", class: "soft" }, xLabel));
  lines.forEach((line, k) => {
    drawn.append(svg("path", { d: pathOf(line, px, py), fill: "none", "stroke-width": line.width ?? 1.3, "stroke-dasharray": line.dashed ? "5 3" : "none", class: `c${line.colour ?? (k % COLOURS) + 1}` }));
  });
  return drawn;
}

// The pointer over a chart sets the cursor, which is drawn as a line in all of them.
function follow(drawn, cursor) {
  const line = svg("line", { class: "cursor", "stroke-width": 1 });
  drawn.append(line);
  drawn.line = line;
  for (const event of ["pointerdown", "pointermove"]) drawn.addEventListener(event, (one) => {
    const { left, right, x0, x1, width } = drawn.scale;
    const box = drawn.getBoundingClientRect();
    const share = (((one.clientX - box.left) / box.width) * width - left) / (width - left - right);
    cursor.set(x0 + Math.min(1, Math.max(0, share)) * (x1 - x0));
  });
  mark(drawn, cursor.at);
}

function mark(drawn, at) {
  const { left, right, x0, x1, width, top, bottom } = drawn.scale;
  const shown = at !== null && at >= x0 && at <= x1;
  drawn.line.style.display = shown ? "" : "none";
  if (!shown) return;
  const x = left + ((at - x0) / (x1 - x0 || 1)) * (width - left - right);
  for (const [key, value] of [["x1", x], ["x2", x], ["y1", top], ["y2", bottom]]) drawn.line.setAttribute(key, value);
}

function swatch(colour) {
  const made = svg("svg", { viewBox: "0 0 18 6", class: "fig swatch", "aria-hidden": "true" });
  made.append(svg("line", { x1: 0, x2: 18, y1: 3, y2: 3, "stroke-width": 3, class: `c${colour}` }));
  return made;
}

function bounds(values) {
  let [low, high] = [Infinity, -Infinity];
  for (const value of values) {
    if (value < low) low = value;
    if (value > high) high = value;
  }
  return [low, high];
}

function pathOf(line, px, py) {
  let open = false;
  const parts = [];
  line.y.forEach((y, k) => {
    if (y === null) {
      open = false;
      return;
    }
    parts.push(`${open ? "L" : "M"}${px(line.x[k]).toFixed(1)} ${py(y).toFixed(1)}`);
    open = true;
  });
  return parts.join("");
}
