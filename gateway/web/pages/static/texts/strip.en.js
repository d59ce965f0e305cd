const counted = (count, word) => (count ? `${count} ${word}${count === 1 ? "" : "s"}` : "");

export const TEXTS = {
  lanes: { wait: "waiting", request: "request", response: "response" },
  pause: "Pause",
  resume: "Live",
  reconnecting: "no connection, trying again",
  zoomIn: "Zoom in",
  zoomOut: "Zoom out",
  share: { request: "requests", think: "waiting for devices", response: "responses", lost: "no valid response", free: "free" },
  shareAsked: { request: "requests", think: "waiting for the gateway", response: "responses", free: "silent" },
  counts: (perSecond, others) =>
    [
      perSecond ? `${perSecond} requests/s` : "no requests", counted(others.timeout, "time-out"), others.failed ? `${others.failed} without a valid response` : "",
      counted(others.broken, "broken frame"), others.refused ? `${others.refused} not sent` : "", others.silent ? `${others.silent} not answered` : "",
      counted(others.foreign, "foreign frame"),
    ].filter(Boolean).join(" · "),
  briefCounts: (perSecond, others) =>
    [
      perSecond ? `${perSecond} requests/s` : "no requests", counted(others.timeout, "time-out"), others.failed ? `${others.failed} failed` : "", others.broken ? `${others.broken} broken` : "",
      others.refused ? `${others.refused} not sent` : "", others.silent ? `${others.silent} not answered` : "", others.foreign ? `${others.foreign} foreign` : "",
    ].filter(Boolean).join(" · "),
  marks: { exception: "exception", timeout: "time-out", broken: "broken frame", foreign: "foreign traffic", late: "late response", refused: "not sent" },
  hint: "Point at a transaction, or use ← and →, to see its frames.",
  keys: "Space pauses, + and − zoom, ← and → go from one transaction to the next, drag, swipe, Page Up and Page Down move, End is live again.",
  strip: (line) => `What line ${line} has done in the last seconds`,
};
