// Keeps the content of a page fresh: the server makes the page anew, and its content replaces what is shown.
const EVERY = 5000; // milliseconds

// What a script draws stays as it is: it is kept up to date by a stream.
function renew(shown, fresh) {
  for (const kept of shown.querySelectorAll("[data-keep]")) fresh.querySelector(`[data-keep="${kept.dataset.keep}"]`)?.setAttribute("data-old", "");
  for (const open of shown.querySelectorAll("details[open][id]")) fresh.querySelector(`#${CSS.escape(open.id)}`)?.setAttribute("open", "");
  const places = [...fresh.children], there = [...shown.children];
  if (places.length !== there.length) return location.reload();
  places.forEach((place, at) => place.dataset.old === undefined && there[at].replaceWith(place));
}

async function refresh() {
  const main = document.querySelector("main");
  if (document.hidden || main.contains(document.activeElement)) return;
  try {
    const response = await fetch(location.href, { redirect: "error", signal: AbortSignal.timeout(EVERY) });
    if (!response.ok) throw new Error(response.status);
    const page = new DOMParser().parseFromString(await response.text(), "text/html");
    document.dispatchEvent(new CustomEvent("renewed", { detail: page }));
    renew(main, page.querySelector("main"));
    main.classList.remove("stale");
  } catch {
    main.classList.add("stale");
  }
}

// A page that follows by itself, that has asked a unit for something, or asks somebody, stays as it is.
const isLive = [...document.querySelector("main").children].every((part) => part.dataset.keep !== undefined || part.tagName === "H1");
if (location.pathname !== "/login" && !isLive && !document.querySelector("[data-still]")) setInterval(refresh, EVERY);
