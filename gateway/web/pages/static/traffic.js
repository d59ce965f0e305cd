// The table of the traffic as it goes on: new transactions come in above, and a row opens to its frames.
import { bytesOf, requestInWords } from "./frames.js";
import { clock, detailOf, element, itemOf, resultOf, stateOf, titleOf, wireOf } from "./transactions.js";
import { ms } from "./quantities.js";
import { _, ngettext } from "./texts.js";

const ROWS = 500; // of the table
const PER_SECOND = 100; // records that the gateway sends at most; it counts the others
const SHOW_EVERY = 250; // milliseconds

const table = document.querySelector("table.traffic"), body = table.tBodies[0], controls = document.querySelector("[data-live]");
const lines = new Map(Object.entries(JSON.parse(table.dataset.lines)).map(([name, [mode, baud, format]]) => [name, wireOf({ mode, baud, format })]));
const NO_LINE = { mode: "tcp", baud: 0, bits: 0 };
const items = new WeakMap();
let waiting = []; // facts that are not in the table yet, the newest last
let isPaused = false, isConnected = true, received = 0, leftOut = 0, missed = 0;

const lineOf = (fact) => lines.get(fact.line) ?? NO_LINE;

function rowOf(fact) {
  const item = itemOf(fact, lineOf(fact)), row = element("tr"), state = element("td"), cell = element("td"), details = element("details");
  items.set(row, item);
  state.append(stateOf(item));
  const isRequest = item.kind !== "heard" && item.kind !== "port";
  details.append(element("summary", "", isRequest ? requestInWords(bytesOf(fact.request)) : titleOf(item)));
  cell.append(details);
  const unit = fact.unit === undefined ? "" : `${fact.unit} ${fact.name ?? ""}`;
  row.append(
    element("td", "", clock(fact.time, 3)), element("td", "minor", fact.line), element("td", "", unit), cell, state, resultOf(item),
    element("td", "minor", fact.client ?? ""), ...[fact.wait_ms, item.took].map((time) => element("td", "number minor", time === undefined ? "–" : ms(time))),
  );
  return row;
}

/** Fill in what a row opens to, when it is opened. Whoever looks at one does not want it to move away. */
function opened(event) {
  const details = event.target, row = details.closest("tr");
  if (!details.open || !row) return;
  if (!items.has(row)) {
    const fact = JSON.parse(row.dataset.fact);
    items.set(row, itemOf(fact, lineOf(fact)));
  }
  const item = items.get(row), told = element("div", "told");
  told.append(...detailOf(item, lineOf(item.fact)).slice(1)); // the row says the rest
  details.replaceChildren(details.querySelector("summary"), told);
  pause(true);
}

const button = element("button", "", _("Pause")), summary = element("output");
button.type = "button";
button.addEventListener("click", () => pause(!isPaused));
controls.prepend(button, summary);

function pause(isWanted) {
  isPaused = isWanted;
  button.textContent = isPaused ? _("Live") : _("Pause");
  controls.classList.toggle("paused", isPaused);
  if (!isPaused) for (const details of body.querySelectorAll("details[open]")) details.open = false;
  show();
}

function show() {
  if (isPaused || !waiting.length) return;
  const rows = waiting.map(rowOf).reverse();
  waiting = [];
  body.prepend(...rows);
  while (body.rows.length > ROWS) body.lastElementChild.remove();
  document.querySelector("p.empty")?.remove();
}

function tell() {
  const text = !isConnected ? _("no connection, trying again") : [ngettext("%(count)s record/s", "%(count)s records/s", received + leftOut), leftOut ? _("%(count)s of them not shown", { count: leftOut }) : "", missed ? _("%(count)s missed", { count: missed }) : "", isPaused ? _("paused, %(count)s more since then", { count: waiting.length }) : ""].filter(Boolean).join(" · ");
  if (summary.textContent !== text) summary.textContent = text;
  received = leftOut = missed = 0;
}

let source, newest = 0;

/** What the server has made looks like what comes in. */
for (const row of [...body.rows]) {
  const fact = JSON.parse(row.dataset.fact), made = rowOf(fact);
  newest = Math.max(newest, fact.time);
  made.dataset.fact = row.dataset.fact;
  made.querySelector("details").open = row.querySelector("details").open; // by somebody who was quicker than this module
  row.replaceWith(made);
}

function connect() {
  source?.close();
  if (document.hidden) return;
  const chosen = new URLSearchParams(controls.dataset.live);
  source = new EventSource(`/api/v1/trace?${new URLSearchParams([...chosen, ["seconds", "10"], ["per_second", PER_SECOND], ["points", "true"]])}`);
  let before = newest;
  source.onopen = () => ([isConnected, before] = [true, newest]);
  source.onerror = () => (isConnected = false);
  source.onmessage = ({ data }) => {
    const fact = JSON.parse(data);
    if (fact.kind === "clock") {
      leftOut = fact.left_out;
      return tell();
    }
    if (fact.kind === "missed") return (missed += fact.count);
    if (fact.time <= before) return;
    newest = Math.max(newest, fact.time);
    received++;
    waiting.push(fact);
    if (waiting.length > ROWS) waiting.shift();
  };
}

body.addEventListener("toggle", opened, true);
document.addEventListener("visibilitychange", connect);
document.addEventListener("keydown", (event) => {
  if (event.key !== " " || event.target.closest("input, select, button, summary, a")) return;
  event.preventDefault();
  pause(!isPaused);
});
if (!document.querySelector(".problem")) {
  connect();
  setInterval(show, SHOW_EVERY);
}
