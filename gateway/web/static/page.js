// Keeps the content of a page fresh: the server makes the page anew, and its content replaces what is shown.
const EVERY = 5000; // milliseconds

async function refresh() {
  const main = document.querySelector("main");
  if (document.hidden || main.contains(document.activeElement)) return;
  try {
    const response = await fetch(location.href, { redirect: "error", signal: AbortSignal.timeout(EVERY) });
    if (!response.ok) throw new Error(response.status);
    const page = new DOMParser().parseFromString(await response.text(), "text/html");
    main.replaceChildren(...page.querySelector("main").childNodes);
    main.classList.remove("stale");
  } catch {
    main.classList.add("stale");
  }
}

if (location.pathname !== "/login") setInterval(refresh, EVERY);
