"use strict";

const MARKS = { shown: ["✓", "good"], carried: ["~", "wait"], missing: ["?", "wait"], wrong: ["✗", "bad"], good: ["✓", "good"], wait: ["?", "wait"], bad: ["✗", "bad"], notice: ["!", "wait"] };
// What is the same stays as it is: hints, marked text and a drawing's motion outlive an event.
const last = {};
function changed(name, ...what) {
  const key = JSON.stringify([language, ...what]);
  if (last[name] === key) return false;
  last[name] = key;
  return true;
}
const SVG = "http://www.w3.org/2000/svg";
const STILL = matchMedia("(prefers-reduced-motion: reduce)");
// A limit is at 2/3 of the half track, so that what is beyond it has room to show.
const TRACK = { middle: 60, limit: 40, end: 58 };

function drawn(tag, attributes) {
  const one = document.createElementNS(SVG, tag);
  for (const [name, text] of Object.entries(attributes)) one.setAttribute(name, text);
  return one;
}

// The track from minus to plus, its limits, three sigmas of the value, and the value.
function track(row) {
  const svg = drawn("svg", { viewBox: "0 0 120 16", preserveAspectRatio: "none", class: "track", "aria-hidden": "true" });
  const at = share => TRACK.middle + Math.max(-TRACK.end, Math.min(TRACK.end, share * TRACK.limit));
  svg.append(drawn("rect", { class: "within", x: TRACK.middle - TRACK.limit, y: 5, width: 2 * TRACK.limit, height: 6 }));
  if (row.share !== null) {
    const low = at(row.share - 3 * row.sigma_share), high = at(row.share + 3 * row.sigma_share);
    svg.append(drawn("rect", { class: `sure ${MARKS[row.mark][1]}`, x: low, y: 4, width: Math.max(1, high - low), height: 8 }));
    svg.append(drawn("rect", { class: `value ${MARKS[row.mark][1]}`, x: at(row.share) - 2, y: 0, width: 4, height: 16 }));
  }
  for (const side of [-1, 1]) svg.append(drawn("rect", { class: "limit", x: TRACK.middle + side * TRACK.limit - 0.75, y: 1, width: 1.5, height: 14 }));
  return svg;
}

function showBars(room) {
  set("point", room.point);
  set("limits", room.limits);
  if (!changed("bars", room.bars)) return;
  el("shown").replaceChildren(...room.bars.map(row => {
    const line = make("tr"), [mark, kind] = MARKS[row.mark], name = make("th", `${mark} ${row.title}`, kind), cell = make("td", undefined, "track");
    name.scope = "row";
    cell.append(track(row));
    const text = make("td", undefined, "number"), now = say(row.text);
    const age = row.age_s === null ? "" : row.mark === "carried" ? `${aged(row.age_s)} / ${aged(row.max_age_s)}` : ago(row.age_s);
    const below = [row.limit && `${say("of")} ${row.limit}`, age].filter(Boolean).join(" · ");
    text.append(make("div", now.replaceAll(" ", "\u00a0")), make("div", below.replaceAll(" ", "\u00a0"), "soft tiny"));
    line.append(name, cell, text);
    return line;
  }));
  el("carried").hidden = !room.bars.some(row => row.mark === "carried");
  set("carried", `~ ${say("Not shown by the present motion; within its age, as no detector saw a change")}`);
}

// Contours of the error of a point, over the picture as it lies there; each has its figure in millimetres.
function showContours(room) {
  const canvas = el("picture"), svg = el("contours"), button = el("contours-on");
  const on = button.getAttribute("aria-pressed") === "true" && el("picture-why").hidden;
  button.hidden = room.contours.length === 0;
  if (!changed("contours", room.contours, on, canvas.width, canvas.height, canvas.clientWidth)) return;
  svg.setAttribute("viewBox", `0 0 ${canvas.width} ${canvas.height}`);
  svg.replaceChildren(...(on ? room.contours : []).flatMap(one => {
    const lines = ["under", "over"].map(kind => drawn("path", { class: kind, d: one.path, transform: `scale(${canvas.width} ${canvas.height})` }));
    const text = drawn("text", { x: one.at[0] * canvas.width, y: one.at[1] * canvas.height, "font-size": Math.max(canvas.width / 36, 15 * canvas.width / canvas.clientWidth) });
    text.textContent = `${language === "de" ? comma(String(one.mm)) : one.mm} mm`;
    return [...lines, text];
  }));
}

function showGestures(room) {
  el("part-gestures").hidden = room.gestures.length === 0 || el("state").dataset.lamp === "green";
  if (!changed("gestures", room.gestures)) return;
  el("gestures").replaceChildren(...room.gestures.map(gesture => {
    const line = make("li");
    if (gesture.drawing) {
      const image = make("img");
      image.src = `/files/${gesture.drawing}${STILL.matches ? "#still" : ""}`;
      image.alt = "";
      line.append(image);
    }
    line.append(make("span", gesture.text));
    return line;
  }));
}

function deviceLine(row) {
  const line = make("li"), [mark, kind] = MARKS[row.kind], head = make("p");
  const rate = row.rate === null ? "" : `, ${figure(row.rate, 0)} ${say("a second")}`;
  const said = row.kind === "good" ? `${say("as it should be")}${rate}` : row.wrong.map(one => one.text).join("; ") || say("lost");
  head.append(make("strong", `${mark} ${say(row.device)}: `, kind), make("span", said, row.kind === "good" ? "" : kind));
  line.append(head);
  for (const one of row.wrong) line.append(make("p", `→ ${one.remedy}`));
  for (const text of row.driver) {
    const own = make("p", say(text), "soft tiny");
    if (language !== "en" && say(text) === text) own.lang = "en";
    line.append(own);
  }
  return line;
}

function showDevices(status, room) {
  const gone = status.recalibration && status.recalibration.ended;
  const said = new Set(room.devices.flatMap(row => row.wrong.map(one => one.text)));
  const notices = status.notices.filter(text => !said.has(text));
  if (gone) {
    const [what, why] = whole(["Recalibrate", gone]);
    notices.push(`${what}: ${why}`);
  }
  const reference = status.reference;
  if (!changed("devices", room.devices, notices, reference, status.reference_waits)) return;
  el("devices").replaceChildren(...room.devices.map(deviceLine), ...notices.map(text => make("li", `! ${text}`, "wait")));
  set("reference", reference ? `${say("Calibration in force")}: ${reference.number}, ${say("since")} ${reference.utc.slice(0, 10)}, ${reference.file.split("/").pop()}` : say(status.reference_waits || ""));
}

function showAlarms(alarms) {
  if (!changed("alarms", alarms.entries, alarms.trouble)) return;
  const lines = alarms.entries.map(entry => {
    const line = make("li");
    line.append(make("strong", `${entry.state} `), make("span", `${day(entry.time)} ${entry.time.slice(11, 16)} · ${entry.reason}`, "soft"));
    return line;
  });
  el("alarms").replaceChildren(...(lines.length ? lines : [make("li", say(alarms.trouble || "none"), "soft")]));
}
function day(time) {
  const [year, month, date] = time.slice(0, 10).split("-");
  return language === "de" ? `${date}.${month}.` : `${year}-${month}-${date}`;
}

// Of the cart's clock, whatever the tablet's zone is.
function atCart(time_s, clock) {
  const ahead_ms = Date.parse(`${clock.slice(0, 19)}Z`) - Date.parse(clock);
  return new Date(1000 * time_s + ahead_ms).toISOString().slice(11, 19);
}
const HOUR_STEP_S = 4;  // some pixels of a wall screen
// Each stretch in the colour of its lamp, and over it a mark where an alarm began, however short it was.
function showHour(alarms, clock) {
  const now_s = Math.floor(Date.parse(clock) / 1000 / HOUR_STEP_S) * HOUR_STEP_S, spent_s = {};
  if (!changed("hour", alarms.hour, alarms.trouble, now_s)) return;
  let began = 0;
  el("hour").replaceChildren(...alarms.hour.flatMap((one, index) => {
    const next = alarms.hour[index + 1], from_s = Math.max(one.from_s, now_s - 3600), to_s = Math.min(now_s, next ? next.from_s : now_s);
    if (to_s <= now_s - 3600 || to_s < from_s) return [];
    const x = from_s - now_s + 3600, part = drawn("rect", { class: one.lamp, x, y: 14, width: Math.max(to_s - from_s, 1), height: 46 });
    const title = drawn("title", {});
    title.textContent = `${atCart(from_s, clock)} · ${one.state} · ${one.reason}`;
    part.append(title);
    spent_s[one.lamp] = (spent_s[one.lamp] || 0) + to_s - from_s;
    if (!one.alarm || one.from_s < now_s - 3600) return [part];
    began += 1;
    return [part, drawn("rect", { class: `began ${one.lamp}`, x: x - 6, y: 0, width: 12, height: 60 })];
  }));
  const told = [["green", "verified"], ["cyan", "not verified"], ["yellow", "warning"], ["red", "alarm"], ["unknown", "not known"]]
    .filter(([lamp]) => spent_s[lamp] >= 1).map(([lamp, words]) => `${say(words)} ${lasted(spent_s[lamp])}`);
  const text = [...told, `${began} ${say(began === 1 ? "alarm began" : "alarms began")}`].join(" · ");
  set("hour-told", alarms.hour.length ? text : say(alarms.trouble || "nothing is known"));
  el("hour").setAttribute("aria-label", `${say("The last hour")}: ${text}`);
}

function showActs(status, may) {
  const silent = status.audio.mode === "paused" || status.audio.mode === "off";
  const waits = !status.acknowledged && (status.priority === "high" || status.priority === "medium");
  for (const button of document.querySelectorAll("[data-request]")) {
    const what = button.dataset.request;
    button.hidden = what === "sound" ? !silent : what === "silence" && silent;
    if (what === "acknowledge") button.className = waits ? "main" : "";
  }
  if (may) el("token-form").hidden = true;
}

let wanted = "", may = false;
async function request(what) {
  if (!may) {
    wanted = what;
    el("token-form").hidden = false;
    el("token").focus();
    return;
  }
  const said = await post(`/request/${what}`);
  const button = document.querySelector(`[data-request="${what}"]`);
  const lacking = shownLast && shownLast.lacks[what];
  set("done", said.ok ? `${button.textContent}: ${say(lacking || "done")}` : "");
}
for (const button of document.querySelectorAll("[data-request]")) button.onclick = () => request(button.dataset.request);
el("token-form").onsubmit = async event => {
  event.preventDefault();
  const said = await post("/token", { token: el("token").value });
  if (!said.ok) return;
  may = true;
  el("token").value = "";
  el("token-form").hidden = true;
  listen.again();  // the stream that is open was asked for without the cookie
  await request(wanted);
};
let shownLast = null;
el("contours-on").onclick = () => {
  const button = el("contours-on"), on = button.getAttribute("aria-pressed") !== "true";
  button.setAttribute("aria-pressed", String(on));
  try { localStorage.setItem("contours", on ? "on" : "off"); } catch (error) { /* a private window */ }
  if (shownLast) showContours(shownLast);
};
try { el("contours-on").setAttribute("aria-pressed", String(localStorage.getItem("contours") !== "off")); } catch (error) { /* a private window */ }
el("room").onclick = () => { switchRoom(); shade(); };
function shade() { el("room").setAttribute("aria-pressed", String(document.documentElement.dataset.room === "dark")); }

listen(event => {
  may = event.visitor !== null;
  showState(event);
  translate();
  if (event.status) {
    shownLast = event.room;
    showBars(event.room); showContours(event.room); showGestures(event.room); showDevices(event.status, event.room); showActs(event.status, may);
    showHour(event.alarms, event.clock);  // while the service is away nothing is known of what goes on
    el("proposal").hidden = !event.status.proposal;
    set("proposal", event.status.proposal ? `→ ${event.status.proposal.text}` : "");
  }
  if (!event.status) showContours({ contours: [] });
  showAlarms(event.alarms);
});
shade();
follow(el("picture"), el("picture-why"));
stayAwake();
