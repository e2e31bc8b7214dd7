"use strict";
// Shared by both pages: events, the picture, and the words of either language. Nothing is loaded from elsewhere.

// The room's language is the configuration's; before the service has told it, the browser's.
let language = (navigator.language || "en").startsWith("de") ? "de" : "en";
function german(text) {
  if (text in GERMAN) return GERMAN[text];
  for (const [pattern, words] of GERMAN_WITH_NUMBERS) if (pattern.test(text)) return text.replace(pattern, words);
  return null;
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
const englishTitle = document.title;
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
// The texts that only a screen reader says, and the window's title.
function translateUnseen() {
  document.title = say(englishTitle);
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
function aged(age_s) { return age_s === null || age_s === undefined ? "–" : age_s < 100 ? `${age_s.toFixed(0)} s` : `${(age_s / 60).toFixed(0)} min`; }

function showState(status, silence) {
  const box = el("state");
  if (status) delete document.body.dataset.lost; else document.body.dataset.lost = "1";
  if (!status) {
    box.dataset.lamp = "red"; box.dataset.priority = "high";
    set("state-title", say("No answer from the service"));
    set("state-text", `${say("Do not rely on the overlay")} · ${say(silence)}`);
    return;
  }
  language = status.language || "en";
  document.documentElement.lang = language;
  box.dataset.lamp = status.lamp; box.dataset.priority = status.acknowledged ? "low" : status.priority;
  set("state-title", status.text);
  const age = status.verification_age_s;
  const verified = age === null ? say("not verified now") : `${say("verified")}: ${aged(age)}`;
  const what = status.fault ? status.remedy : status.text.includes(status.reason) ? "" : status.reason;
  set("state-text", [what, verified, `${say("Contact")} ${say(status.energised ? "closed (safe)" : "OPEN")}`].filter(Boolean).join(" · "));
}

function lostPage() {
  document.body.dataset.lost = "1";
  const box = el("state");
  box.dataset.lamp = "red"; box.dataset.priority = "high";
  set("state-title", say("This page has lost its cart"));
  set("state-text", `${say("Do not rely on the overlay")} · ${say("reconnecting")}`);
}

// Events come four times a second; three seconds without any are a loss, whatever the browser thinks of the connection.
function listen(show) {
  let heard = 0, source = null;
  function connect() {
    if (source) source.close();
    source = new EventSource("/events");
    source.onmessage = event => { heard = performance.now(); show(JSON.parse(event.data)); };
  }
  connect();
  heard = performance.now();
  let tried = heard;
  setInterval(() => {
    const now = performance.now();
    if (now - heard > 3000) {
      lostPage();
      if (now - tried > 3000) { tried = now; connect(); }
    }
  }, 500);
}

// One request at a time, each for a picture newer than the last: a slow tablet sees fewer, and nothing piles up.
async function follow(canvas, why, drawn) {
  let number = 0;
  const context = canvas.getContext("2d");
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
        why.hidden = true;
        if (drawn) drawn(context, canvas, JSON.parse(answer.headers.get("X-Look")));
        continue;
      }
      number = 0;
      why.textContent = say("No picture");
      why.hidden = false;
      if (answer.status !== 204) await new Promise(done => setTimeout(done, 1000));
    } catch (error) {
      why.textContent = say("No picture");
      why.hidden = false;
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
