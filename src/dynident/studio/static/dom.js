// Elements of the page. Text of files only ever becomes a text node: there is no innerHTML anywhere in the studio.

export function el(tag, properties = {}, ...children) {
  const made = document.createElement(tag);
  for (const [key, value] of Object.entries(properties)) {
    if (key === "on") for (const [event, act] of Object.entries(value)) made.addEventListener(event, act);
    else if (key === "class") made.className = value;
    else if (key.includes("-") || key === "for" || key === "role" || key === "list") made.setAttribute(key, value);
    else made[key] = value;
  }
  put(made, ...children);
  return made;
}

export function put(place, ...children) {
  for (const child of children.flat(Infinity)) {
    if (child === null || child === undefined || child === false) continue;
    place.append(child instanceof Node ? child : document.createTextNode(String(child)));
  }
  return place;
}

export function fill(place, ...children) {
  place.replaceChildren();
  return put(place, ...children);
}

// A name from a file: kept apart from the text around it, whatever direction it is written in, and never empty.
export function name(text) {
  const shown = String(text ?? "");
  return el("bdi", { class: "name" }, shown.trim() === "" ? "(no name)" : shown);
}

let count = 0;

// A control below its label; the hint is read out with it.
export function field(label, control, hint = "") {
  control.id = control.id || `c${++count}`;
  const parts = [el("label", { for: control.id }, label), control];
  if (hint) {
    const note = el("p", { class: "hint", id: `${control.id}-hint` }, hint);
    control.setAttribute("aria-describedby", note.id);
    parts.push(note);
  }
  return el("div", { class: "field" }, parts);
}

export function tick(label, checked, act) {
  const box = el("input", { type: "checkbox", checked, id: `c${++count}` });
  box.addEventListener("change", () => act && act(box.checked));
  const whole = el("span", { class: "tick" }, box, el("label", { for: box.id }, label));
  whole.box = box;
  return whole;
}

// A list to choose from: options are texts, or {value, text}. The choice stays if it is still there.
export function options(select, items, chosen) {
  const wanted = chosen === undefined ? select.value : chosen;
  fill(select, items.map((item) => {
    const { value, text } = typeof item === "string" ? { value: item, text: item } : item;
    return el("option", { value }, text === "" ? "(no name)" : text);
  }));
  if ([...select.options].some((option) => option.value === wanted)) select.value = wanted;
  else if (select.options.length) select.selectedIndex = 0;
  return select;
}

// Several of some names, a checkbox each; what is ticked stays ticked while it is there. `act` is called on a change.
export function several(label, hint = "", act = () => {}) {
  const list = el("div", { class: "ticks" });
  const whole = el("fieldset", { class: "field several" }, el("legend", {}, label), list, hint ? el("p", { class: "hint" }, hint) : null);
  let offered = null;
  whole.picked = () => [...list.querySelectorAll("input")].filter((box) => box.checked).map((box) => box.value);
  whole.choose = (names) => list.querySelectorAll("input").forEach((box) => { box.checked = names.includes(box.value); });
  whole.offer = (items, first = []) => {
    if (offered !== null && JSON.stringify(offered) === JSON.stringify(items)) return; // the focus stays where it is
    const ticked = offered === null ? first : whole.picked();
    offered = [...items];
    fill(list, items.length ? items.map((item) => {
      const one = tick(name(item), ticked.includes(item), act);
      one.box.value = item;
      return one;
    }) : el("p", { class: "soft" }, "none yet"));
  };
  return whole;
}

// Where the work goes on after a stage.
export function next(stage, text) {
  return el("p", { class: "actions" }, el("a", { class: "go", href: `#/${stage}` }, text));
}

export function table(headings, rows, { note = "", label = "" } = {}) {
  const head = el("tr", { role: "row" }, headings.map((heading) => {
    const { text, number } = typeof heading === "string" ? { text: heading, number: false } : heading;
    return el("th", { role: "columnheader", class: number ? "number" : "", scope: "col" }, text);
  }));
  // On a narrow screen rows stand as cards, each cell with its heading: the report's style; roles keep it a table.
  const body = rows.map((row) => el("tr", { role: "row" }, row.map((cell, k) => {
    const heading = typeof headings[k] === "string" ? { text: headings[k], number: false } : headings[k];
    const classes = `${heading.number ? "number" : "text"}${k ? "" : " name"}`;
    return el("td", { role: "cell", class: classes, ...(k && heading.text ? { "data-label": heading.text } : {}) }, cell);
  })));
  const made = el("table", { role: "table" }, note ? el("caption", {}, note) : null, el("thead", { role: "rowgroup" }, head), el("tbody", { role: "rowgroup" }, body));
  return el("div", { class: "scroll", tabIndex: 0, role: "region", "aria-label": label || note || "table" }, made);
}

export function number(value, digits = 4) {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.abs(value);
  const text = size >= 1e5 || size < 1e-4 ? value.toExponential(digits - 1) : String(Number(value.toPrecision(digits)));
  return text.replace("-", "−");
}

// A unit as it is printed: kg m^2 as kg·m².
export function pretty(unit) {
  return unit.replaceAll("^2", "²").replaceAll("^3", "³").replaceAll(" ", "·");
}

export function percent(value) {
  return value === null || value === undefined ? "–" : `${number(100 * value, 3)}\u00a0%`;
}

export function bytes(size) {
  if (size < 1000) return `${size} B`;
  return size >= 1e6 ? `${number(size / 1e6, 3)} MB` : `${number(size / 1e3, 3)} kB`;
}

export function say(text, bad = false) {
  const place = document.getElementById("said");
  place.classList.toggle("bad", bad);
  fill(place, text);
  place.classList.add("shown");
  clearTimeout(say.timer);
  say.timer = setTimeout(() => place.classList.remove("shown"), bad ? 12000 : 4000);
}
