"use strict";

const CARRIED = ["~", "wait"];
const MARKS = { OK: ["✓", "good"], FAULT: ["✗", "bad"], NOT_VERIFIED: ["?", "wait"] };

function value(check) {
  if (check.value === null) return "–";
  const sigma = check.sigma ? ` ± ${check.sigma.toPrecision(2)}` : "";
  return `${check.value.toPrecision(3)}${sigma} ${check.unit}`.replaceAll(" ", "\u00a0");
}

function showChecks(status) {
  const estimated = status.checks.filter(check => check.shown_age_s !== null || check.max_age_s != null || check.name.startsWith("offset"));
  rows(el("shown"), estimated.map(check => {
    const old = check.verdict === "OK" && check.shown === "missing";
    const [mark, kind] = check.carried ? CARRIED : MARKS[old ? "NOT_VERIFIED" : check.verdict];
    const age = check.carried ? `${aged(check.shown_age_s)} / ${aged(check.max_age_s)}` : aged(check.shown_age_s);
    return [[`${mark} ${check.title}`, kind], [value(check), "number"], [age, "number"]];
  }));
  el("carried").hidden = !estimated.some(check => check.carried);
  set("carried", `~ ${say("Not shown by the present motion; within its age, as no detector saw a change")}`);
  const wanted = status.gesture || [];
  el("gestures").hidden = wanted.length === 0;
  set("gestures", `${say("To show what is missing")}: ${wanted.join("; ")}`);
  el("proposal").hidden = !status.proposal;
  set("proposal", status.proposal ? `→ ${status.proposal.text}` : "");
}

function showDevices(status) {
  const lines = status.devices.map(check => {
    const [mark, kind] = MARKS[check.verdict];
    return [[`${mark} ${check.title}`, kind], [value(check), "number"]];
  });
  const fps = [["video", status.fps.video], ["tracker", status.fps.tracker]].map(([name, rate]) => [[say(name)], [`${rate.toFixed(1)} / s`, "number"]]);
  const lost = Object.entries(status.lost).map(whole).map(([device, what]) => [[`✗ ${device}`, "bad"], [what, "bad"]]);
  const gone = status.recalibration && status.recalibration.ended;
  const notices = [...status.notices, ...(gone ? [whole(["Recalibrate", gone]).join(": ")] : [])].map(text => [[`! ${text}`, "wait"], [""]]);
  rows(el("devices"), [...lost, ...notices, ...fps, ...lines]);
  const reference = status.reference;
  set("reference", reference ? `${say("Calibration in force")}: ${reference.number} · ${reference.file} · ${reference.utc}` : say(status.reference_waits || ""));
}

function showAlarms(alarms) {
  const lines = alarms.entries.map(entry => {
    const line = make("li");
    const time = new Date(entry.utc);
    line.append(make("strong", `${entry.state} `), make("span", `${isNaN(time) ? entry.utc : time.toLocaleString(language)} · ${entry.reason}`, "soft"));
    return line;
  });
  el("alarms").replaceChildren(...(lines.length ? lines : [make("li", say(alarms.trouble || "none"), "soft")]));
}

let told = "";
listen(event => {
  showState(event.status, event.silence);
  translate();
  for (const [id, text] of [["nav-status", "Status"], ["nav-scan", "Recalibrate"], ["picture-title", "Live picture"], ["shown-title", "What motion has shown"], ["devices-title", "Devices"], ["alarms-title", "Last alarms"], ["col-name", "Quantity"], ["col-now", "Now"], ["col-age", "Age"]]) set(id, say(text));
  if (event.status) { showChecks(event.status); showDevices(event.status); }
  const alarms = JSON.stringify(event.alarms) + language;
  if (alarms !== told) { told = alarms; showAlarms(event.alarms); }
});
follow(el("picture"), el("picture-why"));
stayAwake();
