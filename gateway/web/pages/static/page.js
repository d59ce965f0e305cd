// Keeps a page fresh: the server makes it anew, and its content replaces what is shown.
import { _ } from "./texts.js";

const main = document.querySelector("main");
const every = main.querySelector("[data-renew-every]")?.dataset.renewEvery; // of a page that ends what it shows when nobody asks for it
const EVERY = Number(every ?? 5000); // milliseconds
const isKiosk = document.documentElement.classList.contains("kiosk");
const told = document.createElement("p"); // that the gateway cannot be reached
told.className = "unreachable";
told.setAttribute("role", "alert");
let reachedAt = new Date();

async function refresh() {
  if (document.hidden && !every) return;
  try {
    const response = await fetch(location.href, { redirect: "manual", signal: AbortSignal.timeout(Math.max(EVERY, 5000)) });
    if (response.type === "opaqueredirect") return location.reload(); // to the login: the session has ended
    if (!response.ok) throw new Error(response.status);
    const page = new DOMParser().parseFromString(await response.text(), "text/html");
    if (filesOf(page) !== filesOf(document)) return location.reload(); // of another version of the gateway
    document.dispatchEvent(new CustomEvent("renewed", { detail: page }));
    if (!isLive) renew(page.querySelector("main"));
    reachedAt = new Date();
    told.remove();
    main.classList.remove("stale");
  } catch {
    told.textContent = _("The gateway cannot be reached. What is shown is of %(time)s.", { time: reachedAt.toTimeString().slice(0, 8) });
    main.before(told);
    main.classList.add("stale");
  }
}

const filesOf = (page) => [...page.head.querySelectorAll("script[src], link[rel=stylesheet]")].map((file) => file.getAttribute("src") ?? file.getAttribute("href")).join();

/** Replace what the server made, but not where somebody is busy. What a script draws (`data-keep`), it renews itself at the event. */
function renew(fresh) {
  if (!getSelection().isCollapsed) return;
  for (const open of main.querySelectorAll("details[open][id]")) fresh.querySelector(`#${CSS.escape(open.id)}`)?.setAttribute("open", "");
  const places = [...fresh.children], there = [...main.children];
  if (places.length !== there.length) return location.reload();
  const isKept = (part) => part.dataset.keep !== undefined || part.querySelector("[data-keep]") || part.contains(document.activeElement);
  there.forEach((part, at) => {
    if (!isKept(part)) part.replaceWith(places[at]);
    else if (part.contains(document.activeElement) && document.activeElement.matches("[data-find], .sort")) renewRows(part, places[at]);
  });
  letScroll();
}

/** Where somebody sorts rows, or types which ones to find, only these are made anew. */
function renewRows(part, fresh) {
  const places = fresh.querySelectorAll("tbody"), there = part.querySelectorAll("tbody");
  if (places.length === there.length) there.forEach((body, at) => body.replaceWith(places[at]));
}

/** What is wider than the page can be reached, and so scrolled, by keyboard. */
function letScroll() {
  for (const part of main.querySelectorAll("section")) {
    if (part.scrollWidth > part.clientWidth || part.scrollHeight > part.clientHeight) part.tabIndex = 0;
    else part.removeAttribute("tabindex");
  }
}

function beKiosk() {
  const stayAwake = () => navigator.wakeLock?.request("screen").catch(() => {});
  stayAwake();
  document.addEventListener("visibilitychange", stayAwake);
  document.addEventListener("click", ({ target }) => {
    const link = target.closest("a[href]");
    if (!link || link.origin !== location.origin || link.hasAttribute("download")) return;
    const address = new URL(link.href);
    address.searchParams.set("kiosk", "");
    link.href = address;
  });
}

letScroll();
addEventListener("resize", letScroll);
if (isKiosk) beKiosk();
// A page that follows by itself needs only a fresh head; one that has asked a unit for something, or asks somebody,
// stays as it is.
const isLive = [...main.children].every((part) => part.dataset.keep !== undefined || part.tagName === "H1");
if (location.pathname !== "/login" && !document.querySelector("[data-still]")) {
  setInterval(refresh, isLive ? 6 * EVERY : EVERY);
  document.addEventListener("visibilitychange", refresh);
}
