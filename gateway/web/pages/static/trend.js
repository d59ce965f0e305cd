// Draws the trend of a point with uPlot: a band, and a line of means; without it the server's own picture stays.
import { axis, colour, ticks, timeOf } from "./plots.js";
import { _ } from "./texts.js";

const EVERY = 30000; // milliseconds

async function fetched({ device, point }, hours) {
  const address = `/api/v1/values/${encodeURIComponent(device)}/${encodeURIComponent(point)}/history?since=${hours}%20h`;
  const response = await fetch(address, { redirect: "error" });
  if (!response.ok) throw new Error(response.status);
  const { step_s: step, slots } = await response.json();
  const columns = [[], [], [], []];
  const add = (time, slot) => [time, slot?.max ?? null, slot?.min ?? null, slot?.mean ?? null].forEach((each, at) => columns[at].push(each));
  let before, next;
  const end = () => (add(next - 0.001, before), add(next, null)); // a step is drawn only as far as the next value
  for (const slot of slots) {
    const time = Date.parse(slot.time) / 1000;
    if (next && time > next) end(); // a gap
    add(time, slot);
    [before, next] = [slot, time + step];
  }
  if (next) end();
  const now = Date.now() / 1000;
  return { data: columns, from: now - hours * 3600, to: now };
}

/** Leave some room above and below; a value that does not change is in the middle. */
function around(least, greatest) {
  if (least === null) return [0, 1];
  const room = (greatest - least) * 0.05 || Math.abs(greatest) * 0.01 || 1;
  return [least - room, greatest + room];
}

class Trend {
  constructor(figure) {
    this.figure = figure;
    this.hours = Number(figure.dataset.hours);
    const chosen = figure.parentElement.querySelector("input[name=span]");
    this.links = [...figure.parentElement.querySelectorAll("a[data-hours]")];
    for (const link of this.links)
      link.addEventListener("click", (event) => {
        event.preventDefault();
        history.replaceState(null, "", link.href);
        chosen.value = new URL(link.href).searchParams.get("span"); // which another point keeps
        this.show(Number(link.dataset.hours));
      });
    this.sizes = new ResizeObserver(() => this.plot?.setSize(this.size()));
  }

  size() {
    return { width: Math.floor(this.figure.clientWidth), height: 240 };
  }

  async show(hours) {
    let fresh;
    try {
      fresh = await fetched(this.figure.dataset, hours);
    } catch {
      return; // what is shown stays
    }
    this.hours = hours;
    this.from = fresh.from;
    this.to = fresh.to;
    for (const link of this.links) {
      if (Number(link.dataset.hours) === hours) link.setAttribute("aria-current", "true");
      else link.removeAttribute("aria-current");
    }
    if (this.plot) return this.plot.setData(fresh.data);
    const place = this.figure.querySelector(".plot");
    place.replaceChildren();
    this.plot = new uPlot(this.options(), fresh.data, place);
    this.sizes.observe(this.figure);
  }

  options() {
    const { measure, decimals } = this.figure.dataset;
    const written = (value) => (decimals === undefined ? String(Number(value.toPrecision(7))) : value.toFixed(Number(decimals)));
    const told = (_plot, value) => (value === null || value === undefined ? "–" : `${written(value)} ${measure}`);
    const line = { points: { show: false }, spanGaps: false, paths: uPlot.paths.stepped({ align: 1 }), value: told };
    const edge = { ...line, width: 0, stroke: "transparent" };
    return {
      ...this.size(),
      cursor: { drag: { x: true, y: false } },
      scales: { x: { range: () => [this.from, this.to] }, y: { range: (_plot, least, greatest) => around(least, greatest) } },
      axes: [{ ...axis(), values: (_plot, times) => ticks(times, this.hours > 24) }, { ...axis(), label: measure || undefined, labelSize: 20, labelFont: axis().font, size: 64 }],
      bands: [{ series: [1, 2], fill: `${colour("--accent")}33` }],
      series: [{ label: _("Time"), value: timeOf }, { ...edge, label: _("Greatest") }, { ...edge, label: _("Least") }, { ...line, label: _("Mean"), stroke: colour("--accent"), width: 1.5 }],
    };
  }
}

const figure = document.querySelector("figure.trend");
if (globalThis.uPlot && figure) {
  const trend = new Trend(figure);
  trend.show(trend.hours);
  setInterval(() => document.hidden || trend.show(trend.hours), EVERY);
}
// A choice of a point needs no button.
document.querySelector("#trend select[name=trend]")?.addEventListener("change", ({ target }) => target.form.requestSubmit());
