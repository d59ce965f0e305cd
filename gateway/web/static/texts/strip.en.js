import { ms } from "../quantities.js";

const counted = (count, word) => (count ? `${count} ${word}${count === 1 ? "" : "s"}` : "");

export const TEXTS = {
  lanes: { wait: "waiting", request: "request", response: "response" },
  pause: "Pause",
  resume: "Live",
  reconnecting: "no connection, trying again",
  zoomIn: "Zoom in",
  zoomOut: "Zoom out",
  unit: (unit) => `unit ${unit}`,
  named: (unit, name) => (name ? `${unit} ${name}` : `unit ${unit}`),
  share: { request: "requests", think: "waiting for devices", response: "responses", lost: "no valid response", free: "free" },
  counts: (perSecond, timeout, failed, broken, foreign) =>
    [
      `${perSecond} requests/s`, counted(timeout, "time-out"), failed ? `${failed} without a valid response` : "",
      counted(broken, "broken frame"), counted(foreign, "foreign frame"),
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
};
