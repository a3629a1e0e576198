// Charts over time that can be zoomed; those of one group share their window. Without this script they stand as drawn.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg", MISSING = 65535, CLOSEST = 1 / 400, SHADE = 0.06;

  const unpack = (text) => {
    const bytes = atob(text), found = new Float64Array(bytes.length / 2);
    for (let i = 0; i < found.length; i++) {
      const number = bytes.charCodeAt(2 * i) | (bytes.charCodeAt(2 * i + 1) << 8);
      found[i] = number === MISSING ? NaN : number / (MISSING - 1);
    }
    return found;
  };

  const roundStep = (least) => {
    const power = 10 ** Math.floor(Math.log10(least));
    return power * [1, 2, 2.5, 5, 10].find((m) => m * power >= least * (1 - 1e-9));
  };

  const written = (value, step) => {
    if (Math.abs(value) < step * 1e-6) return "0";
    let decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
    if (Math.abs(step * 10 ** decimals - Math.round(step * 10 ** decimals)) > 1e-6) decimals += 1;
    return Math.abs(value) >= 1e6 ? value.toExponential(2) : value.toFixed(decimals);
  };

  const make = (parent, name, attributes, text) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    parent.append(element);
    return element;
  };

  class Chart {
    constructor(svg) {
      const data = JSON.parse(svg.dataset.zoom);
      this.svg = svg;
      this.live = svg.querySelector(".live");
      this.whole = [...this.live.childNodes];
      this.left = data.left;
      this.right = data.right;
      this.pieces = data.pieces;
      this.cuts = new Set(data.cuts);
      this.x = unpack(data.x);
      this.parts = data.parts;
      this.plots = data.plots;
      for (const plot of this.plots)
        for (const mark of plot.marks) {
          mark.rows = mark.v.map((text) => unpack(text).map((share) => mark.low + mark.span * share));
          if (mark.e) mark.rows.unshift(mark.rows[0].map((value) => -value));
        }
    }

    // The window runs from a to b, shares of the axis.
    draw(a, b) {
      if (a <= 0 && b >= 1) return this.live.replaceChildren(...this.whole);
      const fresh = document.createElementNS(SVG, "g");
      let first = this.x.findIndex((place) => place >= a), last = this.x.findLastIndex((place) => place <= b);
      first = Math.max(0, first < 0 ? this.x.length - 1 : first - 1);
      last = Math.min(this.x.length - 1, last + 1);
      const across = (share) => this.left + ((share - a) / (b - a)) * (this.right - this.left);
      this.drawParts(fresh, across);
      for (const plot of this.plots) this.drawPlot(fresh, plot, first, last, across);
      this.drawTicks(fresh, across);
      this.live.replaceChildren(...fresh.childNodes);
    }

    // Stretches that are to be told apart are shaded; a name stands where there is room for it.
    drawParts(group, across) {
      for (const { from, to, number } of this.seen(across)) {
        const [name, shaded] = this.parts[number] || ["", 0], wide = (to - from).toFixed(1);
        for (const { top, height } of shaded ? this.plots : [])
          make(group, "path", { class: "d0", "fill-opacity": SHADE, d: `M${from.toFixed(1)} ${top}h${wide}v${height}h-${wide}z` });
        const place = { class: "soft", x: ((from + to) / 2).toFixed(1), y: this.plots[0].top - 4, "text-anchor": "middle" };
        if (name && 7.3 * name.length < to - from) make(group, "text", place, name);
      }
    }

    drawPlot(group, plot, first, last, across) {
      let low = Infinity, high = -Infinity;
      for (const mark of plot.marks)
        for (const row of mark.rows)
          for (let i = first; i <= last; i++) {
            if (row[i] < low) low = row[i];
            if (row[i] > high) high = row[i];
          }
      if (!(low < high)) [low, high] = Number.isFinite(low) ? [low - 0.5, low + 0.5] : [0, 1];
      const step = roundStep((high - low) / Math.max(plot.height / 32, 1));
      low = Math.floor(low / step + 1e-6) * step;
      high = Math.ceil(high / step - 1e-6) * step;
      const up = (value) => plot.top + plot.height * (1 - (value - low) / (high - low));
      for (let k = Math.round(low / step); k <= Math.round(high / step); k++) {
        const y = up(k * step).toFixed(1);
        make(group, "line", { class: k ? "rule" : "axis", x1: this.left, x2: this.right, y1: y, y2: y });
        const place = { class: "soft", x: this.left - 7, y: +y + 4.5, "text-anchor": "end" };
        make(group, "text", place, written(k * step, step));
      }
      for (const mark of plot.marks) {
        const band = mark.rows.length === 2;
        const d = band ? this.area(mark.rows, first, last, across, up) : this.line(mark.rows[0], first, last, across, up);
        const style = band
          ? { class: `d${mark.c}`, "fill-opacity": mark.o }
          : { class: `c${mark.c}`, fill: "none", "stroke-width": mark.w, "stroke-linejoin": "round" };
        if (mark.d) style["stroke-dasharray"] = "5 3";
        if (d) make(group, "path", { d, ...style });
      }
    }

    // Where many points share half a unit, only the lowest and the highest of them are drawn.
    line(row, first, last, across, up) {
      const parts = [];
      let open = false, bin = NaN, low = 0, high = 0, at = 0;
      const flush = () => {
        if (Number.isNaN(bin)) return;
        parts.push(`${open ? "L" : "M"}${at} ${low.toFixed(1)}`);
        if (high !== low) parts.push(`L${at} ${high.toFixed(1)}`);
        open = true;
        bin = NaN;
      };
      for (let i = first; i <= last; i++) {
        if (this.cuts.has(i)) { flush(); open = false; }
        if (Number.isNaN(row[i])) { flush(); open = false; continue; }
        const [x, y] = this.inside(row, i, across, up), place = Math.floor(2 * x);
        if (place !== bin) { flush(); bin = place; at = x.toFixed(1); low = high = y; }
        else { low = Math.min(low, y); high = Math.max(high, y); }
      }
      flush();
      return parts.join("");
    }

    area(rows, first, last, across, up) {
      let there = "", back = "", last_x = NaN, done = "";
      for (let i = first; i <= last; i++) {
        if (this.cuts.has(i) && there) [done, there, back, last_x] = [`${done}${there}${back}z`, "", "", NaN];
        const [x, y] = this.inside(rows[1], i, across, up);
        if (Number.isNaN(y) || (i < last && Math.abs(x - last_x) < 0.5)) continue;
        there += `${there ? "L" : "M"}${x.toFixed(1)} ${y.toFixed(1)}`;
        back = `L${x.toFixed(1)} ${this.inside(rows[0], i, across, up)[1].toFixed(1)}${back}`;
        last_x = x;
      }
      return there ? `${done}${there}${back}z` : done;
    }

    // A point just outside the window is moved along its line to the edge.
    inside(row, i, across, up) {
      const x = across(this.x[i]), y = up(row[i]);
      const edge = Math.min(this.right, Math.max(this.left, x));
      if (x === edge) return [x, y];
      const k = x < edge ? i + 1 : i - 1, near = across(this.x[k]);
      if (near === x || Number.isNaN(row[k]) || this.cuts.has(Math.max(i, k))) return [edge, y];
      return [edge, y + ((edge - x) / (near - x)) * (up(row[k]) - y)];
    }

    // Stretches of the axis that are to be seen: ends in the drawing and their times.
    seen(across) {
      const share = (place) => (place - this.left) / (this.right - this.left), found = [];
      for (const [number, [x0, x1, t0, t1]] of this.pieces.entries()) {
        const start = across(share(x0)), end = across(share(x1));
        const from = Math.max(start, this.left), to = Math.min(end, this.right);
        const time = (x) => t0 + ((x - start) / (end - start)) * (t1 - t0);
        if (to > from) found.push({ from, to, number, t0: time(from), t1: time(to) });
      }
      return found;
    }

    drawTicks(group, across) {
      const last = this.plots[this.plots.length - 1], bottom = last.top + last.height;
      let free = -Infinity;
      for (const { from, to, t0, t1 } of this.seen(across)) {
        make(group, "line", { class: "axis", x1: from.toFixed(1), x2: to.toFixed(1), y1: bottom, y2: bottom });
        const step = roundStep(((t1 - t0) * 64) / (to - from));
        for (let k = Math.ceil(t0 / step - 1e-6); k * step <= t1 + 1e-6 * step; k++) {
          const x = from + ((k * step - t0) / (t1 - t0)) * (to - from), text = written(k * step, step);
          make(group, "line", { class: "axis", x1: x.toFixed(1), x2: x.toFixed(1), y1: bottom, y2: bottom + 4 });
          if (x - 4 * text.length - 3 < free) continue;
          free = x + 4 * text.length + 3;
          make(group, "text", { class: "soft", x: x.toFixed(1), y: bottom + 17, "text-anchor": "middle" }, text);
        }
      }
    }
  }

  class Group {
    constructor(box) {
      this.charts = [...box.querySelectorAll("svg[data-zoom]")].map((svg) => new Chart(svg));
      [this.a, this.b] = [0, 1];
      this.bar = document.createElement("div");
      this.bar.className = "bar";
      this.bar.setAttribute("role", "group");
      this.bar.setAttribute("aria-label", "Time window of the figures below");
      const acts = [
        ["−", "Zoom out", () => this.scale(2)], ["+", "Zoom in", () => this.scale(0.5)],
        ["◀", "Earlier", () => this.shift(-0.25)], ["▶", "Later", () => this.shift(0.25)],
        ["All", "The whole time", () => this.show(0, 1)],
      ];
      for (const [text, name, act] of acts) {
        const button = document.createElement("button");
        button.type = "button";
        button.textContent = text;
        button.title = name;
        button.setAttribute("aria-label", name);
        button.addEventListener("click", act);
        this.bar.append(button);
      }
      this.said = document.createElement("output");
      const hint = document.createElement("span");
      hint.className = "hint";
      hint.textContent = "Drag over a stretch of a figure to see it in all; double-click for the whole.";
      this.bar.append(this.said, hint);
      box.before(this.bar);
      this.bar.addEventListener("keydown", (event) => this.key(event));
      for (const chart of this.charts) this.listen(chart);
      this.tell();
    }

    key(event) {
      const acts = {
        "+": () => this.scale(0.5), "=": () => this.scale(0.5), "-": () => this.scale(2), Home: () => this.show(0, 1),
        ArrowLeft: () => this.shift(-0.25), ArrowRight: () => this.shift(0.25), Escape: () => this.show(0, 1),
      };
      if (!acts[event.key] || event.ctrlKey || event.metaKey || event.altKey) return;
      event.preventDefault();
      acts[event.key]();
    }

    // A stretch that is dragged over fills the window; a double click shows all again.
    listen(chart) {
      const svg = chart.svg;
      svg.classList.add("zoomable");
      let start = null, box = null;
      const share = (event) => {
        const point = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
        const across = (point.x - chart.left) / (chart.right - chart.left);
        return this.a + Math.min(1, Math.max(0, across)) * (this.b - this.a);
      };
      const place = (at) => chart.left + ((at - this.a) / (this.b - this.a)) * (chart.right - chart.left);
      svg.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        start = share(event);
        const last = chart.plots[chart.plots.length - 1], top = chart.plots[0].top;
        box = make(svg, "rect", { class: "d0", "fill-opacity": 0.12, y: top, height: last.top + last.height - top });
        svg.setPointerCapture(event.pointerId);
      });
      svg.addEventListener("pointermove", (event) => {
        if (start === null) return;
        const [x0, x1] = [place(start), place(share(event))].sort((p, q) => p - q);
        box.setAttribute("x", x0);
        box.setAttribute("width", x1 - x0);
      });
      const end = (event, keep) => {
        if (start === null) return;
        const [from, to] = [start, share(event)].sort((p, q) => p - q);
        box.remove();
        start = null;
        if (keep && place(to) - place(from) > 4) this.show(from, to);
      };
      svg.addEventListener("pointerup", (event) => end(event, true));
      svg.addEventListener("pointercancel", (event) => end(event, false));
      svg.addEventListener("dblclick", () => this.show(0, 1));
    }

    scale(factor) {
      const half = (factor * (this.b - this.a)) / 2, middle = (this.a + this.b) / 2;
      this.show(middle - half, middle + half);
    }

    shift(share) {
      const by = share * (this.b - this.a);
      this.show(this.a + by, this.b + by);
    }

    // All stays within the axis: a window that would leave it is moved, then cut.
    show(a, b) {
      const wide = Math.min(1, Math.max(CLOSEST, b - a)), middle = (a + b) / 2;
      this.a = Math.min(1 - wide, Math.max(0, middle - wide / 2));
      this.b = this.a + wide;
      if (wide > 1 - 1e-9) [this.a, this.b] = [0, 1];
      for (const chart of this.charts) chart.draw(this.a, this.b);
      this.tell();
    }

    tell() {
      const chart = this.charts[0], wide = chart.right - chart.left;
      const seen = chart.seen((share) => chart.left + ((share - this.a) / (this.b - this.a)) * wide);
      const spans = seen.map(({ t0, t1 }) => [t0, t1].map((t) => written(t, roundStep((t1 - t0) / 100))).join(" to "));
      this.said.textContent = spans.length > 2 ? `${spans.length} logs` : `${spans.join(" and ")} s`;
    }
  }

  for (const box of document.querySelectorAll(".figures.linked")) new Group(box);
})();
