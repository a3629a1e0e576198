// Stage 1: the robot, as its robot model states it.

import { choose, guarded, known, ofKind } from "./api.js";
import { el, field, fill, name, next, number, options, table } from "./dom.js";
import { Stage3D } from "./playback.js";
import { commandLine } from "./runner.js";
import { dropzone } from "./upload.js";

export const title = "Robot";

export function robots() {
  const own = [...ofKind("robot"), ...ofKind("case"), ...ofKind("estimate")];
  return [...own, ...known.choices.robots.map((one) => ({ value: one, text: `${one} (ships with dynident)` }))];
}

export function build() {
  const choice = el("select", { id: "robot-choice", "data-shared": "", on: { change: () => open(choice.value) } });
  const facts = el("div");
  const fault = el("div");
  const view = new Stage3D({
    motions: () => [...ofKind("plan"), ...ofKind("log")],
    caseOf: () => (known.files.find((file) => file.name === known.robot)?.kind === "estimate" ? known.case : known.robot),
  });

  async function open(robot) {
    if (!robot) return;
    choose({ robot });
    fill(fault);
    await guarded(fault, async () => {
      const scene = await view.load(robot);
      if (scene) tell(facts, scene, robot);
    });
  }

  async function taken(files) {
    const kindOf = (file) => known.files.find((one) => one.name === file)?.kind;
    const mine = files.filter((file) => ["robot", "case", "estimate"].includes(kindOf(file)));
    if (!mine.length) {
      if (files.some((file) => kindOf(file) === "mesh")) return open(choice.value); // those that were missing are drawn
      fill(fault, el("p", { class: "fault", role: "alert" }, "none of these files describes a robot: a URDF, a DH table or a case file does"));
      return;
    }
    options(choice, robots(), mine[0]);
    await open(mine[0]);
  }

  return {
    whole: [
      el("p", { class: "lead" }, "Drop the model file of your robot (URDF, MJCF, DH table), or take a built-in example robot. Drag the picture to look around."),
      dropzone("URDF, DH table in YAML, meshes, case files", taken),
      field("Robot", choice), fault, view.whole, facts,
    ],
    enter() {
      options(choice, robots(), known.robot || choice.value);
      view.enter();
      if (!view.scene || view.scene.source !== choice.value) open(choice.value);
    },
    leave: () => view.leave(),
  };
}

function tell(place, scene, robot) {
  const joints = scene.joints.map((joint) => {
    const per = joint.kind === "revolute" ? "rad" : "m";
    return [name(joint.name), joint.kind, number(joint.lower), number(joint.upper), per, number(joint.velocity), number(joint.effort), joint.unit.replace(" ", "·")];
  });
  const links = scene.links.map((link) => {
    const { body } = link;
    const centre = body?.centre ? body.centre.map((x) => number(Number(x.toFixed(9)))) : ["–", "–", "–"];
    return [name(link.name), body ? number(body.mass) : "–", ...centre, body ? (body.defect ? `no: ${body.defect}` : "yes") : "not stated"];
  });
  fill(place,
    el("h2", {}, name(scene.robot)),
    scene.note ? el("p", { class: "soft" }, scene.note) : null,
    scene.notes.map((note) => el("p", { class: "remark" }, note)),
    el("h3", {}, "Joints"),
    table(["joint", "kind", num("from"), num("to"), "unit", num("speed"), num("effort"), "unit"], joints, { label: "joints", note: "– stands for a limit that is not stated." }),
    el("h3", {}, "Links"),
    table(["link", num("mass [kg]"), num("centre x [m]"), num("y"), num("z"), "physically consistent"], links, { label: "links" }),
    el("h3", {}, "The same as a command"), commandLine(`dynident inspect ${robot}`), next("log", "Add logs"));
}

function num(text) {
  return { text, number: true };
}
