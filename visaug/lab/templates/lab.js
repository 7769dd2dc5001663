// The page asks the server how far it is, and takes over its part of the page when there is something new.
"use strict";

const token = new URLSearchParams(location.search).get("token");
const address = (path) => `${path}?token=${encodeURIComponent(token)}`;
const at = (id) => document.getElementById(id);
const bench = at("bench");
let said = ""; // what went wrong, and
let notice = ""; // what went well, as the page itself knows it, until something else is asked

async function ask(path, options) {
  const answer = await fetch(address(path), options);
  if (!answer.ok) {
    const text = await answer.text();
    let line = text;
    try { line = JSON.parse(text).error; } catch { /* not ours: shown as it is */ }
    throw new Error(line.trim() || `the lab answered ${answer.status}`);
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
    if (name === "camera.yaml") {
      const { saved } = await (await ask("save", { method: "POST" })).json();
      if (saved) notice = `Also written to ${saved}.`;
    }
  } catch (mistake) { said = mistake.message; }
  await refresh();
}

function showWork(state) {
  const job = state.job;
  const busy = [...(job ? [job.title] : []), ...state.waiting];
  const message = said || state.message;
  at("message").textContent = message || "";
  at("message").hidden = !message;
  at("notice").textContent = notice;
  at("notice").hidden = !notice;
  at("progress").hidden = !busy.length;
  document.querySelector("[data-post=diagnose]").disabled = busy.includes("diagnosing");
  at("waiting").textContent = job && state.waiting.length ? `then: ${state.waiting.join(", ")}` : "";
  at("waiting").hidden = !at("waiting").textContent;
  if (!job) { at("title").textContent = busy[0] || ""; return; }
  at("title").textContent = job.title;
  at("step").textContent = job.step;
  at("count").textContent = [job.total ? `${job.done} of ${job.total}` : "", `${Math.round(job.seconds)} s`].filter(Boolean).join(" · ");
  if (job.total) at("bar").value = job.done / job.total; else at("bar").removeAttribute("value");
  at("phases").replaceChildren(...job.phases.map((phase) =>
    Object.assign(document.createElement("li"), { textContent: `${phase.name} (${phase.seconds.toFixed(0)} s)` })));
}

async function takeOver(version) {
  const open = [...bench.querySelectorAll("details[open]")].map((each) => each.id);
  const html = await (await ask("bench")).text();
  bench.innerHTML = html;
  bench.dataset.version = version;
  open.forEach((id) => at(id)?.setAttribute("open", ""));
  bench.classList.remove("given");
}

let timer = 0;
async function refresh() {
  clearTimeout(timer);
  let busy = false;
  try {
    const state = await (await ask("state")).json();
    busy = Boolean(state.job || state.waiting.length);
    if (String(state.version) !== bench.dataset.version) await takeOver(state.version);
    showWork(state);
  } catch (mistake) {
    at("message").textContent = mistake instanceof TypeError ? "visaug lab no longer answers: it was ended." : mistake.message;
    at("message").hidden = false;
  }
  clearTimeout(timer);
  timer = setTimeout(refresh, busy ? 500 : 2000);
}

document.addEventListener("click", ({ target }) => {
  const button = target.closest("button");
  if (!button) return;
  if (button.dataset.post) act(button.dataset.post);
  else if (button.dataset.save) save(button.dataset.save);
  else if (button.id === "load") at("file").click();
  else if (button.id === "add-other") act(`add/${encodeURIComponent(at("other").value)}`);
});
document.addEventListener("change", async ({ target }) => {
  if (target.id === "other") {
    at("add-other").textContent = target.value ? `Add ${target.value}` : "Add";
    at("add-other").disabled = !target.value;
  } else if (target.name === "shown") {
    bench.classList.toggle("given", target.value === "given");
  } else if (target.id === "file" && target.files.length) {
    const file = target.files[0];
    await act(`load/${encodeURIComponent(file.name)}`, await file.text());
    target.value = ""; // the same file may be loaded again after a change
  }
});
// A view that these frames do not show has no picture; maps side by side take the whole width.
document.addEventListener("error", ({ target }) => {
  if (target.tagName === "IMG") target.closest("figure").hidden = true;
}, true);
document.addEventListener("load", ({ target }) => {
  target.closest?.("figure")?.classList.toggle("wide", target.naturalWidth > 1.7 * target.naturalHeight);
  target.classList?.add("drawn");
}, true);

refresh();
