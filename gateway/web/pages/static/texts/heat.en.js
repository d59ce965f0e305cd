const counted = (count, word) => (count ? `${count} ${word}${count === 1 ? "" : "s"}` : "");

export const TEXTS = {
  hint: "Point at a place in the picture to see its numbers; or press ← or → on the name of a unit.",
  gap: "the gateway did not run",
  idle: "not asked",
  requests: (count) => counted(count, "request"),
  timeouts: (count) => counted(count, "time-out"),
  failed: (count) => (count ? `${count} without a valid response` : ""),
  notSent: (count) => (count ? `${count} not sent` : ""),
  exceptions: (count) => counted(count, "exception"),
  answer: (time, share) => `answer in ${time} on average, ${share} of the limit`,
  resting: (seconds) => `rested for ${seconds} s`,
};
