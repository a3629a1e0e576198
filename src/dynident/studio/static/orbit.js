// Looking around with mouse, touch and keys: drag turns, shift or right drag moves, the wheel or two fingers zoom.

export class Orbit {
  constructor(camera, place, changed) {
    Object.assign(this, { camera, place, changed, target: [0, 0, 0.5], radius: 3, azimuth: 0.7, polar: 1.15 });
    this.pointers = new Map();
    place.addEventListener("pointerdown", (event) => this.down(event));
    place.addEventListener("pointermove", (event) => this.move(event));
    for (const end of ["pointerup", "pointercancel"]) place.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    place.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.zoom(Math.exp(event.deltaY * 0.001));
    }, { passive: false });
    place.addEventListener("contextmenu", (event) => event.preventDefault());
    place.addEventListener("keydown", (event) => this.key(event));
  }

  down(event) {
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    this.place.setPointerCapture(event.pointerId);
  }

  move(event) {
    const last = this.pointers.get(event.pointerId);
    if (!last) return;
    const [dx, dy] = [event.clientX - last[0], event.clientY - last[1]];
    if (this.pointers.size === 2) {
      const [other] = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, at]) => at);
      const before = Math.hypot(last[0] - other[0], last[1] - other[1]);
      const after = Math.hypot(event.clientX - other[0], event.clientY - other[1]);
      this.zoom(before / Math.max(after, 1));
    } else if (event.shiftKey || event.buttons === 2) this.pan(dx, dy);
    else this.turn(-dx * 0.008, -dy * 0.008);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
  }

  key(event) {
    const turns = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, -0.1], ArrowDown: [0, 0.1] };
    if (turns[event.key]) this.turn(...turns[event.key]);
    else if (event.key === "+" || event.key === "=") this.zoom(0.9);
    else if (event.key === "-") this.zoom(1.1);
    else return;
    event.preventDefault();
  }

  turn(azimuth, polar) {
    this.azimuth += azimuth;
    this.polar = Math.min(Math.PI - 0.02, Math.max(0.02, this.polar + polar));
    this.apply();
  }

  zoom(factor) {
    this.radius = Math.min(500, Math.max(0.02, this.radius * factor));
    this.apply();
  }

  pan(dx, dy) {
    const step = this.radius / Math.max(this.place.clientHeight, 1);
    const [s, c] = [Math.sin(this.azimuth), Math.cos(this.azimuth)];
    this.target[0] += step * (dx * s + dy * c * Math.cos(this.polar));
    this.target[1] += step * (-dx * c + dy * s * Math.cos(this.polar));
    this.target[2] += step * dy * Math.sin(this.polar);
    this.apply();
  }

  frame(centre, radius) {
    this.target = [...centre];
    this.radius = radius * 3.8;
    this.apply();
  }

  apply() {
    const [x, y, z] = this.target;
    const flat = this.radius * Math.sin(this.polar);
    this.camera.position.set(x + flat * Math.cos(this.azimuth), y + flat * Math.sin(this.azimuth), z + this.radius * Math.cos(this.polar));
    this.camera.lookAt(x, y, z);
    this.changed();
  }
}
