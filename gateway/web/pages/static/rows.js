// Rows of points: values and ages are renewed; what somebody types beside them stays.
export function renewRows(shown, fresh) {
  const rows = new Map([...fresh.querySelectorAll("tr[data-point]")].map((row) => [row.dataset.point, row]));
  for (const row of shown.querySelectorAll("tr[data-point]")) {
    [...(rows.get(row.dataset.point)?.cells ?? [])].forEach((next, at) => {
      const cell = row.cells[at];
      if (cell.tagName === "TD" && !cell.querySelector("form") && cell.innerHTML !== next.innerHTML) cell.replaceChildren(...next.childNodes);
    });
  }
}
