// A place to drop files on, which is a button as well.

import { upload } from "./api.js";
import { el } from "./dom.js";

export function dropzone(text, done) {
  const input = el("input", { type: "file", multiple: true, class: "hidden", tabIndex: -1, "aria-hidden": "true" });
  const button = el("button", { type: "button", class: "drop", on: { click: () => input.click() } },
    el("strong", {}, "Drop files here"), el("span", {}, `or choose them: ${text}`));
  const take = async (files) => {
    const kept = await upload([...files]);
    if (kept.length) await done(kept);
  };
  input.addEventListener("change", async () => {
    await take(input.files);
    input.value = "";
  });
  for (const event of ["dragenter", "dragover"]) button.addEventListener(event, (e) => {
    e.preventDefault();
    button.classList.add("over");
  });
  button.addEventListener("dragleave", () => button.classList.remove("over"));
  button.addEventListener("drop", (event) => {
    event.preventDefault();
    button.classList.remove("over");
    take(event.dataTransfer.files);
  });
  return el("div", { class: "upload" }, button, input);
}
