const counted = (count, word) => (count ? `${count} ${word}${count === 1 ? "" : "s"}` : "");

export const TEXTS = {
  hint: "Point at a column, or use ← and →, to see its numbers.",
  gap: "the gateway did not run",
  busy: (share) => `busy ${share}`,
  requests: (count) => counted(count, "request"),
  timeouts: (count) => counted(count, "time-out"),
  failed: (count) => (count ? `${count} without a valid response` : ""),
  notSent: (count) => (count ? `${count} not sent` : ""),
  exceptions: (count) => counted(count, "exception"),
  mostly: (clients) => `most of them by ${clients}`,
  answer: (time) => `answer in ${time} on average`,
};
