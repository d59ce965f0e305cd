// Draws the busy share of a line with uPlot, over a day or a week; without it the server's own picture stays.
import { axis, colour, ticks, timeOf } from "./plots.js";
import { percent } from "./quantities.js";
import { _, ngettext } from "./texts.js";

const EVERY = 60000; // milliseconds
const SPANS = [24, 168]; // hours

async function fetched(line, hours) {
  const response = await fetch(`/api/v1/lines/${encodeURIComponent(line)}/history?hours=${hours}`, { redirect: "error" });
  if (!response.ok) throw new Error(response.status);
  const { step_s: step, slots } = await response.json();
  const known = new Map(slots.map((slot) => [Date.parse(slot.time) / 1000, slot]));
  const last = Math.floor(Date.now() / 1000 / step) * step;
  // The axis begins where the server's begins, as long as the gateway is new.
  const oldest = Math.min(last, ...known.keys()), shown = [1, 3, 6, 12, 24].find((each) => oldest > last - each * 3600) ?? hours;
  const length = (Math.min(hours, shown) * 3600) / step;
  // The end of the last slot is a place, too: a step ends at the next one.
  const times = Array.from({ length: length + 1 }, (_each, place) => last - step * (length - place - 1));
  const column = (value) => times.map((time) => known.get(Math.min(time, last))).map((slot) => (slot ? value(slot) : null));
  return [times, column((slot) => slot.busy_share), column((slot) => (slot.sent ? slot.failed / slot.sent : 0))];
}

class Busy {
  constructor(figure) {
    this.figure = figure;
    this.hours = SPANS[0];
    this.plot = undefined;
    const bar = document.createElement("div");
    bar.className = "controls";
    this.buttons = SPANS.map((hours) => {
      const button = document.createElement("button");
      button.type = "button";
      button.textContent = hours > 24 ? ngettext("%(count)s day", "%(count)s days", hours / 24) : ngettext("%(count)s hour", "%(count)s hours", hours);
      button.addEventListener("click", () => this.show(hours));
      bar.append(button);
      return button;
    });
    this.bar = bar;
    this.sizes = new ResizeObserver(() => this.plot?.setSize(this.size()));
  }

  size() {
    return { width: Math.floor(this.figure.clientWidth), height: 220 };
  }

  async show(hours) {
    let data;
    try {
      data = await fetched(this.figure.dataset.busy, hours);
    } catch {
      return; // what is shown stays
    }
    this.hours = hours;
    this.buttons.forEach((button, at) => button.setAttribute("aria-pressed", String(SPANS[at] === hours)));
    if (this.plot) return this.plot.setData(data);
    this.figure.prepend(this.bar);
    const place = this.figure.querySelector(".plot");
    place.replaceChildren();
    this.plot = new uPlot(this.options(), data, place);
    this.sizes.observe(this.figure);
  }

  options() {
    const share = (_plot, value) => (value === null || value === undefined ? "–" : percent(value));
    return {
      ...this.size(),
      cursor: { drag: { x: true, y: false } },
      scales: { y: { range: [0, 1] } },
      axes: [{ ...axis(), values: (_plot, times) => ticks(times, this.hours > 24) }, { ...axis(), values: (_plot, values) => values.map((value) => `${Math.round(100 * value)} %`), size: 56 }],
      series: [
        { label: _("Time"), value: timeOf },
        { label: _("Busy"), stroke: colour("--accent"), width: 1.5, fill: colour("--accent") + "33", paths: uPlot.paths.stepped({ align: 1 }), spanGaps: false, points: { show: false }, value: share },
        { label: _("Requests without an answer"), stroke: colour("--bad"), width: 1.5, dash: [4, 3], paths: uPlot.paths.stepped({ align: 1 }), spanGaps: false, points: { show: false }, value: share },
      ],
    };
  }
}

if (globalThis.uPlot) {
  for (const figure of document.querySelectorAll("figure[data-busy]")) {
    const busy = new Busy(figure);
    busy.show(SPANS[0]);
    setInterval(() => document.hidden || busy.show(busy.hours), EVERY);
  }
}
