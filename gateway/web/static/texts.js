// All texts that scripts show. Another language is another table of these.
const ms = (value) => (value < 10 ? value.toFixed(1) : value.toFixed(0)) + " ms";

export const TEXTS = {
  ms,
  percent: (share) => `${(100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`,
  span: (seconds) => (seconds < 1 ? `${(1000 * seconds).toFixed(0)} ms` : `${Number(seconds.toPrecision(2))} s`),
  lanes: { wait: "waiting", request: "request", response: "response" },
  pause: "Pause",
  resume: "Live",
  paused: "paused",
  reconnecting: "no connection, trying again",
  zoomIn: "Zoom in",
  zoomOut: "Zoom out",
  unit: (unit) => `unit ${unit}`,
  named: (unit, name) => (name ? `${unit} ${name}` : `unit ${unit}`),
  share: { request: "requests", think: "waiting for devices", response: "responses", lost: "no valid response", free: "free" },
  counts: (perSecond, { timeout, failed, broken, foreign }) =>
    [
      `${perSecond.toFixed(perSecond < 10 ? 1 : 0)} requests/s`, plural(timeout, "time-out"), failed ? `${failed} without a valid response` : "",
      plural(broken, "broken frame"), plural(foreign, "foreign frame"),
    ].filter(Boolean).join(" · "),
  states: {
    ok: "ok", exception: "exception", timeout: "time-out", broken: "broken frame", failed: "no valid response", late: "late response", foreign: "foreign traffic",
    noise: "noise", refused: "not sent", port: "port", answered: "answered", silent: "not answered",
  },
  marks: { exception: "exception", timeout: "time-out", broken: "broken frame", foreign: "foreign traffic", late: "late response", refused: "not sent" },
  owners: {
    "another client": "response to another client", "a late response": "late response to an earlier request", "an echo": "echo of a request",
    "another's request": "request of another client", nobody: "nobody has asked for it", noise: "bytes that are no frame", "a damaged frame": "a character of it was damaged",
  },
  portOpen: "port open",
  portLost: (reason) => `port lost: ${reason}`,
  read: (area, span) => `read ${area} ${span}`,
  write: (area, span, value) => `write ${area} ${span} = ${value}`,
  written: "written",
  withheld: "withheld by [[access]]",
  areas: { coils: "coils", discrete: "discrete", input: "input", holding: "holding" },
  functions: {
    1: "read coils", 2: "read discrete", 3: "read holding", 4: "read input", 5: "write coil", 6: "write register", 7: "exception status", 8: "diagnostics",
    11: "event counter", 12: "event log", 15: "write coils", 16: "write registers", 17: "server ID", 20: "read file", 21: "write file", 22: "mask write", 23: "read and write",
    24: "read FIFO", 43: "identification",
  },
  functionNamed: (code) => `function ${code}`,
  exception: (code) => `exception ${code.toString(16).toUpperCase().padStart(2, "0")}${EXCEPTIONS[code] ? ", " + EXCEPTIONS[code] : ""}`,
  address: "address",
  from: (address) => `from ${address}`,
  count: (count) => `count ${count}`,
  size: (bytes) => plural(bytes, "byte"),
  data: "data",
  on: "on",
  off: "off",
  more: (shown, count) => `${shown} and ${count} more`,
  asked: (address, client) => `asked at address ${address} for ${client}`,
  times: (wait, request, think, response, limit) => `waited ${ms(wait)} · request ${ms(request)} · device ${ms(think)} · response ${ms(response)} · limit ${ms(limit)}`,
  timesLost: (wait, request, lost, limit) => `waited ${ms(wait)} · request ${ms(request)} · no valid response for ${ms(lost)} · limit ${ms(limit)}`,
  gap: (gap) => `${ms(gap)} of silence before`,
  requestFrame: "request",
  responseFrame: "response",
  heardFrame: "received",
  noFrame: "nothing was received",
  hint: "Point at a transaction, or use ← and →, to see its frames.",
  keys: "Space pauses, + and − zoom, ← and → go from one transaction to the next, drag or swipe moves, End is live again.",
  strip: (line) => `What line ${line} has done in the last seconds`,
  nothing: "nothing on this line yet",
  missed: (count) => `${count} records missed`,
};

const EXCEPTIONS = {
  1: "illegal function", 2: "illegal data address", 3: "illegal data value", 4: "server device failure", 5: "acknowledge", 6: "server device busy",
  8: "memory parity error", 10: "gateway path unavailable", 11: "gateway target device failed to respond",
};

function plural(count, word) {
  return count ? `${count} ${word}${count === 1 ? "" : "s"}` : "";
}
