// Tables are sorted by their heads, and long ones have a field that finds rows. What was chosen is part of the address,
// and stays when the server makes the page anew.
import { textsOf } from "./texts.js";

const TEXTS = await textsOf("tables");
const LONG = 12; // rows
const NOTHING = "–";
const UNITS = { ms: 0.001, s: 1, 秒: 1, min: 60, 分钟: 60, h: 3600, 小时: 3600, d: 86400, 天: 86400 };
const NUMBER = /^[<>]?\s*([-+]?\d+(?:\.\d+)?)\s*(ms|min|s|h|d|秒|分钟|小时|天)?(?![\w.:])/;
const main = document.querySelector("main");
const collator = new Intl.Collator(document.documentElement.lang, { numeric: true });
const adopted = new WeakSet();

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

function adopt(table) {
  const body = table.tBodies[0], heads = table.tHead?.rows[0]?.cells;
  if (!heads || table.tBodies.length !== 1 || table.matches(".traffic, [data-trace], .grid") || table.querySelector("[scope=rowgroup]")) return;
  adopted.add(table);
  const key = keyOf(table);
  if (body.rows.length > 1) letSort(body, [...heads], key);
  if (body.rows.length >= LONG && !main.querySelector("input[type=search]:not([data-find])")) letFind(table, body, key);
}

function letSort(body, heads, key) {
  const places = new Map([...body.rows].map((row, at) => [row, at])); // as the server has them
  const show = () => {
    const [, direction, column] = /^(-?)(\d+)$/.exec(chosen("sort", key)) ?? [];
    heads.forEach((head, at) => (at === Number(column) ? head.setAttribute("aria-sort", direction ? "descending" : "ascending") : head.removeAttribute("aria-sort")));
    const rows = [...body.rows];
    body.append(...(heads[column] ? sorted(rows, Number(column), Boolean(direction)) : rows.toSorted((one, other) => places.get(one) - places.get(other))));
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
      const order = hasNumbers([...body.rows], column) ? [`-${column}`, `${column}`] : [`${column}`, `-${column}`];
      const at = order.indexOf(chosen("sort", key));
      choose("sort", key, order[at + 1] ?? "");
      show();
    });
  });
  if (chosen("sort", key)) show();
}

function letFind(table, body, key) {
  const there = table.parentElement.querySelector(`[data-find="${CSS.escape(key)}"]`); // if only its table is new
  const input = there ?? document.createElement("input"), count = there?.nextElementSibling ?? document.createElement("output");
  if (!there) {
    Object.assign(input, { type: "search", placeholder: TEXTS.find, value: chosen("find", key), autocomplete: "off", spellcheck: false });
    input.setAttribute("aria-label", TEXTS.find);
    input.dataset.find = key;
    const line = document.createElement("p");
    line.className = "find";
    line.append(input, count);
    table.before(line);
  }
  const show = () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    const rows = [...body.rows];
    for (const row of rows) row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
    count.textContent = words.length ? TEXTS.found(rows.filter((row) => !row.hidden).length, rows.length) : "";
  };
  input.oninput = () => {
    choose("find", key, input.value.trim());
    show();
  };
  show();
}

const look = () => main.querySelectorAll("table").forEach((table) => adopted.has(table) || adopt(table));
new MutationObserver(look).observe(main, { childList: true, subtree: true });
look();
