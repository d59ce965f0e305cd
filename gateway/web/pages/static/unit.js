// The page of a unit: reads its points when somebody wants that, and shows values without leaving the page.
import { renewRows } from "./rows.js";
import { _ } from "./texts.js";

const PATIENCE = 60000; // milliseconds
const points = document.querySelector("form[data-read-points]");
const values = document.querySelector("form[data-read-values]");

const parsed = (text) => new DOMParser().parseFromString(text, "text/html");

async function ask(address, options) {
  const response = await fetch(address, { ...options, headers: { Accept: "text/html" }, signal: AbortSignal.timeout(PATIENCE) });
  const page = parsed(await response.text());
  if (!response.ok) throw new Error(page.querySelector("[role=alert]")?.textContent ?? response.statusText);
  return page;
}

function renewPoints(page) {
  renewRows(document, page);
  const state = document.querySelector("[data-read-state]"), next = page.querySelector("[data-read-state]");
  if (state && next) state.textContent = next.textContent;
}

let isReading = false, isFirst = true;

async function readPoints() {
  if (isReading || document.hidden) return;
  isReading = true;
  const state = points.querySelector("[data-read-state]");
  try {
    const page = await ask(points.action, { method: "POST" });
    renewPoints(page);
    if (isFirst) for (const list of page.querySelectorAll("#points ~ details[open]")) document.getElementById(list.id)?.setAttribute("open", "");
    isFirst = false;
  } catch (error) {
    state.textContent = `${_("Not read")}: ${error.message}`;
  } finally {
    isReading = false;
  }
}

if (points) {
  points.addEventListener("submit", (event) => {
    event.preventDefault();
    points.querySelector("[data-read-state]").textContent = _("Reading …");
    readPoints();
  });
  const every = points.querySelector("select[data-every]");
  let timer = 0;
  every.closest("label").hidden = false;
  every.addEventListener("change", () => {
    clearInterval(timer);
    timer = Number(every.value) ? setInterval(readPoints, 1000 * every.value) : 0;
    if (timer) readPoints();
  });
}

document.addEventListener("renewed", (event) => renewPoints(event.detail));

values?.addEventListener("submit", async (event) => {
  event.preventDefault();
  const result = document.querySelector("[data-result]");
  result.textContent = _("Reading …");
  try {
    const page = await ask(`${values.action}?${new URLSearchParams(new FormData(values))}`);
    result.replaceChildren(...page.querySelector("[data-result]").childNodes);
  } catch (error) {
    result.textContent = `${_("Not read")}: ${error.message}`;
  }
});
