// Sliders of the joints, layers of the picture, and a motion that is played: what stands beside every 3D view.

import { get, guarded } from "./api.js";
import { el, field, fill, name, number, options, tick } from "./dom.js";
import { LAYERS } from "./bodies.js";
import { viewer } from "./viewer.js";

const SPEEDS = ["0.25", "0.5", "1", "2", "4"];

export class Stage3D {
  // With a cursor, the view plays what `follow` gives it, and nothing is chosen.
  constructor({ motions = () => [], caseOf = () => "", label = "Motion to play", cursor = null }) {
    this.cursor = cursor;
    cursor?.listen((at, from) => {
      if (from === this || !this.motion) return;
      this.stop();
      this.seek(at / this.last);
    });
    this.motions = motions;
    this.caseOf = caseOf;
    this.scene = null;
    this.motion = null;
    this.sliders = el("div", { class: "sliders" });
    this.place = el("div", { class: "view" });
    this.layers = el("fieldset", { class: "layers" }, el("legend", {}, "Show"), Object.entries(LAYERS).map(([key, text]) => tick(text, viewer.shown[key], (on) => viewer.show(key, on))));
    this.choice = el("select", { on: { change: () => this.open() } });
    this.speed = options(el("select"), SPEEDS.map((value) => ({ value, text: `${value}×` })), "1");
    this.play = el("button", { type: "button", disabled: true, on: { click: () => this.toggle() } }, "Play");
    this.at = el("input", { type: "range", min: 0, max: 1000, step: 1, value: 0, disabled: true, on: { input: () => this.seek(this.at.value / 1000) } });
    this.clock = el("output", { class: "soft" });
    this.fault = el("div");
    this.side = el("div", { class: "side" }, cursor ? el("details", {}, el("summary", {}, "Layers"), this.layers) : [this.layers, this.sliders],
      cursor ? null : field(label, this.choice), el("div", { class: "player" }, this.play, field("Speed", this.speed)), field("Time", this.at), this.clock, this.fault);
    this.whole = el("div", { class: "stage3d" }, this.place, this.side);
  }

  enter() {
    viewer.mount(this.place);
    this.layers.querySelectorAll("input").forEach((box, k) => { box.checked = viewer.shown[Object.keys(LAYERS)[k]]; });
    options(this.choice, [{ value: "", text: "none" }, ...this.motions()]);
    if (this.scene) viewer.load(this.scene, this.positions).then(() => this.restore());
  }

  leave() {
    this.stop();
  }

  async load(robot) {
    this.stop();
    this.motion = null;
    this.wanted = robot;
    const scene = await get("robot", { name: robot });
    if (this.wanted !== robot) return null; // another one was chosen meanwhile
    this.scene = scene;
    this.positions = scene.joints.map((joint) => start(joint));
    this.build();
    await viewer.load(scene, this.positions);
    this.restore();
    return scene;
  }

  restore() {
    viewer.set(this.positions);
    if (this.motion) viewer.trace(this.postures(800));
  }

  build() {
    this.inputs = this.scene.joints.map((joint, k) => {
      const [low, high] = range(joint);
      const input = el("input", { type: "range", min: low, max: high, step: (high - low) / 1000, value: this.positions[k] });
      const told = el("output", { class: "soft" });
      input.told = told;
      input.addEventListener("input", () => {
        this.stop();
        this.positions[k] = Number(input.value);
        this.tell(k);
        viewer.set(this.positions);
      });
      const whole = field("", input);
      fill(whole.querySelector("label"), name(joint.name));
      whole.append(told);
      return { input, told, whole };
    });
    fill(this.sliders, this.inputs.map((one) => one.whole));
    this.scene.joints.forEach((_, k) => this.tell(k));
  }

  tell(k) {
    const joint = this.scene.joints[k];
    const turns = joint.kind === "revolute";
    const value = turns ? (this.positions[k] * 180) / Math.PI : this.positions[k];
    fill(this.inputs[k].told, `${value.toFixed(turns ? 1 : 3).replace("-", "−")}${turns ? "°" : " m"}`);
  }

  async open(file) {
    if (file !== undefined) {
      options(this.choice, [{ value: "", text: "none" }, ...this.motions()], file);
    }
    this.stop();
    this.motion = null;
    fill(this.fault);
    const chosen = this.choice.value;
    for (const control of [this.play, this.at]) control.disabled = !chosen;
    if (!chosen || !this.scene) return viewer.trace([]);
    await guarded(this.fault, async () => {
      this.follow(await get("motion", { name: chosen, case: this.caseOf() }));
    });
  }

  // Plays a motion that is at hand: names of joints, time in s, positions.
  follow(motion) {
    this.stop();
    this.motion = motion;
    this.map = this.scene.joints.map((joint) => motion.joints.indexOf(joint.name));
    for (const control of [this.play, this.at]) control.disabled = false;
    viewer.trace(this.postures(800));
    this.seek(0);
  }

  get last() {
    return this.motion.time[this.motion.time.length - 1] || 1;
  }

  postures(count) {
    return Array.from({ length: count }, (_, k) => this.posture((this.last * k) / (count - 1)));
  }

  posture(seconds) {
    const { time, q, still } = this.motion;
    let [low, high] = [0, time.length - 1];
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (time[middle] <= seconds) low = middle;
      else high = middle;
    }
    const share = time[high] > time[low] ? Math.min(1, Math.max(0, (seconds - time[low]) / (time[high] - time[low]))) : 0;
    return this.scene.joints.map((joint, k) => {
      const column = this.map[k];
      if (column < 0) return still[joint.name] ?? this.positions[k];
      return q[low][column] + share * (q[high][column] - q[low][column]);
    });
  }

  seek(share) {
    if (!this.motion) return;
    const { last } = this;
    this.seconds = share * last;
    this.at.value = 1000 * share;
    this.positions = this.posture(this.seconds);
    this.inputs.forEach(({ input }, k) => {
      input.value = this.positions[k];
      this.tell(k);
    });
    fill(this.clock, `${number(this.seconds, 4)} of ${number(last, 4)} s`);
    viewer.set(this.positions);
    this.cursor?.set(this.seconds, this);
  }

  toggle() {
    if (this.running) return this.stop();
    if (!this.motion) return;
    const { last } = this;
    if (this.seconds >= last) this.seconds = 0;
    fill(this.play, "Pause");
    let before = performance.now();
    const step = (now) => {
      this.seconds = Math.min(last, this.seconds + ((now - before) / 1000) * Number(this.speed.value));
      before = now;
      this.seek(this.seconds / last);
      if (this.seconds >= last) return this.stop();
      this.running = requestAnimationFrame(step);
    };
    this.running = requestAnimationFrame(step);
  }

  stop() {
    if (this.running) cancelAnimationFrame(this.running);
    this.running = 0;
    fill(this.play, "Play");
  }
}

function range(joint) {
  const free = joint.kind === "revolute" ? Math.PI : 1;
  return [joint.lower ?? -free, joint.upper ?? free];
}

function start(joint) {
  const [low, high] = range(joint);
  return Math.min(high, Math.max(low, 0));
}
