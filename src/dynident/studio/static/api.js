// What the page asks its server, and what it knows: the files, the commands, the parts to choose from.

import { say } from "./dom.js";

export const known = { files: [], runs: [], folder: "", choices: null, robot: "", case: "", log: "", estimate: "", plan: "" };

const listeners = new Set();

export function listen(act) {
  listeners.add(act);
}

// What was chosen, and text that is not saved yet, survives a page that is loaded again; each tab has its own.
export const kept = {
  get: (key) => {
    try {
      return sessionStorage.getItem(key) ?? "";
    } catch {
      return ""; // a browser that keeps nothing
    }
  },
  set: (key, text) => {
    try {
      if (text) sessionStorage.setItem(key, text);
      else sessionStorage.removeItem(key);
    } catch { /* the page works without it */ }
  },
};

const CHOSEN = ["robot", "case", "log", "estimate", "plan"];
for (const key of CHOSEN) known[key] = kept.get(key);

export function choose(changes) {
  Object.assign(known, changes);
  for (const key of CHOSEN) if (key in changes) kept.set(key, changes[key]);
  for (const act of listeners) act();
}

async function answered(response) {
  const text = await response.text();
  let data = null;
  try {
    data = JSON.parse(text);
  } catch {
    throw new Error(`the server answered ${response.status}`);
  }
  if (!response.ok) throw new Error(data.error || `the server answered ${response.status}`);
  return data;
}

async function sent(place, how) {
  try {
    return await fetch(place, { credentials: "same-origin", cache: "no-store", ...how });
  } catch {
    throw new Error("the studio does not answer; is 'dynident studio' still running?");
  }
}

export async function get(place, query = {}) {
  const text = new URLSearchParams(query).toString();
  return answered(await sent(`/api/${place}${text ? `?${text}` : ""}`, {}));
}

// Fill a choice of what a kind of file is exported to, once: none is chosen before the user does.
export async function offerTargets(select, kind) {
  if (select.options.length) return;
  const { targets } = await get("targets", { kind });
  select.replaceChildren(new Option("choose a target", ""), ...targets.map((name) => new Option(name)));
  select.dispatchEvent(new Event("offered", { bubbles: true }));
}

export async function post(place, data) {
  const how = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(data) };
  return answered(await sent(`/api/${place}`, how));
}

export async function refresh() {
  choose(await get("state"));
}

export async function upload(files) {
  const kept = [];
  for (const file of files) {
    try {
      if (file.size > known.max_bytes) throw new Error(`larger than ${known.max_bytes / 1e6} MB; start 'dynident studio' with a larger --max-upload, or --work`);
      say(`uploading ${file.name}`);
      const place = `/api/upload?${new URLSearchParams({ name: file.name })}`;
      const answer = await answered(await sent(place, { method: "POST", body: file }));
      kept.push(answer.name);
    } catch (error) {
      say(`${file.name}: ${error.message}`, true);
    }
  }
  await refresh();
  if (kept.length) say(`uploaded: ${kept.join(", ")}`);
  return kept;
}

export function ofKind(...kinds) {
  return known.files.filter((file) => kinds.includes(file.kind)).map((file) => file.name);
}

export function fileAddress(file) {
  return `/file?${new URLSearchParams({ name: file })}`;
}

export function reportAddress(file) {
  return `/report?${new URLSearchParams({ name: file })}`;
}

// Shows what went wrong in place of a result; a fault of a file is no fault of the page.
export async function guarded(place, act) {
  try {
    await act();
  } catch (error) {
    if (!place) return say(error.message, true);
    place.replaceChildren();
    const told = document.createElement("p");
    told.className = "fault";
    told.setAttribute("role", "alert");
    told.textContent = error.message;
    place.append(told);
  }
}
