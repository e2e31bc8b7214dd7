"use strict";
// Dark or light before anything is drawn: as the person here chose, else as the computer is set.
const ROOM = "probewatch-room";
function chosenRoom() { try { return localStorage.getItem(ROOM); } catch (error) { return null; } }
function lightRoom() {
  document.documentElement.dataset.room = chosenRoom() || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light");
}
function switchRoom() {
  const wanted = document.documentElement.dataset.room === "dark" ? "light" : "dark";
  document.documentElement.dataset.room = wanted;
  try { localStorage.setItem(ROOM, wanted); } catch (error) { /* for this page alone */ }
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", lightRoom);
lightRoom();
