// The page of all values: searches while somebody types, unfolds devices, and keeps the place of what is shown.
import { renewRows } from "./rows.js";

const PAUSE = 250; // milliseconds without a key, before the gateway is asked
const PATIENCE = 10000;
const PLACE = "section[data-keep=values]";
const MOST_OPENED = 100; // by an address
const form = document.querySelector("form[role=search]"), section = document.querySelector(PLACE);

const openOnes = () => [...section.querySelectorAll("details[open]")].map((device) => device.id.replace("device-", ""));
const pointsOf = (device) => [...device.querySelectorAll("tr[data-point]")].map((row) => row.dataset.point).sort().join(); // somebody may have sorted them
const idsOf = (devices) => devices.map((device) => device.id).join();

function renewDevice(shown, fresh) {
  shown.open = fresh.open;
  shown.querySelector("summary .counts").replaceWith(fresh.querySelector("summary .counts"));
  if (pointsOf(shown) === pointsOf(fresh)) renewRows(shown, fresh);
  else shown.querySelector(".rows").replaceWith(fresh.querySelector(".rows"));
}

let opened = openOnes(); // as the gateway has made them
let asked = 0, isAsking = false;

function renew(page) {
  const fresh = page.querySelector(PLACE);
  if (!fresh) return location.reload(); // to the login: the session has ended
  const found = document.querySelector("p.found"), now = page.querySelector("p.found");
  if (found.innerHTML !== now.innerHTML) found.replaceChildren(...now.childNodes);
  const devices = [...fresh.children], there = [...section.children];
  if (idsOf(devices) === idsOf(there)) there.forEach((each, at) => renewDevice(each, devices[at]));
  else section.replaceChildren(...devices);
  opened = openOnes();
}

/** Show what the address asks for, after `choose` has changed it. */
async function show(choose) {
  const address = new URL(location.href), number = ++asked;
  choose(address.searchParams);
  history.replaceState(null, "", address);
  isAsking = true;
  try {
    const response = await fetch(address, { signal: AbortSignal.timeout(PATIENCE) });
    if (!response.ok) return location.reload();
    const page = new DOMParser().parseFromString(await response.text(), "text/html");
    if (number === asked) renew(page);
  } catch {
    // page.js says that the gateway cannot be reached
  } finally {
    isAsking = number !== asked;
  }
}

function search() {
  show((chosen) => {
    for (const [name, text] of new FormData(form)) text.trim() ? chosen.set(name, text.trim()) : chosen.delete(name);
    chosen.delete("open");
  });
}

let timer = 0;
form.addEventListener("input", () => {
  clearTimeout(timer);
  timer = setTimeout(search, PAUSE);
});
form.addEventListener("submit", (event) => {
  event.preventDefault();
  clearTimeout(timer);
  search();
});
// The toggle of a device that the gateway has made open comes, too.
section.addEventListener("toggle", () => {
  const now = openOnes();
  if (now.join() === opened.join()) return;
  opened = now;
  show((chosen) => chosen.set("open", now.slice(-MOST_OPENED)));
}, true);
document.addEventListener("renewed", (event) => {
  if (!isAsking && getSelection().isCollapsed) renew(event.detail);
});
