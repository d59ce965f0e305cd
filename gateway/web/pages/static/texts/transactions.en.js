import { ms } from "../quantities.js";

export const TEXTS = {
  onTheWire: (address) => `address ${address} on the wire`,
  named: (unit, name) => (name ? `${unit} ${name}` : `unit ${unit}`),
  states: {
    ok: "ok", exception: "exception", timeout: "time-out", broken: "broken frame", failed: "no valid response", late: "late response", foreign: "foreign traffic",
    noise: "noise", refused: "not sent", port: "port", answered: "answered", silent: "not answered",
  },
  results: {
    resting: "the unit rests", overdue: "a late response is awaited", queue_full: "queue full", expired: "waited too long", line_down: "line down", no_route: "no such unit", only_heard: "only heard",
    denied: "no right", unwanted: "the client has left", refused: "refused", timeout: "no time left to send it again", line_lost: "port lost",
  },
  owners: {
    "another client": "response to another client", "a late response": "late response to an earlier request", "an echo": "echo of a request",
    "another's request": "request of another client", nobody: "not requested by anybody", noise: "bytes that are no frame", "a damaged frame": "a character of it was damaged",
  },
  portOpen: "port open",
  portLost: (reason) => `port lost: ${reason}`,
  asked: (address, client) => `asked at address ${address} for ${client}`,
  sources: (sources) => `values of ${sources}`,
  times: (wait, request, think, response, limit) => `waited ${ms(wait)} · request ${ms(request)} · device ${ms(think)} · response ${ms(response)} · limit ${ms(limit)}`,
  timesLost: (wait, request, lost, limit) => `waited ${ms(wait)} · request ${ms(request)} · no valid response for ${ms(lost)} · limit ${ms(limit)}`,
  gap: (gap) => `${ms(gap)} of silence before`,
  more: (count) => `${count} more`,
  pointsFrame: "means",
  requestFrame: "request",
  responseFrame: "response",
  heardFrame: "received",
  noFrame: "nothing was received",
};
