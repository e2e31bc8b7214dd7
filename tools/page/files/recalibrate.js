"use strict";

const PARTS = {
  idle: ["idle", "how"],
  latency: ["picture", "latency"],
  scanning: ["picture", "next", "zeta", "cover", "cloud"],
  review: ["zeta", "next", "cover", "cloud", "compare", "views", "check", "sign"],
  checking: ["picture", "checking"],
  proving: ["proving"],
  done: ["over"],
  ended: ["over"],
};
const TURNS = ["Lean forwards / backwards", "Twist", "Lean to the sides"];
let latest = null;   // the last recalibration that was told
let confirmed = "";  // the difference that a person has accepted
let shownViews = "";

function ask(what, body) { return post(what === "token" ? "/token" : `/recalibration/${what}`, body); }

function lateness(one) { return one.latency_ms < 0 ? "tracker early by" : "tracker late by"; }

function numbers(scan) {
  const result = scan && scan.result;
  if (!result) { set("zeta", "ζ …"); rows(el("result"), []); return; }
  set("zeta", `ζ ${figure(result.zeta_mm, 2)} ± ${figure(result.zeta_sigma_mm, 2)} mm`);
  const lines = [[[say("one view scatters by")], [`${figure(result.localisation_mm, 2)} mm`, "number"]]];
  if (result.zeta_before_mm !== null) lines.push([[say("ζ before")], [`${figure(result.zeta_before_mm, 2)} mm`, "number"]]);
  if (result.closed_mm !== null) lines.push([[say("ζ in closed form")], [`${figure(result.closed_mm, 2)}${result.closed_sigma_mm === null ? "" : ` ± ${figure(result.closed_sigma_mm, 2)}`} mm`, "number"]]);
  if (result.expected_mm !== null) lines.push([[say("error of a point, expected")], [`${figure(result.expected_mm, 2)} mm`, "number"]]);
  lines.push([[say(lateness(result))], [`${figure(Math.abs(result.latency_ms), 0)} ± ${figure(result.latency_sigma_ms, 0)} ms`, "number"]]);
  rows(el("result"), lines);
}

const WHO = ["in force", "motion alone"];
function comparison(scan) {
  const lines = scan ? scan.compared : [], who = WHO.filter(name => lines.length && name in lines[0].others);
  el("compare-head").replaceChildren(...["Parameter", "New", "± 1σ", ...who].map(text => {
    const cell = make("th", say(text));
    cell.scope = "col";
    return cell;
  }));
  rows(el("compare"), lines.map(one => [
    [one.title],
    [`${figure(one.value, one.unit === "%" ? 4 : 2)}`, "number"],
    [`${figure(one.sigma, 3)} ${one.unit}`, "number"],
    ...who.map(name => {
      const { off, sigmas } = one.others[name];
      const told = off === null ? "–" : `${off >= 0 ? "+" : ""}${figure(off, 2)} ${one.unit}${sigmas === null ? "" : ` (${figure(sigmas, 1)}σ)`}`;
      return [told, sigmas !== null && Math.abs(sigmas) > 3 ? "number bad" : "number"];
    }),
  ]));
  el("compare-title").parentElement.hidden ||= !lines.length;
}

function late(latency) {
  const seen = latency ? `${latency.seen} / ${latency.pictures}` : "…";
  set("late", latency && latency.latency_ms !== null
    ? `${say(lateness(latency))} ${figure(Math.abs(latency.latency_ms), 1)} ± ${figure(latency.sigma_ms, 1)} ms (${seen})${latency.full ? ` · ${say("enough is collected: take it")}` : ""}`
    : `${say("not known yet")} (${seen})${latency && latency.begun_anew ? ` · ${say("a minute did not show it, started again")}` : ""}`);
  el("late-take").disabled ||= !latency || latency.latency_ms === null;
}

function checked(check) {
  const error = check && check.error_mm !== null ? ` · ${figure(check.error_mm, 2)} mm RMS` : "";
  const text = !check ? say("not made yet") : `${say(check.why) || say("passed")}${check.why ? "" : error}`;
  set("check-told", text);
  set("checking", text);
  el("check-told").className = check && !check.why ? "next good" : "next";
  el("unchecked-part").hidden = Boolean(check && !check.why);
  el("unchecked").required = !el("unchecked-part").hidden;
}

function refusals(scan) {
  const lines = (scan ? scan.refusals : []).slice(0, 5).map(one => {
    const line = make("p", undefined, "told calm");
    const [reason, what, remedy] = whole([one.reason, one.what, one.remedy]);
    line.append(make("strong", `${reason}: `), make("span", `${what}. ${remedy}.`));
    return line;
  });
  el("refusals").replaceChildren(...lines);
}

function covered(scan) {
  const coverage = scan && scan.coverage;
  set("next", say((coverage && coverage.next) || (coverage ? "All is covered: the scan can be completed" : "Find the crossing, and pass slowly through it")));
  const bins = coverage ? coverage.bins : [[0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 0]];
  el("bins").replaceChildren(...bins.flatMap((line, axis) => [
    make("span", say(TURNS[axis])),
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
  set("found", !look ? "…" : look.centre_px ? `${say("Crossing found")}, ${Math.round(100 * look.confidence)} %` : say(look.why));
  const missed = scan && scan.missed.length ? ` · ${say("without")}: ${scan.missed.map(one => `${one.pictures} ${say(one.why)}`).join("; ")}` : "";
  set("counts", scan ? `${scan.views.length} ${say("views")} · ${say("pictures with the crossing")}: ${scan.sightings} / ${scan.pictures}${missed}` : "");
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
  const key = JSON.stringify([known.map(view => [view.struck, view.used, view.off_mm, view.centre_px]), may, language]);
  if (key === shownViews) return;
  shownViews = key;
  const focused = document.activeElement && document.activeElement.dataset ? document.activeElement.dataset.view : undefined;
  el("views").replaceChildren(...known.map((view, index) => {
    const line = make("li"), canvas = make("canvas"), button = make("button", say(view.struck ? "Take back" : "Strike out"));
    line.dataset.out = view.used ? "0" : "1";
    canvas.width = canvas.height = 96;
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `${say("view")} ${index + 1}`);
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
    button.setAttribute("aria-label", `${say(view.struck ? "Take back" : "Strike out")}: ${say("view")} ${index + 1}`);
    button.onclick = () => ask("strike", { index, struck: !view.struck });
    const what = say(view.struck ? "struck out" : view.used ? "" : "contradicts the others");
    line.append(canvas, make("div", `${index + 1}: ${view.off_mm === null ? "–" : `${figure(view.off_mm, 2)} mm`} ${what}`, view.used ? "soft" : "bad"), button);
    return line;
  }));
  if (focused !== undefined) { const again = document.querySelector(`[data-view="${focused}"]`); if (again) again.focus(); }
}

function show(event) {
  showState(event);
  translate();
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
  late(now.latency);
  comparison(scan);
  checked(scan && scan.check);
  set("water-told", scan ? say(scan.sound) : "");
  el("trouble").hidden = !now.trouble;
  set("trouble", say(now.trouble));
  if (now.phase === "scanning") set("picture-title", `2. ${say("Scan")}: ${now.probe}, ${now.preset}, ${say("by")} ${now.technician}`);
  found(scan); covered(scan); numbers(scan); refusals(scan); cloud(scan);
  if (now.phase === "review") {
    views(scan, may);
    el("accept").disabled = el("check-now").disabled = !may || !scan || scan.refusals.length > 0;
  } else { confirmed = ""; el("differs").hidden = true; }
  set("accept", say(confirmed ? "Accept that difference" : "Accept"));
  set("proving", say(now.message));
  set("over-title", say(now.phase === "done" ? "Done" : "Ended"));
  set("over", say(now.message));
  set("over-file", now.phase === "done" ? `${say("Written")}: ${now.file}` : "");
}

el("token-form").onsubmit = async event => {
  event.preventDefault();
  const said = await ask("token", { token: el("token").value });
  if (said.ok) location.reload();
};
el("begin-form").onsubmit = event => {
  event.preventDefault();
  const water = el("water").value;
  ask("begin", {
    ...Object.fromEntries(["probe", "preset", "technician", "reason", "wanted"].map(name => [name, el(name).value])),
    water_c: water === "" ? null : Number(water), scanner_m_s: Number(el("sound").value),
    correct_sound: el("corrected").value === "1", latency: el("latency").value === "1",
  });
};
el("late-take").onclick = () => ask("latency", { measured: true });
el("late-skip").onclick = () => ask("latency", { measured: false });
el("check-now").onclick = () => {
  const typed = el("point").value.trim();
  ask("check", { point: typed ? typed.split(/[\s;]+/).map(Number) : null });
};
el("finish").onclick = () => ask("finish");
el("sign-form").onsubmit = async event => {
  event.preventDefault();
  const said = await ask("accept", { name: el("signer").value, role: el("role").value, comment: el("comment").value, confirm: confirmed,
    unchecked: el("unchecked-part").hidden ? "" : el("unchecked").value });
  if (said.ask) {
    confirmed = said.ask;
    el("differs").hidden = false;
    const [beyond, by, then] = whole(["It differs from the calibration in force by more than the limits", said.ask, "Nothing of it is verified then. Press again to accept that."]);
    set("differs", `${beyond}: ${by}. ${then}`);
    set("accept", say("Accept that difference"));
  }
};
for (const button of document.querySelectorAll("[data-act]")) button.onclick = () => ask(button.dataset.act, { reason: "on the page" });

listen(show);
follow(el("picture"), el("picture-why"), marks);
stayAwake();
