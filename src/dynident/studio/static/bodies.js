// A robot's data as objects of three.js: links that move, and what is shown on them in layers.

const FRAME = [0xd55e00, 0x009e73, 0x0072b2];

export const LAYERS = {
  skeleton: "links and joints",
  shapes: "meshes, else capsules",
  capsules: "capsules beside meshes",
  ellipsoids: "inertia ellipsoids",
  centres: "centres of mass",
  frames: "frames",
  path: "tool path",
};

export function robotOf(THREE, scene) {
  const root = new THREE.Group();
  const layers = Object.fromEntries(Object.keys(LAYERS).map((key) => [key, []]));
  const size = sizeOf(scene);
  const movers = [];
  const owner = (link) => (link < 0 ? root : movers[link]);
  const add = (layer, place, object) => {
    layers[layer].push(object);
    place.add(object);
  };
  const paint = (color, opacity = 1) => new THREE.MeshStandardMaterial({
    color, roughness: 0.75, metalness: 0.05, transparent: opacity < 1, opacity, depthWrite: opacity === 1,
  });
  const materials = { link: paint(0x7d8790), joint: paint(0x3d454d), capsule: paint(0x56b4e9, 0.3), mesh: paint(0xb9c2ca), body: paint(0xc98500, 0.4), vast: new THREE.MeshBasicMaterial({ color: 0xc98500, wireframe: true, transparent: true, opacity: 0.05 }), centre: paint(0xd55e00) };
  materials.mesh.side = THREE.DoubleSide; // a mirrored mesh shows its inside

  const drawShapes = (place, meshes, capsules) => {
    for (const mesh of meshes) add("shapes", place, meshOf(THREE, mesh, materials.mesh));
    for (const capsule of capsules) add(meshes.length ? "capsules" : "shapes", place, capsuleOf(THREE, capsule, materials.capsule));
  };

  for (const link of scene.links) {
    const mount = new THREE.Group();
    mount.matrixAutoUpdate = false;
    mount.matrix.copy(pose(THREE, link.rotation, link.translation));
    owner(link.parent).add(mount);
    const mover = new THREE.Group();
    mount.add(mover);
    movers.push(mover);
    add("skeleton", owner(link.parent), rod(THREE, [0, 0, 0], link.translation, 0.016 * size, materials.link));
    add("skeleton", mover, hinge(THREE, link, 0.03 * size, materials.joint));
    add("frames", mover, axes(THREE, 0.11 * size));
  }
  scene.links.forEach((link, i) => {
    drawShapes(movers[i], link.meshes, link.capsules);
    if (!link.body) return;
    if (link.body.centre) add("centres", movers[i], ball(THREE, link.body.centre, 0.018 * size, materials.centre));
    if (link.body.axes && link.body.centre) {
      // A body larger than the robot would hide it: only its net is drawn.
      const vast = Math.max(...link.body.axes) > 0.6 * size;
      const shown = ellipsoid(THREE, link.body, vast ? materials.vast : materials.body);
      shown.userData.vast = vast;
      add("ellipsoids", movers[i], shown);
    }
  });
  drawShapes(root, scene.base_meshes, scene.base_capsules);
  add("frames", root, axes(THREE, 0.18 * size));
  const tool = toolOf(scene);
  if (tool.offset.some((x) => Math.abs(x) > 1e-9)) {
    add("skeleton", owner(tool.link), rod(THREE, [0, 0, 0], tool.offset, 0.011 * size, materials.link));
  }
  const points = new THREE.BufferGeometry();
  const line = new THREE.Line(points, new THREE.LineBasicMaterial({ color: 0x009e73 }));
  line.frustumCulled = false;
  add("path", root, line);
  return { root, layers, movers, size, tool, line, scene, positions: scene.joints.map(() => 0) };
}

export function setPositions(THREE, robot, positions) {
  robot.positions = positions;
  robot.scene.links.forEach((link, i) => {
    const q = link.multiplier * positions[link.position] + link.offset;
    const axis = new THREE.Vector3(...link.axis);
    if (link.kind === "prismatic") robot.movers[i].position.copy(axis.multiplyScalar(q));
    else robot.movers[i].quaternion.setFromAxisAngle(axis, q);
  });
  robot.root.updateMatrixWorld(true);
}

export function toolPoint(THREE, robot) {
  const place = robot.tool.link < 0 ? robot.root : robot.movers[robot.tool.link];
  return place.localToWorld(new THREE.Vector3(...robot.tool.offset));
}

export function extent(THREE, robot) {
  const box = new THREE.Box3();
  box.expandByPoint(new THREE.Vector3(0, 0, 0));
  for (const mover of robot.movers) box.expandByPoint(mover.getWorldPosition(new THREE.Vector3()));
  const bodies = robot.layers.ellipsoids.filter((one) => !one.userData.vast);
  for (const object of [...robot.layers.shapes, ...bodies]) box.expandByObject(object);
  box.expandByPoint(toolPoint(THREE, robot));
  return box.getBoundingSphere(new THREE.Sphere());
}

function sizeOf(scene) {
  const length = scene.links.reduce((sum, link) => sum + Math.hypot(...link.translation), 0);
  return Math.min(Math.max(length, 0.1), 20) || 1;
}

function toolOf(scene) {
  const frame = scene.frames.find((one) => one.name === scene.tool);
  return frame ? { link: frame.link, offset: frame.translation } : { link: scene.links.length - 1, offset: [0, 0, 0] };
}

function pose(THREE, r, t) {
  return new THREE.Matrix4().set(...r[0], t[0], ...r[1], t[1], ...r[2], t[2], 0, 0, 0, 1);
}

function along(THREE, object, start, end) {
  const [a, b] = [new THREE.Vector3(...start), new THREE.Vector3(...end)];
  object.position.copy(a).lerp(b, 0.5);
  object.quaternion.setFromUnitVectors(new THREE.Vector3(0, 1, 0), b.clone().sub(a).normalize());
  return object;
}

function rod(THREE, start, end, radius, material) {
  const length = Math.hypot(...end.map((x, k) => x - start[k]));
  if (length < 1e-9) return new THREE.Group();
  return along(THREE, new THREE.Mesh(new THREE.CylinderGeometry(radius, radius, length, 20), material), start, end);
}

function hinge(THREE, link, radius, material) {
  const shape = link.kind === "prismatic"
    ? new THREE.BoxGeometry(1.6 * radius, 3 * radius, 1.6 * radius)
    : new THREE.CylinderGeometry(radius, radius, 2.6 * radius, 28);
  return along(THREE, new THREE.Mesh(shape, material), link.axis.map((x) => -x), link.axis);
}

// Triangles as 32 bit numbers in base 64, in the frame of the link.
function meshOf(THREE, text, material) {
  const data = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const geometry = new THREE.BufferGeometry();
  geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(data.buffer), 3));
  geometry.computeVertexNormals();
  return new THREE.Mesh(geometry, material);
}

function axes(THREE, length) {
  const group = new THREE.Group();
  [[1, 0, 0], [0, 1, 0], [0, 0, 1]].forEach((axis, k) => {
    const end = axis.map((x) => x * length);
    group.add(rod(THREE, [0, 0, 0], end, 0.025 * length, new THREE.MeshBasicMaterial({ color: FRAME[k] })));
  });
  return group;
}

function ball(THREE, centre, radius, material) {
  const made = new THREE.Mesh(new THREE.SphereGeometry(radius, 20, 14), material);
  made.position.set(...centre);
  return made;
}

function ellipsoid(THREE, body, material) {
  const made = new THREE.Mesh(new THREE.SphereGeometry(1, 28, 18), material);
  const scale = new THREE.Matrix4().makeScale(...body.axes.map((a) => Math.max(a, 1e-4)));
  made.matrixAutoUpdate = false;
  made.matrix.copy(pose(THREE, body.rotation, body.centre).multiply(scale));
  return made;
}

function capsuleOf(THREE, { start, end, radius }, material) {
  const length = Math.hypot(...end.map((x, k) => x - start[k]));
  if (length < 1e-9) return ball(THREE, start, Math.max(radius, 1e-4), material);
  return along(THREE, new THREE.Mesh(new THREE.CapsuleGeometry(Math.max(radius, 1e-4), length, 10, 24), material), start, end);
}
