export const TEXTS = {
  time: "Time",
  busy: "Busy",
  failed: "Requests without an answer",
  span: (hours) => (hours > 24 ? `${hours / 24} days` : `${hours} hours`),
  tick: (date, isLong) => (isLong || (!date.getHours() && !date.getMinutes()) ? date.toLocaleDateString("en", { weekday: "short", day: "numeric" }) : date.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" })),
};
