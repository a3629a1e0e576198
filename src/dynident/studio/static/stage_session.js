// Stage 9: all files of the session, and all that was done as commands.

import { get, guarded, known, listen, post, refresh } from "./api.js";
import { bytes, el, fill, name, table } from "./dom.js";
import { commandLine } from "./runner.js";
import { download } from "./stage_results.js";
import { dropzone } from "./upload.js";

export const title = "Session";

export function build() {
  const files = el("div");
  const commands = el("div");
  const remove = (file) => el("button", { type: "button", class: "quiet", "aria-label": `remove ${file}`, on: { click: () => guarded(null, async () => {
    await post("remove", { name: file });
    await refresh();
  }) } }, "Remove");
  function show() {
    fill(files, known.files.length
      ? table(["file", "kind", { text: "size", number: true }, "download", "remove"], known.files.map((file) => [name(file.name), file.kind, bytes(file.size), download(file.name), file.own ? remove(file.name) : ""]), { label: "files of the session" })
      : el("p", { class: "soft" }, "There are no files yet."));
    if (!files.offsetParent) return; // another stage is shown
    guarded(commands, async () => {
      const { commands: done } = await get("history");
      fill(commands, done.length ? [el("p", {}, "Run in a folder with the uploaded files, these commands give the same files."), commandLine(done.join("\n"))] : el("p", { class: "soft" }, "Nothing was done yet."));
    });
  }
  listen(show);
  return {
    whole: [dropzone("any file of the session", () => {}), el("h2", {}, "Files"), files, el("h2", {}, "What was done"), commands],
    enter: show,
    leave() {},
  };
}
