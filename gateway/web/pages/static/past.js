// A line in the last hour or day, in the place of its strip: the server draws it, and this tells the numbers of a column.
import { failuresInWords, requestsInWords } from "./counts.js";
import { element } from "./transactions.js";
import { hour, ms, percent } from "./quantities.js";
import { _ } from "./texts.js";

const EVERY = { "1h": 10000, "24h": 60000 }; // milliseconds

export const LONG_SPANS = new Map([[3600, "1h"], [86400, "24h"]]); // seconds, and what the address calls them

export class Past {
  constructor(figure, detail) {
    this.figure = figure;
    this.detail = detail;
    this.part = this.span = this.place = undefined;
    // While somebody looks at a column, the picture stays.
    setInterval(() => this.span && !document.hidden && this.place === undefined && Date.now() - this.shownAt >= EVERY[this.span] && this.show(this.span), 1000);
  }

  /** Show this span, or none of them. */
  async show(span) {
    if (span !== this.span) this.place = undefined;
    this.span = span;
    this.shownAt = Date.now();
    const address = new URL(location.href);
    if (span) address.searchParams.set("span", span);
    else address.searchParams.delete("span");
    history.replaceState(history.state, "", address);
    if (!span) return this.take(undefined);
    try {
      const response = await fetch(address, { redirect: "error" });
      if (!response.ok) throw new Error(response.status);
      const page = new DOMParser().parseFromString(await response.text(), "text/html");
      if (span === this.span) this.take(page.querySelector("[data-past]"));
    } catch {
      // what is shown stays
    }
  }

  take(part) {
    this.part?.remove();
    this.part = part ?? undefined;
    if (!part) return;
    this.told = JSON.parse(part.dataset.past);
    this.figure.querySelector(".plot > .controls").after(part);
    for (const picture of part.querySelectorAll("svg.map")) picture.addEventListener("pointermove", ({ clientX }) => this.tell(placeAt(picture, clientX)));
    part.addEventListener("pointerleave", () => this.tell(undefined));
    this.tell(this.place);
  }

  /** Go to another column: to the last one if there is none yet. */
  step(by) {
    if (!this.part) return;
    const [first, last] = ends(this.part.querySelector("svg.map"));
    this.tell(this.place === undefined ? last : Math.max(first, Math.min(last, this.place + by)));
  }

  tell(place) {
    this.place = place;
    this.part?.querySelectorAll(".mark").forEach((each) => each.remove());
    if (place === undefined || !this.part) return this.detail.replaceChildren(element("p", "hint", _("Point at a column, or use ← and →, to see its numbers.")));
    for (const picture of this.part.querySelectorAll("svg.map")) {
      const mark = document.createElementNS("http://www.w3.org/2000/svg", "rect");
      for (const [name, value] of Object.entries({ class: "mark", x: place, y: 0, width: 1, height: picture.viewBox.baseVal.height })) mark.setAttribute(name, value);
      picture.append(mark);
    }
    const { first, step, line, units } = this.told;
    const head = element("p", "what");
    head.append(element("strong", "", `${hour((first + place) * step)}–${hour((first + place + 1) * step)}`), element("span", "", lineInWords(line[place])));
    const asked = Object.entries(units).filter(([, told]) => told[place]?.[0]);
    this.detail.replaceChildren(head, ...asked.map(([unit, told]) => element("p", "", `${unit}: ${unitInWords(told[place])}`)));
  }
}

/** The first and the last column of a picture. */
function ends(picture) {
  const { x: first, width } = picture.viewBox.baseVal;
  return [first, first + width - 1];
}

function placeAt(picture, x) {
  const { left, width } = picture.getBoundingClientRect(), [first, last] = ends(picture);
  return Math.max(first, Math.min(last, first + Math.floor(((x - left) / width) * (last - first + 1))));
}

function lineInWords(told) {
  if (!told) return _("the gateway did not run");
  const [busy, sent, failed, clients] = told;
  const who = Object.entries(clients).map(([client, count]) => `${client} (${count})`).join(", ");
  return [_("busy %(share)s", { share: percent(busy) }), requestsInWords(sent), ...failuresInWords(0, failed), who ? _("most of them by %(clients)s", { clients: who }) : ""].filter(Boolean).join(" · ");
}

function unitInWords([requests, timeouts, failed, unsent, exceptions, answer]) {
  const parts = [requestsInWords(requests), ...failuresInWords(timeouts, failed, unsent, exceptions), answer ? _("answer in %(time)s on average", { time: ms(answer) }) : ""];
  return parts.filter(Boolean).join(" · ");
}
