// What a record of the trace tells, in words and with its frames decoded.
import { bytesOf, charactersOf, parts, requestInWords, responseInWords } from "./frames.js";
import { ms } from "./quantities.js";
import { _ } from "./texts.js";

const STATES = {
  ok: _("ok"), exception: _("exception"), timeout: _("time-out"), broken: _("broken frame"), failed: _("no valid response"), late: _("late response"), foreign: _("foreign traffic"),
  noise: _("noise"), refused: _("not sent"), port: _("port"), answered: _("answered"), silent: _("not answered"),
};
const RESULTS = {
  resting: _("the unit rests"), overdue: _("a late response is awaited"), queue_full: _("queue full"), expired: _("waited too long"), line_down: _("line down"), no_route: _("no such unit"), only_heard: _("only heard"),
  denied: _("no right"), unwanted: _("the client has left"), refused: _("refused"), timeout: _("no time left to send it again"), line_lost: _("port lost"),
};
const OWNERS = {
  "another client": _("response to another client"), "a late response": _("late response to an earlier request"), "an echo": _("echo of a request"),
  "another's request": _("request of another client"), nobody: _("not requested by anybody"), noise: _("bytes that are no frame"), "a damaged frame": _("a character of it was damaged"),
};

/** What a line is like: `bits` are those of a character. */
export const wireOf = ({ mode, baud, format }) => ({ mode, baud: Number(baud), bits: format ? 1 + Number(format[0]) + (format[1] === "N" ? 0 : 1) + Number(format[2]) : 0 });

/** What stands in a record of the trace, with the times of its parts in seconds: `begin, left, back, end`. */
export function itemOf(fact, line) {
  const character = line.baud ? line.bits / line.baud : 0;
  const onWire = (hex) => charactersOf(bytesOf(hex).length, line.mode) * character;
  const item = { fact, took: fact.elapsed_ms, unit: fact.unit, kind: fact.kind, received: fact.received ?? fact.time, begin: fact.time, left: fact.time, back: fact.time, end: fact.time };
  if (fact.kind === "exchange") {
    item.begin = fact.sent;
    item.left = Math.max(fact.sent, fact.time - fact.elapsed_ms / 1000);
    item.back = fact.response ? Math.max(item.left, fact.time - onWire(fact.response)) : fact.time;
    item.state = fact.result ? (fact.heard ? "broken" : fact.result === "timeout" ? "timeout" : "failed") : fact.sent_again ? (fact.heard ? "broken" : "timeout") : fact.response?.[0] >= "8" ? "exception" : "ok";
  } else if (fact.kind === "answered") {
    item.begin = fact.received - onWire(fact.request);
    item.left = fact.received;
    item.back = fact.time;
    item.end = fact.time + (fact.response ? onWire(fact.response) : 0);
    item.received = item.begin;
    item.took = 1000 * (item.back - item.left);
    item.state = !fact.response ? "silent" : fact.response[0] >= "8" ? "exception" : "answered";
  } else if (fact.kind === "heard") {
    item.unit = undefined;
    item.begin = item.left = item.back = fact.time - (fact.owner === "noise" ? Math.max(1, fact.count) : bytesOf(fact.frame).length + 2) * (line.mode === "ascii" ? 2 : 1) * character;
    item.state = { noise: "noise", "a damaged frame": "broken", "a late response": "late" }[fact.owner] ?? "foreign";
  } else {
    item.state = fact.kind;
  }
  return item;
}

export const FAILED = new Set(["timeout", "failed", "broken"]);

export function titleOf(item) {
  const { fact } = item;
  if (item.kind === "port") return fact.reason ? _("port lost: %(reason)s", { reason: fact.reason }) : _("port open");
  if (item.kind === "heard") return STATES[item.state] + (item.state === "noise" || !fact.frame ? "" : ": " + _("address %(address)s on the wire", { address: bytesOf(fact.frame)[0] }));
  return `${named(fact.unit, fact.name)}: ${requestInWords(bytesOf(fact.request))}`;
}

/** What it was called, in colour and word. */
export function stateOf({ state }) {
  const kind = FAILED.has(state) || state === "refused" ? "down" : state === "ok" || state === "answered" ? "up" : "failing";
  return element("span", "state " + kind, STATES[state]);
}

/** The name of a unit, with its number. */
export const named = (unit, name) => (name ? `${unit} ${name}` : _("unit %(unit)s", { unit }));

/** What came of it. */
export function outcomeOf({ kind, fact }) {
  if (kind !== "exchange" && kind !== "answered") return OWNERS[fact.owner] ?? (fact.reason || (RESULTS[fact.result] ?? fact.result) || "");
  if (fact.response) return responseInWords(bytesOf(fact.response), bytesOf(fact.request));
  return fact.reason || "–"; // the state says the rest
}

/** What the first points of it are, as the gateway says. */
export function meaningOf({ fact }) {
  const told = (fact.points ?? []).map(({ point, text }) => `${point} ${text}`).join(", ");
  return fact.more_points ? told + ", " + _("%(count)s more", { count: fact.more_points }) : told;
}

/** A cell with the meaning of it and what came of it. */
export function resultOf(item) {
  const cell = element("td"), meaning = meaningOf(item), outcome = outcomeOf(item);
  if (meaning) cell.append(element("b", "", meaning), outcome && " · ");
  cell.append(outcome);
  return cell;
}

/** All points of it: the record has the first ones, and the gateway tells the others when somebody looks. */
function points(fact) {
  const pieces = (points) => points.map(({ point, text }) => ({ bytes: text, means: point }));
  const made = frame(_("means"), pieces(fact.points));
  if (fact.more_points) {
    const asked = new URLSearchParams({ request: fact.request, response: fact.response ?? "" });
    fetch(`/api/v1/units/${encodeURIComponent(fact.device ?? fact.name)}/meaning?${asked}`, { redirect: "error" })
      .then((response) => (response.ok ? response.json() : Promise.reject(response.status)))
      .then(({ points }) => made.replaceWith(frame(_("means"), pieces(points))))
      .catch(() => {}); // the first ones stay
  }
  return made;
}

/** The parts of a page that tell all of it; `gap` is the silence before, in seconds, if it is known. */
export function detailOf(item, line, gap) {
  const { fact } = item;
  const head = element("p", "what");
  head.append(element("time", "", clock(item.end, 3)), element("strong", "", titleOf(item)));
  if (item.kind !== "port") head.append(stateOf(item));
  const made = [head];
  if (item.kind === "exchange") {
    const between = (from, to) => ms(1000 * (to - from)), asked = { wait: ms(fact.wait_ms), request: between(item.begin, item.left), limit: ms(fact.limit_ms) };
    const times = FAILED.has(item.state)
      ? _("waited %(wait)s · request %(request)s · no valid response for %(lost)s · limit %(limit)s", { ...asked, lost: between(item.left, item.end) })
      : _("waited %(wait)s · request %(request)s · device %(device)s · response %(response)s · limit %(limit)s", { ...asked, device: between(item.left, item.back), response: between(item.back, item.end) });
    const silence = gap !== undefined && gap >= 0 ? " · " + _("%(time)s of silence before", { time: ms(1000 * gap) }) : "";
    made.push(element("p", "times", times + silence), element("p", "quiet", `${fact.device ? fact.device + " · " : ""}${_("asked at address %(address)s for %(client)s", fact)} · ${outcomeOf(item)}`));
    made.push(frame(_("request"), parts(fact.address, bytesOf(fact.request), line.mode, true)));
    if (fact.response) made.push(frame(_("response"), parts(fact.answered_by ?? fact.address, bytesOf(fact.response), line.mode, false)));
    else made.push(frame(_("received"), fact.heard ? [{ bytes: fact.heard, means: STATES.broken }] : [{ bytes: "–", means: _("nothing was received") }]));
  } else if (item.kind === "answered") {
    made.push(element("p", "quiet", outcomeOf(item) + sourcesOf(fact)), frame(_("request"), parts(fact.unit, bytesOf(fact.request), line.mode, true)));
    made.push(frame(_("response"), parts(fact.unit, bytesOf(fact.response), line.mode, false)));
  } else if (item.kind === "heard") {
    const bytes = bytesOf(fact.frame), isRequest = item.fact.owner === "another's request" || item.fact.owner === "an echo";
    made.push(element("p", "quiet", outcomeOf(item)), frame(_("received"), item.state === "noise" ? [{ bytes: fact.frame ?? "", means: STATES.noise }] : parts(bytes[0], bytes.slice(1), line.mode, isRequest)));
  } else if (item.kind === "refused") {
    made.push(element("p", "quiet", `${outcomeOf(item)} · ${fact.client}${sourcesOf(fact)}`));
  }
  if (fact.points) made.push(points(fact));
  return made;
}

/** The devices whose values were asked for, of a virtual unit. */
const sourcesOf = ({ sources }) => (sources ? " · " + _("values of %(sources)s", { sources: sources.join(", ") }) : "");

function frame(label, pieces) {
  const row = element("div", "frame");
  row.append(element("span", "label", label));
  for (const { bytes, means } of pieces) {
    const piece = element("span", "piece");
    piece.append(element("code", "", bytes), element("small", "", means));
    row.append(piece);
  }
  return row;
}

/** The time of the day, with so many digits behind the second. */
export function clock(time, digits) {
  const date = new Date(1000 * time);
  const two = (value) => String(value).padStart(2, "0");
  const part = digits ? "." + String(Math.floor(date.getMilliseconds() + 0.5)).padStart(3, "0").slice(0, digits) : "";
  return `${two(date.getHours())}:${two(date.getMinutes())}:${two(date.getSeconds())}${part}`;
}

export function element(tag, name = "", text = undefined) {
  const made = document.createElement(tag);
  if (name) made.className = name;
  if (text !== undefined) made.textContent = text;
  return made;
}
