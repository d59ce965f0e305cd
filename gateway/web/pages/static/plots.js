// What the plots of uPlot have in common: colours, axes, and times in the language of the page.
const locale = document.documentElement.lang === "en" ? "en-GB" : document.documentElement.lang;
const TIME = { hour: "2-digit", minute: "2-digit", hourCycle: "h23" };
const clock = new Intl.DateTimeFormat(locale, TIME), day = new Intl.DateTimeFormat(locale, { weekday: "short", day: "numeric" }), moment = new Intl.DateTimeFormat(locale, { weekday: "short", ...TIME });

export const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

export function axis() {
  const grid = { stroke: colour("--grid"), width: 1 };
  return { stroke: colour("--quiet"), grid, ticks: grid, font: "12px system-ui, sans-serif" };
}

/** The time at the cursor. */
export const timeOf = (_plot, seconds) => (seconds ? moment.format(seconds * 1000) : "–");

/** The times at an axis: of a long one, and at midnight, the day. */
export const ticks = (times, isLong) => times.map((seconds) => new Date(seconds * 1000)).map((date) => (isLong || (!date.getHours() && !date.getMinutes()) ? day : clock).format(date));
