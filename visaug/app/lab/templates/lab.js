// The page asks the server how far it is, and takes over its part of the page when there is something new.
"use strict";

const token = new URLSearchParams(location.search).get("token");
const address = (path) => `${path}?token=${encodeURIComponent(token)}`;
const at = (id) => document.getElementById(id);
const bench = at("bench");
let said = ""; // what went wrong, and
let notice = ""; // what went well, as the page itself knows it, until something else is asked
let given = false; // whether the views show the camera as given
let dragging = false; // a slider is held: the page under it stays

// What the reader chose is kept in the address, after #: a reload or a copied address brings it back.
const look = (() => {
  try { return JSON.parse(decodeURIComponent(location.hash.slice(1))) || {}; } catch { return {}; }
})();
if (look.plots) Plots.restore(look.plots);
given = Boolean(look.given);
let keeping = 0;
function keep() {
  clearTimeout(keeping);
  keeping = setTimeout(() => {
    const open = [...bench.querySelectorAll("details[open]")].map((each) => each.id);
    const state = { open, given, frame: look.frame, exposure: look.exposure, plots: Plots.state() };
    history.replaceState(null, "", `${location.pathname}${location.search}#${encodeURIComponent(JSON.stringify(state))}`);
  }, 300);
}
Plots.onChange(keep);

async function ask(path, options) {
  const answer = await fetch(address(path), options);
  if (!answer.ok) {
    const text = await answer.text();
    let line = text;
    try { line = JSON.parse(text).error; } catch { /* not ours: shown as it is */ }
    throw new Error(line?.trim() || `the lab answered ${answer.status}`);
  }
  return answer;
}

async function act(path, body) {
  said = notice = "";
  try { await ask(path, { method: "POST", body }); } catch (mistake) { said = mistake.message; }
  await refresh();
}

async function save(name) {
  said = notice = "";
  try {
    const file = URL.createObjectURL(await (await ask(name)).blob());
    const link = Object.assign(document.createElement("a"), { href: file, download: name });
    link.click();
    setTimeout(() => URL.revokeObjectURL(file), 60000);
    notice = `Saved as ${name} in the browser's downloads.`;
    if (name === "camera.yaml") {
      const { saved } = await (await ask("save", { method: "POST" })).json();
      if (saved) notice += ` Also written to ${saved}.`;
    }
  } catch (mistake) { said = mistake.message; }
  await refresh();
}

function showWork(state) {
  const job = state.job;
  const busy = [...(job ? [job.title] : []), ...state.waiting];
  const wrong = said || (state.failed ? state.message : "");
  const right = notice || (state.failed ? "" : state.message);
  show("message", wrong);
  show("notice", right);
  at("progress").hidden = !busy.length;
  document.querySelector("[data-post=diagnose]").disabled = busy.includes("diagnosing");
  show("waiting", job && state.waiting.length ? `then: ${state.waiting.join(", ")}` : "");
  if (!job) { at("title").textContent = busy[0] || ""; return; }
  at("title").textContent = job.title;
  at("step").textContent = job.step;
  at("count").textContent = [job.total ? `${job.done} of ${job.total}` : "", `${Math.round(job.seconds)} s`].filter(Boolean).join(" · ");
  if (job.total) at("bar").value = job.done / job.total; else at("bar").removeAttribute("value");
  at("phases").replaceChildren(...job.phases.map((phase) =>
    Object.assign(document.createElement("li"), { textContent: `${phase.name} (${phase.seconds.toFixed(0)} s)` })));
}

function show(id, text) {
  at(id).textContent = text || "";
  at(id).hidden = !text;
}

// Curves and maps are drawn when they come near to what is seen.
const near = new IntersectionObserver((entries) => entries.forEach((entry) => {
  if (entry.isIntersecting) { near.unobserve(entry.target); drawView(entry.target); }
}), { rootMargin: "400px" });
const known = new Map(); // what was fetched, by address

async function drawView(holder) {
  const { view } = holder.dataset, key = given && bench.querySelector("[data-given]")?.dataset.given || holder.dataset.key;
  const path = { frame: `frame/${key}/${look.frame || 0}`, own: `own/${holder.dataset.own}/${key}/${at("exposure")?.value}` }[view] || `view/${key}/${view}`;
  try {
    if (!known.has(path)) known.set(path, (await ask(path)).json());
    if (known.size > 120) known.delete(known.keys().next().value);
    const data = await known.get(path);
    if (!holder.isConnected) return;
    Plots.draw(holder, view, data);
    if (data.choices) offerFrames(data.choices);
  } catch (mistake) {
    known.delete(path);
    if (view === "own") { holder.textContent = mistake.message; return; }
    // these frames do not show it
    const figure = holder.closest("figure");
    if (figure) figure.hidden = true;
  }
}

function offerFrames(choices) {
  const select = at("frame");
  if (!select || select.options.length) return;
  Object.entries(choices).forEach(([index, label]) => select.add(new Option(label, index)));
  select.value = String(look.frame || 0);
}

function drawAll() {
  bench.querySelectorAll("[data-view]").forEach((holder) => { near.unobserve(holder); near.observe(holder); });
}

// The focus stays on what had it: the same field or button, or the one that took its place.
function selectorOf(element) {
  if (!element || !bench.contains(element)) return null;
  if (element.id) return `#${CSS.escape(element.id)}`;
  const { post, path, kind } = element.dataset;
  if (post) return `[data-post="${CSS.escape(post)}"]`;
  return path ? `[data-path="${CSS.escape(path)}"][data-kind="${kind}"]` : null;
}

function focusAgain(selector) {
  if (!selector) return;
  const swapped = selector.replace(/(add|remove)(\\?\/)/, (_, word, slash) => (word === "add" ? "remove" : "add") + slash);
  const target = bench.querySelector(selector) || bench.querySelector(swapped);
  if (target && !target.disabled) target.focus({ preventScroll: true });
  else at("verdict")?.focus({ preventScroll: true });
}

async function takeOver(version) {
  const first = !bench.dataset.taken, stale = String(version) !== bench.dataset.version;
  const newer = stale ? await (await ask("bench")).text() : "";
  // What is open is noted after the answer has come: a reader may open something while it is awaited.
  const open = first ? look.open || [] : [...bench.querySelectorAll("details[open]")].map((each) => each.id);
  if (stale) {
    const focus = selectorOf(document.activeElement);
    const heights = Object.fromEntries([...bench.querySelectorAll("[data-view]")].map((h) => [h.dataset.view, h.clientHeight]));
    bench.innerHTML = newer;
    bench.querySelectorAll("[data-view]").forEach((h) => { if (heights[h.dataset.view]) h.style.minHeight = `${heights[h.dataset.view]}px`; });
    bench.dataset.version = version;
    for (const [path, value] of Object.entries(wanted)) // typed, and not sent yet
      bench.querySelectorAll(`[data-path="${CSS.escape(path)}"]`).forEach((input) => { input.value = value; });
    focusAgain(focus);
  }
  bench.dataset.taken = "yes";
  open.forEach((id) => at(id)?.setAttribute("open", ""));
  const shown = bench.querySelector(`[name=shown][value=${given ? "given" : "now"}]`);
  if (shown) shown.checked = true; else given = false;
  if (at("exposure") && look.exposure) at("exposure").value = look.exposure;
  drawAll();
}

let timer = 0;
async function refresh() {
  clearTimeout(timer);
  let busy = false;
  try {
    const state = await (await ask("state")).json();
    busy = Boolean(state.job || state.waiting.length);
    if ((String(state.version) !== bench.dataset.version || !bench.dataset.taken) && !dragging) await takeOver(state.version);
    showWork(state);
  } catch (mistake) {
    show("message", mistake instanceof TypeError ? "visaug lab no longer answers: it was ended. Start it again from the terminal." : mistake.message);
  }
  clearTimeout(timer);
  timer = setTimeout(refresh, busy ? 500 : 2000);
}

// Numbers: a field and a slider each, and the error follows when the hand rests.
let resting = 0;
const wanted = {};
function setNumber(input) {
  const { path, kind } = input.dataset;
  const other = bench.querySelector(`[data-path="${CSS.escape(path)}"][data-kind="${kind === "range" ? "number" : "range"}"]`);
  if (input.value === "" || input.validity.badInput) return;
  other.value = input.value;
  wanted[path] = Number(input.value);
  clearTimeout(resting);
  resting = setTimeout(async () => {
    const body = JSON.stringify(wanted);
    Object.keys(wanted).forEach((key) => delete wanted[key]);
    await act("numbers", body);
  }, kind === "range" ? 350 : 700);
}

// A file with an effect is code: what it begins with is shown, and it is run when `Load effect` is pressed. Pressed before
// a file is chosen, the button asks for the file and loads that one.
async function showEffect() {
  const file = at("file").files[0];
  at("chosen").hidden = !file;
  at("load").classList.toggle("primary", Boolean(file));
  if (!file) return;
  const lines = (await file.slice(0, 20000).text()).split("\n"), shown = lines.slice(0, 24);
  at("chosen-name").textContent = `${file.name}, ${file.size} bytes, has not been run. It begins:`;
  at("chosen-lines").textContent = shown.join("\n") + (lines.length > shown.length ? "\n…" : "");
}

async function loadEffect() {
  const file = at("file").files[0], text = await file.text();
  at("file").value = ""; // the same file may be loaded again after a change
  await showEffect();
  await act(`load/${encodeURIComponent(file.name)}`, text);
}

function ownPicture() {
  const input = Object.assign(document.createElement("input"), { type: "file", accept: ".png,.jpg,.jpeg,.tif,.tiff,.webp,.bmp,.npy,.exr" });
  input.onchange = async () => {
    at("own").textContent = "Reading the picture …";
    await act(`own/${encodeURIComponent(input.files[0].name)}`, input.files[0]);
    at("own").textContent = "Choose a picture";
  };
  input.click();
}

let asked = false; // `Load effect` was pressed before a file was chosen
document.addEventListener("click", ({ target }) => {
  const button = target.closest("button");
  if (!button) return;
  if (button.dataset.post) act(button.dataset.post);
  else if (button.dataset.save) save(button.dataset.save);
  else if (button.id === "load" && at("file").files.length) loadEffect();
  else if (button.id === "load") { asked = true; at("file").click(); }
  else if (button.id === "own") ownPicture();
  else if (button.id === "add-other") act(`add/${encodeURIComponent(at("other").value)}`);
});
document.addEventListener("pointerdown", ({ target }) => { dragging = target.dataset?.kind === "range"; });
document.addEventListener("pointerup", () => { dragging = false; });
document.addEventListener("toggle", keep, true);
document.addEventListener("input", ({ target }) => { if (target.dataset.path) setNumber(target); });
document.addEventListener("change", async ({ target }) => {
  if (target.id === "other") {
    at("add-other").textContent = target.value ? `Add ${target.value}` : "Add";
    at("add-other").disabled = !target.value;
  } else if (target.name === "shown") {
    given = target.value === "given";
    keep();
    drawAll();
  } else if (target.id === "frame") {
    look.frame = Number(target.value);
    keep();
    drawView(bench.querySelector("[data-view=frame]"));
  } else if (target.id === "exposure") {
    look.exposure = target.value;
    keep();
    drawView(bench.querySelector("[data-view=own]"));
  } else if (target.id === "file") {
    const load = asked && target.files.length;
    asked = false;
    await (load ? loadEffect() : showEffect());
  }
});

at("file").addEventListener("cancel", () => { asked = false; });
showEffect(); // a reload may keep the choice
refresh();
