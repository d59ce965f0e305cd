// Keeps the grid of an image fresh, and marks what has changed.
const EVERY = 1000; // milliseconds
const MARKED = 2500;
const grid = document.querySelector("table[data-grid]");
const section = document.querySelector("[data-keep=grid]");

const shown = ({ text }) => text || "–";

function show(cell, value) {
  const text = shown(value);
  cell.classList.toggle("old", value.state === "stale");
  cell.classList.toggle("unknown", value.state === "unknown" || value.state === "invalid");
  if (value.writer) cell.title = [cell.dataset.names, value.writer].filter(Boolean).join(" · ");
  if (cell.textContent === text) return;
  cell.textContent = text;
  cell.classList.add("changed");
  clearTimeout(cell.mark);
  cell.mark = setTimeout(() => cell.classList.remove("changed"), MARKED);
}

async function refresh() {
  if (document.hidden) return;
  try {
    const response = await fetch(grid.dataset.grid, { signal: AbortSignal.timeout(5 * EVERY) });
    if (!response.ok) throw new Error(response.status);
    const cells = new Map([...grid.querySelectorAll("td[data-at]")].map((cell) => [cell.dataset.at, cell]));
    for (const value of (await response.json()).values) if (cells.has(`${value.address}`)) show(cells.get(`${value.address}`), value);
    section.classList.remove("stale");
  } catch {
    section.classList.add("stale");
  }
}

// Where the values come from: they are renewed, and what somebody types beside them stays.
document.addEventListener("renewed", ({ detail: page }) => {
  const fresh = new Map([...page.querySelectorAll("tr[data-line]")].map((row) => [row.dataset.line, row]));
  const rows = document.querySelectorAll("tr[data-line]");
  if (rows.length !== fresh.size) return location.reload(); // the config has changed
  for (const row of rows) {
    for (const cell of ["td.value", "td.age", "td.state-of"]) {
      const shown = row.querySelector(cell), next = fresh.get(row.dataset.line)?.querySelector(cell);
      if (next && shown.innerHTML !== next.innerHTML) shown.replaceWith(next);
    }
  }
});

// One after the other: a slow answer delays the next question.
async function keepFresh() {
  await refresh();
  setTimeout(keepFresh, EVERY);
}

if (grid) keepFresh();
