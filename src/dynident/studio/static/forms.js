// What was entered in a form survives a page that is loaded again: each control by its label.

import { kept } from "./api.js";

// Keeps the controls that a place has now under a name; the answer fills those in that can take what was kept.
// Left out: the controls of a 3D view, and choices that all stages share, which `known` keeps.
export function keepForm(place, name) {
  const controls = new Map();
  for (const one of place.querySelectorAll("input:not([type=file]), select, textarea, fieldset.several")) {
    if (one.closest(".stage3d, .ticks, [data-shared]")) continue;
    const label = one.getAttribute("aria-label") ?? (one.querySelector("legend") ?? place.querySelector(`label[for="${one.id}"]`))?.textContent;
    if (label) controls.set(label, one);
  }
  const entered = JSON.parse(kept.get(name) || "{}");
  const waiting = new Set(Object.keys(entered)); // a list that is not offered yet
  const changed = (event) => {
    for (const [label, one] of controls) {
      if (!one.contains(event.target)) continue;
      entered[label] = one.picked ? one.picked() : one.type === "checkbox" ? one.checked : one.value;
      waiting.delete(label);
      kept.set(name, JSON.stringify(entered));
    }
  };
  for (const event of ["input", "change"]) place.addEventListener(event, changed, true);
  const restore = () => {
    for (const label of [...waiting]) {
      const one = controls.get(label);
      if (!one || !offers(one, entered[label])) continue;
      waiting.delete(label);
      if (one.picked) one.choose(entered[label]);
      else if (one.type === "checkbox") one.checked = entered[label];
      else if (one.value !== entered[label]) {
        one.value = entered[label];
        one.dispatchEvent(new Event("change"));
      }
    }
  };
  place.addEventListener("offered", restore);
  return restore;
}

// Whether a list has what was chosen in it; of several names, one of them.
function offers(control, chosen) {
  if (control.picked) return !chosen.length || chosen.some((name) => [...control.querySelectorAll("input")].some((box) => box.value === name));
  return !control.options || [...control.options].some((option) => option.value === chosen);
}
