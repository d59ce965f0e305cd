// Tells the numbers of the place in a heat map that is pointed at; on the link of a unit, ← and → do the same.
import { failuresInWords, requestsInWords } from "./counts.js";
import { hour, ms, percent } from "./quantities.js";
import { _ } from "./texts.js";

const KEPT = 60000; // milliseconds
const SLOTS = 144; // of a day; a picture shows the last ones of them
const past = new Map(); // what the server has told of a unit, and when
let shown; // the unit and the slot that are told

async function historyOf(unit) {
  const known = past.get(unit);
  if (known && performance.now() - known.at < KEPT) return known.slots;
  const response = await fetch(`/api/v1/units/${encodeURIComponent(unit)}/history`, { redirect: "error" });
  if (!response.ok) throw new Error(response.status);
  const { step_s: step, slots } = await response.json();
  const found = { step, slots: new Map(slots.map((slot) => [Date.parse(slot.time) / 1000 / step, slot])) };
  past.set(unit, { at: performance.now(), slots: found });
  return found;
}

function words(slot) {
  if (!slot) return _("the gateway did not run");
  if (!slot.requests) return _("not asked");
  const answer = slot.answer_ms === null ? "" : _("answer in %(time)s on average, %(share)s of the limit", { time: ms(slot.answer_ms), share: percent(slot.limit_share) });
  const rest = slot.resting_s ? _("rested for %(seconds)s s", { seconds: slot.resting_s.toFixed(0) }) : "";
  return [requestsInWords(slot.requests), ...failuresInWords(slot.timeouts, slot.failed, slot.not_sent, slot.exceptions), answer, rest].filter(Boolean).join(" · ");
}

async function tell(row, place) {
  const unit = row.dataset.unit;
  const reading = row.closest("section").querySelector("[data-reading]");
  shown = { unit, place };
  try {
    const { step, slots } = await historyOf(unit);
    if (shown?.unit !== unit || shown.place !== place) return;
    const number = Math.floor(Date.now() / 1000 / step) - SLOTS + 1 + place;
    reading.textContent = `${unit}, ${hour(number * step)}–${hour((number + 1) * step)}: ${words(slots.get(number))}`;
    mark(row, place);
  } catch {
    reading.textContent = "";
  }
}

function mark(row, place) {
  document.querySelectorAll("svg.map .mark").forEach((each) => each.remove());
  const bar = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  for (const [name, value] of Object.entries({ class: "mark", x: place, y: 0, width: 1, height: 12 })) bar.setAttribute(name, value);
  row.querySelector("svg.map").append(bar);
}

// The server makes the table anew now and then.
function tellAgain() {
  document.querySelectorAll("[data-reading]").forEach((reading) => reading.textContent || (reading.textContent = _("Point at a place in the picture to see its numbers; or press ← or → on the name of a unit.")));
  const row = shown && document.querySelector(`table[data-heat] tr[data-unit="${CSS.escape(shown.unit)}"]`);
  if (row && !row.querySelector(".mark")) tell(row, shown.place);
}

new MutationObserver(tellAgain).observe(document.querySelector("main"), { childList: true });
tellAgain();

document.addEventListener("pointermove", (event) => {
  const picture = event.target.closest?.("table[data-heat] svg.map");
  if (!picture) return;
  const box = picture.getBoundingClientRect();
  const { x: first, width } = picture.viewBox.baseVal;
  const place = Math.min(SLOTS - 1, Math.max(first, first + Math.floor(((event.clientX - box.left) / box.width) * width)));
  const row = picture.closest("tr");
  if (shown?.unit !== row.dataset.unit || shown.place !== place) tell(row, place);
});

document.addEventListener("keydown", (event) => {
  const row = event.target.closest?.("table[data-heat] tr[data-unit]");
  const by = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
  if (!row || !by || event.ctrlKey || event.altKey || event.metaKey) return;
  event.preventDefault();
  const place = shown?.unit === row.dataset.unit ? shown.place + by : SLOTS - 1;
  tell(row, Math.min(SLOTS - 1, Math.max(row.querySelector("svg.map").viewBox.baseVal.x, place)));
});
