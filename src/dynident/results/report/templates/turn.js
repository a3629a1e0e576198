// A robot with its bodies that can be turned by dragging, sliders or keys. Without this script three views stand still.
"use strict";
(() => {
  const SVG = "http://www.w3.org/2000/svg", WIDEST = 720, HIGHEST = 520, DEGREE = Math.PI / 180;

  const make = (parent, name, attributes, text) => {
    const element = document.createElementNS(SVG, name);
    for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
    if (text !== undefined) element.textContent = text;
    parent.append(element);
    return element;
  };

  const roundStep = (least) => {
    const power = 10 ** Math.floor(Math.log10(least));
    return power * [1, 2, 5, 10].find((m) => m * power >= least * (1 - 1e-9));
  };

  class Picture {
    constructor(box) {
      Object.assign(this, JSON.parse(box.dataset.scene));
      this.hidden = new Set();
      [this.azimuth, this.elevation] = [-58, 24];
      this.figure = document.createElement("figure");
      this.figure.className = "live-view";
      this.svg = make(this.figure, "svg", { class: "fig turnable", role: "img",
        "font-family": "system-ui, sans-serif", "font-size": 13 });
      this.svg.setAttribute("aria-label", "Mass distribution, as turned by the sliders above");
      box.prepend(this.figure);
      box.classList.add("turning");
      this.controls(box);
      this.listen();
      this.fit();
      new ResizeObserver(() => this.fit()).observe(this.figure);
    }

    // On a phone the picture is drawn smaller, not shrunk: letters keep their size.
    fit() {
      const wide = Math.min(WIDEST, this.figure.clientWidth || WIDEST);
      if (wide === this.wide) return;
      [this.wide, this.high] = [wide, Math.min(HIGHEST, wide)];
      this.zoom = (0.47 * this.high) / this.radius;
      this.svg.setAttribute("viewBox", `0 0 ${this.wide} ${this.high}`);
      this.draw();
    }

    controls(box) {
      const bar = document.createElement("div");
      bar.className = "bar still";
      bar.setAttribute("role", "group");
      bar.setAttribute("aria-label", "View of the figure below");
      this.sliders = [["azimuth", "Turn", -180, 180], ["elevation", "Raise", -90, 90]].map(([key, name, low, high]) => {
        const slider = document.createElement("input"), label = document.createElement("label");
        Object.assign(slider, { type: "range", min: low, max: high, step: 1, value: this[key] });
        slider.addEventListener("input", () => { this[key] = +slider.value; this.draw(); });
        label.append(`${name} `, slider);
        bar.append(label);
        return [key, slider];
      });
      this.kinds.forEach((name, kind) => {
        const tick = document.createElement("input"), label = document.createElement("label");
        Object.assign(tick, { type: "checkbox", checked: true });
        tick.addEventListener("change", () => { this.hidden[tick.checked ? "delete" : "add"](kind); this.draw(); });
        label.append(tick, ` ${name}`);
        label.className = `kind-${kind}`;
        bar.append(label);
      });
      box.before(bar);
    }

    listen() {
      let last = null;
      this.svg.addEventListener("pointerdown", (event) => {
        if (event.button !== 0) return;
        event.preventDefault();
        last = [event.clientX, event.clientY];
        this.svg.setPointerCapture(event.pointerId);
      });
      this.svg.addEventListener("pointermove", (event) => {
        if (!last) return;
        const [x, y] = last;
        this.azimuth = ((this.azimuth - 0.5 * (event.clientX - x) + 540) % 360) - 180;
        this.elevation = Math.max(-90, Math.min(90, this.elevation + 0.5 * (event.clientY - y)));
        last = [event.clientX, event.clientY];
        for (const [key, slider] of this.sliders) slider.value = this[key];
        this.draw();
      });
      for (const name of ["pointerup", "pointercancel"]) this.svg.addEventListener(name, () => { last = null; });
    }

    draw() {
      const [a, e] = [this.azimuth * DEGREE, this.elevation * DEGREE];
      const right = [-Math.sin(a), Math.cos(a), 0];
      const up = [-Math.cos(a) * Math.sin(e), -Math.sin(a) * Math.sin(e), Math.cos(e)];
      const eye = [Math.cos(a) * Math.cos(e), Math.sin(a) * Math.cos(e), Math.sin(e)];
      const dot = (p, q) => p[0] * q[0] + p[1] * q[1] + p[2] * q[2];
      const at = (point) => {
        const from = point.map((value, k) => value - this.middle[k]);
        return [this.wide / 2 + this.zoom * dot(right, from), this.high / 2 - this.zoom * dot(up, from)];
      };
      this.svg.replaceChildren();
      make(this.svg, "desc", {}, `Eye at ${Math.round(this.azimuth)} degrees about the vertical, ${Math.round(this.elevation)} above it.`);
      for (const [start, end, radius] of this.capsules) {
        const [p, q] = [at(start), at(end)], d = `M${p[0]} ${p[1]}L${q[0]} ${q[1]}`;
        make(this.svg, "path", { class: "c0", d, "stroke-width": 2 * this.zoom * radius, "stroke-opacity": 0.1, "stroke-linecap": "round" });
      }
      for (const [start, end] of this.bones) {
        const [[x1, y1], [x2, y2]] = [at(start), at(end)];
        make(this.svg, "line", { class: "c0", "stroke-width": 8, "stroke-opacity": 0.28, "stroke-linecap": "round", x1, y1, x2, y2 });
      }
      for (const [start] of this.bones) {
        const [cx, cy] = at(start);
        make(this.svg, "circle", { class: "d0", r: 3.5, cx, cy });
      }
      const seen = this.bodies.filter(({ kind }) => !this.hidden.has(kind));
      seen.sort((p, q) => dot(eye, p.centre) - dot(eye, q.centre));
      for (const body of seen) this.ellipsoid(body, at(body.centre), right, up, dot);
      this.axes(at);
      const names = this.hidden.has(0) ? 1 : 0, taken = [];
      for (const body of seen.filter(({ kind }) => kind === names)) this.name(body.name, at(body.centre), taken);
      this.ruler();
    }

    // The outline of a projected ellipsoid: half axes and direction are those of its projected 2 x 2 matrix.
    ellipsoid({ spread, kind, vast }, [x, y], right, up, dot) {
      const through = (p, q) => this.zoom ** 2 * dot(p, spread.map((row) => dot(row, q)));
      const [xx, xy, yy] = [through(right, right), -through(right, up), through(up, up)];
      const mean = (xx + yy) / 2, away = Math.hypot((xx - yy) / 2, xy), turn = Math.atan2(2 * xy, xx - yy) / 2;
      const shape = { cx: x, cy: y, rx: Math.sqrt(Math.max(0, mean + away)), ry: Math.sqrt(Math.max(0, mean - away)),
        transform: `rotate(${turn / DEGREE} ${x} ${y})` };
      if (kind === 0 && !vast) make(this.svg, "ellipse", { class: "d1", "fill-opacity": 0.14, ...shape });
      const line = kind ? { "stroke-dasharray": "5 3" } : {};
      make(this.svg, "ellipse", { class: `c${kind + 1}`, fill: "none", "stroke-width": 1.5, ...line, ...shape });
      make(this.svg, "circle", { class: `d${kind + 1}`, r: 4, cx: x, cy: y });
    }

    axes(at) {
      const length = roundStep(50 / this.zoom), [x1, y1] = at([0, 0, 0]);
      [[length, 0, 0], [0, length, 0], [0, 0, length]].forEach((end, k) => {
        const [x2, y2] = at(end);
        if (Math.hypot(x2 - x1, y2 - y1) < 8) return;
        make(this.svg, "line", { class: "axis", x1, y1, x2, y2 });
        make(this.svg, "text", { class: "soft", x: x2 + 4, y: y2 + 4 }, "xyz"[k]);
      });
    }

    name(text, [x, y], taken) {
      const wide = 8 * text.length;
      for (const [left, base] of [[x + 9, y + 4], [x - 9 - wide, y + 4], [x - wide / 2, y - 10], [x - wide / 2, y + 20]]) {
        if (left < 0 || left + wide > this.wide) continue;
        if (taken.some(([a, b, c]) => left < b && a < left + wide && Math.abs(base - c) < 15)) continue;
        taken.push([left, left + wide, base]);
        const style = { class: "ink halo", "stroke-width": 3.5, "paint-order": "stroke" };
        return make(this.svg, "text", { ...style, x: left, y: base }, text);
      }
    }

    ruler() {
      const length = roundStep(60 / this.zoom), x = this.wide - 14, y = this.high - 12;
      make(this.svg, "line", { class: "axis", x1: x - this.zoom * length, y1: y, x2: x, y2: y });
      const place = { class: "soft", x: x - this.zoom * length - 6, y: y + 4, "text-anchor": "end" };
      make(this.svg, "text", place, `${+length.toPrecision(3)} m`);
    }
  }

  for (const box of document.querySelectorAll("[data-scene]")) new Picture(box);
})();
