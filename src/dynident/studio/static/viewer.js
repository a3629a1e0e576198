// The 3D view: one canvas that moves between the stages, drawn only when something has changed.

import { el, fill } from "./dom.js";
import { LAYERS, extent, robotOf, setPositions, toolPoint } from "./bodies.js";
import { Orbit } from "./orbit.js";

let loading = null;

function threeJs() {
  loading = loading || new Promise((done, failed) => {
    const script = el("script", { src: "/static/three.js" });
    script.addEventListener("load", () => done(globalThis.THREE));
    script.addEventListener("error", async () => {
      const answer = await fetch("/static/three.js").then((one) => one.json()).catch(() => ({}));
      failed(new Error(answer.error || "three.js could not be loaded"));
    });
    document.head.append(script);
  });
  return loading;
}

class Viewer {
  constructor() {
    this.shown = Object.fromEntries(Object.keys(LAYERS).map((key) => [key, !["frames", "ellipsoids", "capsules"].includes(key)]));
    this.place = el("div", { class: "viewer" });
    this.failed = "";
    this.robot = null;
  }

  mount(place) {
    place.append(this.place);
    this.start().then(() => this.resize());
  }

  start() {
    this.ready = this.ready || this.open().catch((error) => {
      this.failed = error.message;
      fill(this.place, el("p", { class: "soft" }, `No 3D view: ${error.message}`));
    });
    return this.ready;
  }

  async open() {
    const THREE = await threeJs();
    const canvas = el("canvas", { tabIndex: 0, role: "img", "aria-label": "Robot in 3D. Arrow keys turn the view, plus and minus zoom." });
    let renderer = null;
    try {
      renderer = new THREE.WebGLRenderer({ canvas, antialias: true, alpha: true });
    } catch {
      throw new Error("this browser gives no WebGL; everything else works without it");
    }
    this.THREE = THREE;
    this.renderer = renderer;
    renderer.setPixelRatio(Math.min(globalThis.devicePixelRatio || 1, 2));
    renderer.outputEncoding = THREE.sRGBEncoding;
    this.world = new THREE.Scene();
    this.camera = new THREE.PerspectiveCamera(38, 1, 0.01, 1000);
    this.camera.up.set(0, 0, 1);
    this.world.add(new THREE.HemisphereLight(0xffffff, 0x8a9199, 0.85));
    const sun = new THREE.DirectionalLight(0xffffff, 0.7);
    sun.position.set(2, -3, 5);
    this.world.add(sun);
    fill(this.place, canvas);
    this.orbit = new Orbit(this.camera, canvas, () => this.draw());
    this.orbit.apply();
    new ResizeObserver(() => this.resize()).observe(this.place);
  }

  async load(scene, positions) {
    await this.start();
    if (this.failed || this.robot?.scene === scene) return; // who comes back finds the view as it was
    const { THREE } = this;
    if (this.robot) this.remove(this.robot.root, this.grid);
    this.robot = robotOf(THREE, scene);
    this.world.add(this.robot.root);
    setPositions(THREE, this.robot, positions);
    const around = extent(THREE, this.robot);
    const step = 10 ** Math.floor(Math.log10(Math.max(around.radius, 0.05)));
    const half = Math.ceil((around.radius * 1.6) / step);
    this.grid = new THREE.GridHelper(2 * half * step, 2 * half, 0x8a929b, 0x8a929b);
    this.grid.material.transparent = true;
    this.grid.material.opacity = 0.28;
    this.grid.rotation.x = Math.PI / 2;
    this.world.add(this.grid);
    for (const [layer, on] of Object.entries(this.shown)) this.show(layer, on);
    this.frame(around);
  }

  remove(...objects) {
    this.world.remove(...objects);
    for (const object of objects) object.traverse((one) => [one.geometry, one.material].forEach((part) => part?.dispose()));
  }

  show(layer, on) {
    this.shown[layer] = on;
    if (this.robot) for (const object of this.robot.layers[layer]) object.visible = on;
    this.draw();
  }

  set(positions) {
    if (!this.robot) return;
    setPositions(this.THREE, this.robot, positions);
    this.draw();
  }

  trace(postures) {
    if (!this.robot) return;
    const before = this.robot.positions;
    const points = postures.map((posture) => {
      setPositions(this.THREE, this.robot, posture);
      return toolPoint(this.THREE, this.robot);
    });
    this.robot.line.geometry.setFromPoints(points);
    this.set(before);
    const { center, radius } = this.around;
    const ends = [[1, 0, 0], [0, 1, 0], [0, 0, 1]].flatMap((axis) => [radius, -radius].map((size) => new this.THREE.Vector3(...axis).multiplyScalar(size).add(center)));
    const around = new this.THREE.Sphere().setFromPoints([...points, ...ends]);
    if (around.radius > 1.02 * radius) this.frame(around);
  }

  frame(around) {
    this.around = around;
    this.orbit.frame(around.center.toArray(), Math.max(around.radius, 0.05));
  }

  resize() {
    if (!this.renderer) return;
    const { clientWidth: width, clientHeight: height } = this.place;
    if (!width || !height) return;
    this.renderer.setSize(width, height, false);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.renderer.render(this.world, this.camera); // at once: a canvas of another size is empty
  }

  draw() {
    if (!this.renderer || this.waiting) return;
    this.waiting = requestAnimationFrame(() => {
      this.waiting = 0;
      this.renderer.render(this.world, this.camera);
    });
  }
}

export const viewer = new Viewer();
