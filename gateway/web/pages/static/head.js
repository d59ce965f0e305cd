// Keeps the title, the icon and the facts of the head fresh, and lets the gateway's clock go on between two looks at it.
import { _ } from "./texts.js";

const APART = 5; // seconds by which the clocks of gateway and browser may differ unsaid
const difference = document.createElement("span"); // between them, if it is large
difference.className = "apart";
let ahead = 0, zone = 0; // of the gateway: milliseconds before our clock, and before UTC

/** Read the gateway's clock in a page that was received at this time of ours. */
function read(received) {
  const clock = document.querySelector("[data-clock]");
  if (!clock) return;
  const { dateTime } = clock, [, sign, hours, minutes] = dateTime.match(/([+-])(\d\d):(\d\d)/);
  ahead = Date.parse(dateTime) - received;
  zone = (sign + 1) * (60 * hours + Number(minutes)) * 60000;
  const seconds = Math.abs(ahead) / 1000;
  const time = seconds < 120 ? `${seconds.toFixed(0)} s` : seconds < 7200 ? `${(seconds / 60).toFixed(0)} min` : `${(seconds / 3600).toFixed(0)} h`;
  const apart = ahead > 0 ? _("%(time)s ahead of your clock", { time }) : _("%(time)s behind your clock", { time });
  difference.textContent = seconds > APART ? ` · ${apart}` : "";
  clock.after(difference);
}

function tick() {
  const clock = document.querySelector("[data-clock]");
  if (clock) clock.textContent = new Date(Date.now() + ahead + zone).toISOString().slice(11, 19) + clock.textContent.slice(8);
}

read(performance.timeOrigin + (performance.getEntriesByType("navigation")[0]?.responseStart ?? 0));
setInterval(tick, 1000);
document.addEventListener("renewed", ({ detail: page }) => {
  document.title = page.title;
  const icon = "link[rel=icon]", fresh = page.querySelector(icon);
  if (fresh.getAttribute("href") !== document.querySelector(icon).getAttribute("href")) document.querySelector(icon).replaceWith(fresh);
  const facts = page.querySelector("[data-facts]");
  if (facts) document.querySelector("[data-facts]")?.replaceWith(facts);
  read(Date.now());
});
