export const TEXTS = {
  pause: "Pause",
  resume: "Live",
  reconnecting: "no connection, trying again",
  perSecond: (count) => `${count} record${count === 1 ? "" : "s"}/s`,
  leftOut: (count) => `${count} of them not shown`,
  missed: (count) => `${count} missed`,
  waiting: (count) => `paused, ${count} more since then`,
};
