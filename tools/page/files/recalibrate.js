"use strict";

const PARTS = {
  idle: ["idle", "how"],
  scanning: ["picture", "next", "zeta", "cover", "cloud"],
  review: ["zeta", "next", "cover", "cloud", "views", "sign"],
  proving: ["proving"],
  done: ["over"],
  ended: ["over"],
};
const TURNS = ["Lean forwards / backwards", "Twist", "Lean to the sides"];
let latest = null;   // the last recalibration that was told
let confirmed = "";  // the difference that a person has accepted
let shownViews = "";

function refused(text) {
  el("refused").hidden = !text;
  set("refused", text);
}

async function ask(what, body) {
  refused("");
  try {
    const answer = await fetch(what === "token" ? "/token" : `/recalibration/${what}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body || {}),
    });
    const said = await answer.json();
    if (!said.ok && !said.ask) refused(said.error);
    return said;
  } catch (error) {
    refused("The page does not answer. Try again.");
    return { ok: false };
  }
}

function numbers(scan) {
  const result = scan && scan.result;
  if (!result) { set("zeta", "ζ …"); rows(el("result"), []); return; }
  set("zeta", `ζ ${result.zeta_mm.toFixed(2)} ± ${result.zeta_sigma_mm.toFixed(2)} mm`);
  const lines = [[["one view scatters by"], [`${result.localisation_mm.toFixed(2)} mm`, "number"]]];
  if (result.zeta_before_mm !== null) lines.push([["ζ before"], [`${result.zeta_before_mm.toFixed(2)} mm`, "number"]]);
  if (result.closed_mm !== null) lines.push([["ζ in closed form"], [`${result.closed_mm.toFixed(2)}${result.closed_sigma_mm === null ? "" : ` ± ${result.closed_sigma_mm.toFixed(2)}`} mm`, "number"]]);
  if (result.expected_mm !== null) lines.push([["error of a point, expected"], [`${result.expected_mm.toFixed(2)} mm`, "number"]]);
  lines.push([["tracker late by"], [`${result.latency_ms.toFixed(0)} ± ${result.latency_sigma_ms.toFixed(0)} ms`, "number"]]);
  rows(el("result"), lines);
}

function refusals(scan) {
  const lines = (scan ? scan.refusals : []).slice(0, 5).map(one => {
    const line = make("p", undefined, "told calm");
    line.append(make("strong", `${one.reason}: `), make("span", `${one.what}. ${one.remedy}.`));
    return line;
  });
  el("refusals").replaceChildren(...lines);
}

function covered(scan) {
  const coverage = scan && scan.coverage;
  set("next", (coverage && coverage.next) || (coverage ? "All is covered: the scan can be completed" : "Find the crossing, and pass slowly through it"));
  const bins = coverage ? coverage.bins : [[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]];
  el("bins").replaceChildren(...bins.flatMap((line, axis) => [
    make("span", TURNS[axis]),
    ...line.map(count => { const one = make("i", count ? String(count) : ""); one.dataset.enough = count >= 2 ? "1" : "0"; return one; }),
  ]));
  const places = coverage ? coverage.places : [[0, 0, 0], [0, 0, 0], [0, 0, 0]];
  el("places").replaceChildren(...places.flat().map(count => { const one = make("i", String(count)); one.dataset.enough = count >= 2 ? "1" : "0"; return one; }));
}

function cloud(scan) {
  const canvas = el("cloud"), context = canvas.getContext("2d");
  const style = getComputedStyle(document.body), half = canvas.width / 2, middle = canvas.height / 2, px_per_mm = 40;
  context.clearRect(0, 0, canvas.width, canvas.height);
  context.strokeStyle = style.getPropertyValue("--line");
  context.lineWidth = 1;
  for (const left of [0, half]) {
    for (let mm = -3; mm <= 3; mm += 1) {
      context.beginPath();
      context.moveTo(left + half / 2 + mm * px_per_mm, 10); context.lineTo(left + half / 2 + mm * px_per_mm, canvas.height - 10);
      context.moveTo(left + 10, middle + mm * px_per_mm); context.lineTo(left + half - 10, middle + mm * px_per_mm);
      context.stroke();
    }
  }
  for (const view of scan ? scan.views : []) {
    if (!view.cloud_mm) continue;
    context.fillStyle = style.getPropertyValue(view.used ? "--good" : "--bad");
    [[0, 0, 1], [half, 0, 2]].forEach(([left, one, other]) => {
      context.beginPath();
      context.arc(left + half / 2 + view.cloud_mm[one] * px_per_mm, middle + view.cloud_mm[other] * px_per_mm, 5, 0, 7);
      context.fill();
    });
  }
}

function found(scan) {
  const look = scan && scan.look;
  set("found", !look ? "…" : look.centre_px ? `Crossing found, ${Math.round(100 * look.confidence)} %` : look.why);
  const missed = scan && scan.missed.length ? ` · without: ${scan.missed.map(one => `${one.pictures} ${one.why}`).join("; ")}` : "";
  set("counts", scan ? `${scan.views.length} views · crossing in ${scan.sightings} of ${scan.pictures} pictures${missed}` : "");
}

// What was found in the very picture that is shown.
function marks(context, canvas, look) {
  const scan = latest && latest.scan;
  if (!look || !scan || !scan.size_px) return;
  const scale = canvas.width / scan.size_px[0];
  context.lineWidth = 3;
  context.strokeStyle = "#22c3dd";
  for (const [column, row] of look.spots_px) { context.beginPath(); context.arc(column * scale, row * scale, 12, 0, 7); context.stroke(); }
  if (!look.centre_px) return;
  const [x, y] = look.centre_px.map(one => one * scale);
  context.strokeStyle = "#1fae5a";
  context.beginPath();
  context.arc(x, y, 16, 0, 7);
  context.moveTo(x - 26, y); context.lineTo(x + 26, y); context.moveTo(x, y - 26); context.lineTo(x, y + 26);
  context.stroke();
  context.fillStyle = "#1fae5a";
  context.font = "bold 20px system-ui";
  context.fillText(`${Math.round(100 * look.confidence)} %`, x + 22, y - 12);
}

function views(scan, may) {
  const known = scan ? scan.views : [];
  const key = JSON.stringify([known.map(view => [view.struck, view.used, view.off_mm, view.centre_px]), may]);
  if (key === shownViews) return;
  shownViews = key;
  const focused = document.activeElement && document.activeElement.dataset ? document.activeElement.dataset.view : undefined;
  el("views").replaceChildren(...known.map((view, index) => {
    const line = make("li"), canvas = make("canvas"), button = make("button", view.struck ? "Take back" : "Strike out");
    line.dataset.out = view.used ? "0" : "1";
    canvas.width = canvas.height = 96;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `view ${index + 1}`);
    const image = new Image();
    image.onload = () => {
      const context = canvas.getContext("2d");
      context.drawImage(image, 0, 0);
      context.strokeStyle = view.used ? "#1fae5a" : "#ff5555";
      context.strokeRect(38.5, 38.5, 20, 20);
    };
    image.src = `/view/${index}`;
    if (may) canvas.onclick = event => {
      const box = canvas.getBoundingClientRect(), by = 96 / box.width;
      const column = view.centre_px[0] + (event.clientX - box.left) * by - 48, row = view.centre_px[1] + (event.clientY - box.top) * by - 48;
      ask("correct", { index, column, row });
    };
    button.type = "button";
    button.dataset.view = String(index);
    button.hidden = !may;
    button.setAttribute("aria-label", `${view.struck ? "Take back" : "Strike out"} view ${index + 1}`);
    button.onclick = () => ask("strike", { index, struck: !view.struck });
    const what = view.struck ? "struck out" : view.used ? "" : "contradicts the others";
    line.append(canvas, make("div", `${index + 1}: ${view.off_mm === null ? "–" : `${view.off_mm.toFixed(2)} mm`} ${what}`, view.used ? "soft" : "bad"), button);
    return line;
  }));
  if (focused !== undefined) { const again = document.querySelector(`[data-view="${focused}"]`); if (again) again.focus(); }
}

function show(event) {
  showState(event.status, event.silence);
  document.documentElement.lang = "en";
  const now = latest = event.recalibration, may = event.visitor !== null, scan = now.scan;
  const wanted = PARTS[now.phase];
  for (const part of document.querySelectorAll("[id^='part-']")) {
    const name = part.id.slice(5);
    part.hidden = name === "token" ? may : !wanted.includes(name);
  }
  document.body.dataset.phase = now.phase;
  for (const button of document.querySelectorAll(".needs-token")) button.disabled = !may;
  el("finish").hidden = now.phase !== "scanning";
  for (const button of el("part-next").querySelectorAll("[data-act]")) button.hidden = now.phase !== "scanning";
  el("trouble").hidden = !now.trouble;
  set("trouble", now.trouble);
  if (now.phase === "scanning") set("picture-title", `2. Scan: ${now.probe}, ${now.preset}, by ${now.technician}`);
  found(scan); covered(scan); numbers(scan); refusals(scan); cloud(scan);
  if (now.phase === "review") {
    views(scan, may);
    el("accept").disabled = !may || !scan || scan.refusals.length > 0;
  } else { confirmed = ""; el("differs").hidden = true; set("accept", "Accept"); }
  set("proving", now.message);
  set("over-title", now.phase === "done" ? "Done" : "Ended");
  set("over", now.message);
  set("over-file", now.phase === "done" ? `Written: ${now.file}` : "");
}

el("token-form").onsubmit = async event => {
  event.preventDefault();
  const said = await ask("token", { token: el("token").value });
  if (said.ok) location.reload();
};
el("begin-form").onsubmit = event => {
  event.preventDefault();
  ask("begin", Object.fromEntries(["probe", "preset", "technician", "reason", "wanted"].map(name => [name, el(name).value])));
};
el("finish").onclick = () => ask("finish");
el("sign-form").onsubmit = async event => {
  event.preventDefault();
  const said = await ask("accept", { name: el("signer").value, role: el("role").value, comment: el("comment").value, confirm: confirmed });
  if (said.ask) {
    confirmed = said.ask;
    el("differs").hidden = false;
    set("differs", `It differs from the calibration in force by more than the limits: ${said.ask}. Nothing of it is verified then. Press again to accept that.`);
    set("accept", "Accept that difference");
  }
};
for (const button of document.querySelectorAll("[data-act]")) button.onclick = () => ask(button.dataset.act, { reason: "on the page" });

listen(show);
follow(el("picture"), el("picture-why"), marks);
stayAwake();
