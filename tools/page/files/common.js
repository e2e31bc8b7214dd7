"use strict";
// Shared by both pages: events, the picture, and the words of either language. Nothing is loaded from elsewhere.

// The room's language is the configuration's; before the service has told it, the browser's.
let language = (navigator.language || "en").startsWith("de") ? "de" : "en";
function german(text) {
  if (text in GERMAN) return GERMAN[text];
  for (const [pattern, words] of GERMAN_WITH_NUMBERS) if (pattern.test(text)) return comma(text.replace(pattern, words));
  return null;
}
// Decimals as German writes them; addresses and versions have more than one point.
function comma(text) { return text.replace(/(?<![\d.])(\d+)\.(\d+)(?![\d.]*\d)/g, "$1,$2"); }
function figure(value, places) {
  const text = value.toFixed(places);
  return language === "de" ? comma(text) : text;
}
// A text stays English where it cannot be said whole.
function say(text) { return (language === "de" && text && german(text)) || text; }
// All of a line in one language.
function whole(parts) {
  const said = parts.map(german);
  return language === "de" && said.every(one => one !== null) ? said : parts;
}
// The texts that stand in the page itself, in the language that is told; what the program writes is said where it is written.
let translated = "en";
function translate() {
  document.documentElement.lang = language;
  if (language === translated) return;
  translated = language;
  const walk = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walk.nextNode()) {
    const node = walk.currentNode;
    node.english ??= node.data.trim();
    if (node.english && german(node.english)) node.data = node.data.replace(node.data.trim(), say(node.english));
  }
  translateUnseen();
}
// The texts that only a screen reader says.
function translateUnseen() {
  for (const one of document.querySelectorAll("[aria-label]")) {
    one.english ??= one.getAttribute("aria-label");
    if (german(one.english)) one.setAttribute("aria-label", say(one.english));
  }
}
function el(id) { return document.getElementById(id); }
function make(tag, text, kind) {
  const one = document.createElement(tag);
  if (text !== undefined) one.textContent = text;
  if (kind) one.className = kind;
  return one;
}
function set(id, text) { const one = el(id); if (one && one.textContent !== text) one.textContent = text; }
function rows(body, lines) {
  body.replaceChildren(...lines.map(cells => {
    const row = make("tr");
    cells.forEach(([text, kind], at) => {
      const cell = make(at ? "td" : "th", text, kind);
      if (!at) cell.scope = "row";
      row.append(cell);
    });
    return row;
  }));
}
// For how long a state has lasted, in the largest unit that tells it.
function lasted(time_s) {
  if (time_s < 60) return `${Math.floor(time_s)} s`;
  if (time_s < 3600) return `${Math.floor(time_s / 60)} min`;
  return time_s < 86400 ? `${Math.floor(time_s / 3600)} h ${Math.floor(time_s % 3600 / 60)} min` : `${Math.floor(time_s / 86400)} d ${Math.floor(time_s % 86400 / 3600)} h`;
}
function ago(age_s) { return language === "de" ? `vor ${aged(age_s)}` : `${aged(age_s)} ago`; }
function aged(age_s) { return age_s === null || age_s === undefined ? "–" : age_s < 100 ? `${figure(age_s, 0)} s` : `${figure(age_s / 60, 0)} min`; }

const SIGNS = { green: "✓", cyan: "?", yellow: "⚠", red: "✗" };
// What the state is, what is wrong, what to do; in the tab as well, and aloud when it changes.
function showState(event) {
  const { status, room, silence } = event, box = el("state");
  set("cart", event.cart);
  set("clock", event.clock.slice(11, 19));
  if (status) delete document.body.dataset.lost; else document.body.dataset.lost = "1";
  if (!status) return showLoss("No answer from the service", silence);
  language = status.language || "en";
  document.documentElement.lang = language;
  box.dataset.lamp = status.lamp; box.dataset.priority = status.acknowledged ? "low" : status.priority;
  el("simulated").hidden = !room.simulated;
  set("state-title", room.headline);
  set("state-named", room.named);
  const draws = el("gestures") && room.gestures.length && !status.fault;
  const what = status.lamp === "green" ? "" : draws ? say("Probe on tissue; make the motions that are drawn") : status.remedy;
  const known = [room.headline, room.named, status.remedy].map(text => text.toLowerCase());
  set("state-text", what);
  set("state-why", known.includes(status.reason.toLowerCase()) ? "" : status.reason);
  const age = status.verification_age_s;
  set("state-facts", [
    `${say("for")} ${lasted(status.since_s)}`,
    age === null ? say("not verified now") : `${say("verified")} ${ago(age)}`,
    room.rests,
    `${say("Contact")} ${say(status.energised ? "closed (safe)" : "OPEN")}`,
    status.latched ? say(status.acknowledged ? "acknowledged" : "not acknowledged") : "",
    sounding(status.audio),
    status.audio.lamp_test ? say("lamp test") : "",
  ].filter(Boolean).join(" · "));
  inTab(SIGNS[status.lamp], [room.named || room.headline, lasted(status.since_s)], event.cart);
  const urgent = status.priority === "high";
  speak([room.headline, room.named, urgent ? what : ""].filter(Boolean).join(". "), urgent);
}
function sounding(audio) {
  const left = audio.left_s === null ? "" : ` ${figure(audio.left_s, 0)} s`;
  return audio.mode === "paused" ? `${say("sound paused")}${left}` : audio.mode === "off" ? say("sound off") : "";
}
function showLoss(title, why) {
  const box = el("state"), cart = el("cart").textContent;
  document.body.dataset.lost = "1";
  box.dataset.lamp = "red"; box.dataset.priority = "high";
  set("state-title", say(title));
  set("state-named", "");
  set("state-text", say("Do not rely on the overlay"));
  set("state-why", say(why));
  set("state-facts", "");
  inTab(SIGNS.red, [say(title)], cart);
  speak(`${say(title)}. ${say("Do not rely on the overlay")}`, true);
}
function inTab(sign, parts, cart) {
  const title = `${sign} ${[...parts, cart].join(" · ")}`;
  if (document.title !== title) document.title = title;
}
// An alarm interrupts what a screen reader says; the rest waits for its end. Each is said once.
let spoken = "";
function speak(text, now) {
  if (text === spoken) return;
  spoken = text;
  set(now ? "spoken-now" : "spoken", text);
  set(now ? "spoken" : "spoken-now", "");
}

// Events come four times a second. What is older than a second is grey with its age; three seconds are a loss.
const OLD_MS = 1000, LOST_MS = 3000;
// The cart's clock and the browser's differ by a constant: an event as prompt as any so far is taken for one without delay.
// Crystals drift by less than 2e-4.
const DRIFT = 2e-4;
const heard = { at_ms: 0, told_ms: 0, apart_ms: Infinity };
function hear(told_s) {
  const now_ms = performance.now(), told_ms = 1000 * told_s;
  if (told_ms < heard.told_ms || now_ms - heard.at_ms > LOST_MS) heard.apart_ms = Infinity;  // the cart started anew, or slept
  heard.apart_ms = Math.min(heard.apart_ms + DRIFT * (now_ms - heard.at_ms), now_ms - told_ms);
  heard.at_ms = now_ms;
  heard.told_ms = told_ms;
}
// The age of what the cart told at a time of its clock.
function age_ms(told_ms) { return Number.isFinite(heard.apart_ms) ? performance.now() - heard.apart_ms - told_ms : 0; }
function asOf(old_ms) { return `${say("As of")} ${ago(Math.floor(old_ms / 1000))}`; }
// What is old is neither good nor bad; an alarm stays red until it is known to have ended.
function showAge(old_ms) {
  const old = old_ms > OLD_MS;
  document.body.classList.toggle("old", old);
  el("state-old").hidden = !old;
  if (!old) return;
  set("state-old", asOf(old_ms));
  inTab("…", [asOf(old_ms)], el("cart").textContent);
}
function listen(show) {
  let source = null;
  function connect() {
    if (source) source.close();
    source = new EventSource("/events");
    source.onmessage = message => {
      const event = JSON.parse(message.data);
      hear(event.told_s);
      const old_ms = age_ms(heard.told_ms);
      if (old_ms > LOST_MS) return;  // a slow network hands out what was said long ago
      show(event);
      showAge(old_ms);
    };
  }
  listen.again = connect;
  connect();
  heard.at_ms = performance.now();
  let tried_ms = heard.at_ms;
  setInterval(() => {
    const now_ms = performance.now(), silent_ms = now_ms - heard.at_ms, old_ms = Math.max(silent_ms, age_ms(heard.told_ms));
    showAge(old_ms > LOST_MS ? 0 : old_ms);
    if (old_ms > LOST_MS) showLoss("This page has lost its cart", "reconnecting");
    if (silent_ms > LOST_MS && now_ms - tried_ms > LOST_MS) { tried_ms = now_ms; connect(); }
  }, 250);
}

function refused(text) {
  el("refused").hidden = !text;
  set("refused", text);
}
// where: what. remedy, as the program puts them together.
function refusal(parts, error) {
  const [where, what, remedy] = parts.length === 3 ? parts : ["", ...parts];
  return parts.length > 3 ? error : `${where && `${where}: `}${what}${remedy ? `. ${remedy}` : ""}`;
}
async function post(path, body) {
  refused("");
  try {
    const answer = await fetch(path, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body || {}) });
    const said = await answer.json();
    if (!said.ok && !said.ask) refused(said.parts ? refusal(whole(said.parts), said.error) : say(said.error));
    return said;
  } catch (error) {
    refused(say("The page does not answer. Try again."));
    return { ok: false };
  }
}

// One request at a time, each for a picture newer than the last: a slow tablet sees fewer, and nothing piles up.
async function follow(canvas, why, drawn) {
  let number = 0, taken_ms = null;
  const context = canvas.getContext("2d");
  function none() { taken_ms = null; tell("No picture"); }
  function tell(text) { why.textContent = say(text); why.hidden = !text; canvas.classList.toggle("old", Boolean(text)); }
  setInterval(() => { if (taken_ms !== null && age_ms(taken_ms) > OLD_MS) tell(asOf(age_ms(taken_ms))); }, 250);
  for (;;) {
    if (document.hidden) { await new Promise(done => setTimeout(done, 500)); continue; }
    try {
      const answer = await fetch(`/picture?after=${number}`, { cache: "no-store" });
      if (answer.status === 200) {
        number = Number(answer.headers.get("X-Number"));
        const bitmap = await createImageBitmap(await answer.blob());
        if (canvas.width !== bitmap.width || canvas.height !== bitmap.height) {
          canvas.width = bitmap.width; canvas.height = bitmap.height;
        }
        context.drawImage(bitmap, 0, 0);
        bitmap.close();
        taken_ms = 1000 * Number(answer.headers.get("X-Taken-S"));
        tell(age_ms(taken_ms) > OLD_MS ? asOf(age_ms(taken_ms)) : "");
        if (drawn) drawn(context, canvas, JSON.parse(answer.headers.get("X-Look")));
        continue;
      }
      number = 0;
      none();
      if (answer.status !== 204) await new Promise(done => setTimeout(done, 1000));
    } catch (error) {
      none();
      await new Promise(done => setTimeout(done, 1000));
    }
  }
}

// A tablet that sleeps shows no alarm. Browsers grant it on a visible page of this computer or over TLS.
async function stayAwake() {
  if (!navigator.wakeLock) return;
  const ask = async () => {
    try { if (!document.hidden) await navigator.wakeLock.request("screen"); } catch (error) { /* low battery */ }
  };
  document.addEventListener("visibilitychange", ask);
  await ask();
}
