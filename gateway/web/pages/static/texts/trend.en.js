export const TEXTS = {
  time: "Time",
  least: "Least",
  mean: "Mean",
  greatest: "Greatest",
  date: (date) => date.toLocaleString("en-GB", { weekday: "short", hour: "2-digit", minute: "2-digit" }),
  tick: (date, isLong) => (isLong || (!date.getHours() && !date.getMinutes()) ? date.toLocaleDateString("en", { weekday: "short", day: "numeric" }) : date.toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" })),
};
