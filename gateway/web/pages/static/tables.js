// Tables are sorted by their heads, and long ones have a field that finds rows. What was chosen is part of the address,
// and stays when the server makes the page anew.
import { _ } from "./texts.js";

const LONG = 12; // rows
const NOTHING = "–";
const UNITS = { ms: 0.001, s: 1, 秒: 1, min: 60, 分钟: 60, h: 3600, 小时: 3600, d: 86400, 天: 86400 };
const NUMBER = /^[<>]?\s*([-+]?\d+(?:\.\d+)?)\s*(ms|min|s|h|d|秒|分钟|小时|天)?(?![\w.:])/;
const main = document.querySelector("main");
const collator = new Intl.Collator(document.documentElement.lang, { numeric: true });
const shows = new WeakMap(); // by table: what puts its rows in order
const plain = new WeakMap(); // by body: its rows as the server has them

const chosen = (kind, key) => new URLSearchParams(location.search).get(`${kind}.${key}`) ?? "";

function choose(kind, key, value) {
  const address = new URL(location.href);
  if (value) address.searchParams.set(`${kind}.${key}`, value);
  else address.searchParams.delete(`${kind}.${key}`);
  history.replaceState(history.state, "", address);
}

/** What a table is called in the address: as its section, with a number from the second one on. */
function keyOf(table) {
  const section = table.closest("section"), name = section?.getAttribute("aria-labelledby") ?? "table";
  const at = section ? [...section.querySelectorAll("table")].indexOf(table) : 0;
  return at ? `${name}${at + 1}` : name;
}

const textOf = (row, column) => row.cells[column]?.innerText.trim() ?? "";

function numberOf(text) {
  const found = NUMBER.exec(text);
  return found ? Number(found[1]) * (UNITS[found[2]] ?? 1) : undefined;
}

/** Whether a column has numbers: all else in it is one word, such as `never`. */
function hasNumbers(rows, column) {
  const texts = rows.map((row) => textOf(row, column));
  const others = new Set(texts.filter((text) => text !== NOTHING && numberOf(text) === undefined));
  return others.size <= 1 && texts.some((text) => numberOf(text) !== undefined);
}

/** The rows in the order of a column; those without a number come last, whichever way. */
function sorted(rows, column, isDown) {
  const sign = isDown ? -1 : 1;
  if (!hasNumbers(rows, column)) return rows.toSorted((one, other) => sign * collator.compare(textOf(one, column), textOf(other, column)));
  const numbers = new Map(rows.map((row) => [row, numberOf(textOf(row, column))]));
  return rows.toSorted((one, other) => {
    const [a, b] = [numbers.get(one), numbers.get(other)];
    return a === undefined || b === undefined ? (a === undefined) - (b === undefined) : sign * (a - b);
  });
}

/** Make the heads of a table, and the field above it; return what puts its rows in order. */
function adopt(table) {
  const body = table.tBodies[0], heads = [...(table.tHead?.rows[0]?.cells ?? [])];
  if (!heads.length || table.tBodies.length !== 1 || table.matches(".traffic, [data-trace], .grid") || table.querySelector("[scope=rowgroup]")) return () => {};
  const key = keyOf(table), isLong = body.rows.length >= LONG && !main.querySelector("input[type=search]:not([data-find])");
  const sort = body.rows.length > 1 ? letSort(table, heads, key) : () => {}, find = isLong ? letFind(table, key) : () => {};
  return () => (sort(), find());
}

function letSort(table, heads, key) {
  const show = () => {
    const [, direction, column] = /^(-?)(\d+)$/.exec(chosen("sort", key)) ?? [];
    heads.forEach((head, at) => (at === Number(column) ? head.setAttribute("aria-sort", direction ? "descending" : "ascending") : head.removeAttribute("aria-sort")));
    const body = table.tBodies[0], rows = plain.get(body);
    if (heads[column]) body.append(...sorted(rows, Number(column), Boolean(direction)));
    else if (rows.some((row, at) => row !== body.rows[at])) body.append(...rows);
  };
  heads.forEach((head, column) => {
    if (head.matches(".map") || !head.innerText.trim()) return;
    const button = document.createElement("button");
    button.type = "button";
    button.className = "sort";
    button.append(...head.childNodes);
    head.append(button);
    button.addEventListener("click", () => {
      // Of numbers the largest first, then the smallest first, then as the server has them; of words the other way.
      const order = hasNumbers([...table.tBodies[0].rows], column) ? [`-${column}`, `${column}`] : [`${column}`, `-${column}`];
      choose("sort", key, order[order.indexOf(chosen("sort", key)) + 1] ?? "");
      show();
    });
  });
  return show;
}

function letFind(table, key) {
  const input = document.createElement("input"), count = document.createElement("output"), line = document.createElement("p");
  Object.assign(input, { type: "search", placeholder: _("Find rows"), value: chosen("find", key), autocomplete: "off", spellcheck: false });
  input.setAttribute("aria-label", _("Find rows"));
  input.dataset.find = key;
  line.className = "find";
  line.append(input, count);
  table.before(line);
  const show = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean), rows = [...table.tBodies[0].rows];
    for (const row of rows) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
    count.textContent = words.length ? " " + _("%(count)s of %(total)s", { count: rows.filter((row) => !row.hidden).length, total: rows.length }) : "";
  };
  input.addEventListener("input", () => {
    choose("find", key, input.value.trim());
    show();
  });
  return show;
}

/** The server makes tables anew, or only their rows while somebody is at the head or the field. */
function look() {
  for (const table of main.querySelectorAll("table")) {
    const body = table.tBodies[0];
    if (!body || plain.has(body)) continue;
    plain.set(body, [...body.rows]);
    if (!shows.has(table)) shows.set(table, adopt(table));
    shows.get(table)();
  }
}

new MutationObserver(look).observe(main, { childList: true, subtree: true });
look();
