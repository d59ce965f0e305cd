// The line strip: what a line did in the last seconds, to scale. Requests stand above the middle, responses below it.
import { FAILED, clock, detailOf, element, itemOf, named, resultOf, stateOf, titleOf, wireOf } from "./transactions.js";
import { ms, percent, seconds } from "./quantities.js";
import { LONG_SPANS, Past } from "./past.js";
import { failuresInWords } from "./counts.js";
import { _, ngettext, pgettext } from "./texts.js";

const LANE_NAMES = { wait: _("waiting"), request: _("request"), response: _("response") };
const SHARES = { request: _("requests"), think: _("waiting for devices"), response: _("responses"), lost: _("no valid response"), free: _("free") };
const SHARES_ASKED = { request: _("requests"), think: _("waiting for the gateway"), response: _("responses"), free: pgettext("line", "silent") };
const MARKS = { exception: _("exception"), timeout: _("time-out"), broken: _("broken frame"), foreign: _("foreign traffic"), late: _("late response"), refused: _("not sent") };
const KEYS = _("Space pauses, + and − zoom, ← and → go from one transaction to the next, drag, swipe, Page Up and Page Down move, End is live again.");

const KEPT = 120; // seconds
const MOST_KEPT = 20000; // transactions of a line
const SILENT = 6000; // milliseconds: the gateway tells its time each second
const BEHIND = 0.4; // seconds: what is shown at the right edge has been told by then
const SPANS = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 60]; // seconds
const QUICK = [10, 60, ...LONG_SPANS.keys()]; // seconds, with a button of their own
const ROWS = 20; // of the table
const NARROW = 640; // pixels: less is a telephone
const PATTERNS = 4; // of the 6 colours in page.css and dark.css, after Okabe and Ito: 12 units differ, neighbours in both
const LANES = {
  full: { height: 224, left: 76, wait: [6, 40], middle: 116, half: 56, axis: 188 },
  compact: { height: 62, left: 0, wait: [2, 12], middle: 36, half: 22, axis: 0 },
};

const isPanel = document.querySelector("[data-panel]") !== null;

/** Lanes of another height. */
const stretched = (lanes, height) => {
  const by = height / lanes.height;
  return { ...lanes, height, wait: lanes.wait.map((y) => y * by), middle: lanes.middle * by, half: lanes.half * by };
};

class Strip {
  constructor(figure) {
    this.figure = figure;
    const { line } = figure.dataset;
    this.line = { name: line, ...wireOf(figure.dataset) };
    this.names = new Map(JSON.parse(figure.dataset.units || "[]"));
    this.order = [...this.names.keys()];
    this.isAsked = figure.dataset.asked !== undefined; // by an outside client: what the line does then is not ours
    this.isFull = !figure.classList.contains("compact");
    this.lanes = this.isFull ? LANES.full : LANES.compact;
    this.items = [];
    this.span = this.isFull && innerWidth < NARROW ? 2 : 10;
    this.right = undefined; // the time at the right edge while paused
    this.pinned = this.pointed = undefined;
    this.canvas = document.createElement("canvas");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", this.isFull ? "application" : "img");
    this.canvas.setAttribute("aria-label", _("What line %(line)s has done in the last seconds", { line }) + (this.isFull ? ". " + KEYS : ""));
    if (!isPanel) this.canvas.style.height = this.lanes.height + "px";
    if (!this.isFull) this.canvas.tabIndex = -1;
    this.pen = this.canvas.getContext("2d");
    this.summary = element("p", "summary");
    figure.querySelector(".plot").replaceChildren(this.canvas);
    if (this.isFull) this.addControls();
    else figure.querySelector("figcaption").append(this.summary);
    this.sizes = new ResizeObserver(() => this.resize());
    this.sizes.observe(this.canvas);
    figure.hidden = false;
    this.resize();
  }

  /** The state of the line, and what else the server says beside the picture. */
  renew(fresh) {
    const now = fresh.querySelector(`figure.strip[data-line="${CSS.escape(this.line.name)}"] .now`);
    if (now) this.figure.querySelector(".now")?.replaceWith(now);
  }

  close() {
    this.sizes.disconnect();
    this.figure.remove();
  }

  addControls() {
    const button = (label, act, title = label) => {
      const made = element("button", "", label);
      made.type = "button";
      made.title = title;
      made.setAttribute("aria-label", title);
      made.addEventListener("click", act);
      return made;
    };
    this.pauseButton = button(_("Pause"), () => this.togglePause());
    this.spanText = element("output", "span");
    this.shares = element("p", "shares");
    this.legend = element("ul", "legend");
    this.detail = element("div", "detail");
    this.detail.setAttribute("aria-live", "polite");
    const bar = element("div", "controls");
    this.spans = this.figure.dataset.hasPast === undefined ? SPANS : [...SPANS, ...LONG_SPANS.keys()];
    this.quick = QUICK.filter((span) => this.spans.includes(span)).map((span) => [span, button(spanInWords(span), () => this.setSpan(span, this.width))]);
    bar.append(this.pauseButton, button("−", () => this.zoom(1), _("Zoom out")), this.spanText, button("+", () => this.zoom(-1), _("Zoom in")), ...this.quick.map(([, each]) => each), this.summary);
    this.figure.querySelector(".plot").prepend(bar);
    this.figure.querySelector(".plot").append(this.shares, this.legend, this.detail);
    this.past = new Past(this.figure, this.detail);
    this.listen();
    this.showSpan();
    this.showDetail();
    document.querySelectorAll("[data-spans], section > [data-past]").forEach((each) => each.remove());
    const [asked] = [...LONG_SPANS].find(([, name]) => name === new URLSearchParams(location.search).get("span")) ?? [];
    if (this.spans.includes(asked)) this.setSpan(asked, this.width);
  }

  listen() {
    const canvas = this.canvas;
    const fingers = new Map();
    canvas.addEventListener("pointerdown", (event) => {
      canvas.setPointerCapture(event.pointerId);
      fingers.set(event.pointerId, event.offsetX);
      this.hasMoved = false;
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!fingers.has(event.pointerId)) {
        this.pointed = this.itemAt(event.offsetX, event.offsetY);
        return this.showDetail();
      }
      const before = [...fingers.values()];
      const was = fingers.get(event.pointerId);
      if (Math.abs(event.offsetX - was) < 4 && !this.hasMoved) return;
      this.hasMoved = true;
      fingers.set(event.pointerId, event.offsetX);
      const now = [...fingers.values()];
      if (before.length === 2) this.scale(Math.abs(before[0] - before[1]) / Math.max(8, Math.abs(now[0] - now[1])), (now[0] + now[1]) / 2);
      else this.move((was - event.offsetX) * this.perPixel());
    });
    const lift = (event) => {
      if (fingers.delete(event.pointerId) && !this.hasMoved && event.type === "pointerup") this.pin(this.itemAt(event.offsetX, event.offsetY));
    };
    canvas.addEventListener("pointerup", lift);
    canvas.addEventListener("pointercancel", lift);
    canvas.addEventListener("pointerleave", () => {
      this.pointed = undefined;
      this.showDetail();
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      if (event.shiftKey || Math.abs(event.deltaX) > Math.abs(event.deltaY)) this.move((event.deltaX || event.deltaY) * this.perPixel());
      else this.scale(event.deltaY > 0 ? 1.25 : 0.8, event.offsetX);
    }, { passive: false });
    document.addEventListener("keydown", (event) => {
      // From the page itself too, but not what scrolls it up and down.
      const isOnPast = this.past.span && this.figure.contains(event.target);
      if (event.target !== canvas && !isOnPast && (event.target !== document.body || /Page|End/.test(event.key))) return;
      const acts = this.past.span ? this.keysOfPast() : {
        " ": () => this.togglePause(), "+": () => this.zoom(-1), "=": () => this.zoom(-1), "-": () => this.zoom(1),
        ArrowLeft: () => this.step(-1), ArrowRight: () => this.step(1), PageUp: () => this.move(-this.span / 2), PageDown: () => this.move(this.span / 2), End: () => this.resume(), Escape: () => this.resume(),
      };
      const act = acts[event.key];
      if (!act || event.ctrlKey || event.altKey || event.metaKey) return;
      event.preventDefault();
      act();
    });
  }

  keysOfPast() {
    const { past } = this;
    return {
      "+": () => this.zoom(-1), "=": () => this.zoom(-1), "-": () => this.zoom(1),
      ArrowLeft: () => past.step(-1), ArrowRight: () => past.step(1), PageUp: () => past.step(-6), PageDown: () => past.step(6), End: () => past.step(Infinity), Escape: () => past.tell(undefined),
    };
  }

  // What is kept

  add(fact) {
    const item = itemOf(fact, this.line);
    if (fact.kind === "answered" && !fact.line) return;
    if (fact.unit !== undefined && !this.order.includes(fact.unit)) this.order.push(fact.unit);
    if (fact.name && !this.names.get(fact.unit)) this.names.set(fact.unit, fact.name);
    this.items.push(item);
    this.isNew = true;
  }

  forget(now) {
    const oldest = Math.min(now, this.right ?? now) - KEPT;
    let gone = Math.max(0, this.items.length - MOST_KEPT);
    while (gone < this.items.length && this.items[gone].end < oldest) gone++;
    if (gone) this.items.splice(0, gone);
  }

  // Moving about

  get isPaused() {
    return this.right !== undefined;
  }
  perPixel() {
    return this.span / (this.width - this.lanes.left);
  }
  togglePause() {
    if (this.isPaused) this.resume();
    else this.pauseAt(now());
  }
  pauseAt(time) {
    this.right = Math.min(time, now());
    this.pauseButton.textContent = _("Live");
    this.pauseButton.setAttribute("aria-label", _("Live"));
    this.figure.classList.add("paused");
  }
  resume() {
    this.right = this.pinned = undefined;
    this.pauseButton.textContent = _("Pause");
    this.pauseButton.setAttribute("aria-label", _("Pause"));
    this.figure.classList.remove("paused");
    this.showDetail();
  }
  move(seconds) {
    this.pauseAt((this.right ?? now()) + seconds);
  }
  zoom(steps) {
    const at = this.spans.findIndex((span) => span >= this.span * 0.999);
    this.setSpan(this.spans[Math.max(0, Math.min(this.spans.length - 1, at + steps))], this.pinned ? this.x(this.pinned.begin) : this.isPaused ? (this.width + this.lanes.left) / 2 : this.width);
  }
  scale(factor, x) {
    this.setSpan(Math.max(SPANS[0] / 5, Math.min(SPANS.at(-1), this.span * factor)), this.isPaused ? x : this.width);
  }
  /** Show another span; what is at `x` stays there. */
  setSpan(span, x) {
    const rest = (this.width - x) / (this.width - this.lanes.left), long = LONG_SPANS.get(span);
    if (long || this.past.span) this.showPast(long);
    if (this.isPaused) this.right += (span - this.span) * rest;
    this.span = span;
    this.showSpan();
  }
  showSpan() {
    this.spanText.textContent = spanInWords(this.span);
    for (const [span, button] of this.quick) button.setAttribute("aria-pressed", String(span === this.span));
  }
  /** Show the last hour or day in the place of the last seconds, or these again. */
  showPast(long) {
    for (const part of [this.canvas, this.shares, this.legend]) part.hidden = Boolean(long);
    this.resume();
    this.pauseButton.disabled = Boolean(long);
    this.past.show(long);
    setText(this.summary, "");
    if (!long) this.detail.replaceChildren(), this.showDetail();
  }
  pin(item) {
    this.pinned = item;
    if (item && !this.isPaused) this.pauseAt(now());
    this.showDetail();
  }
  step(by) {
    const at = this.items.indexOf(this.pinned);
    const next = at < 0 ? this.items.findLast((item) => item.end <= (this.right ?? now())) : this.items[at + by];
    if (!next) return;
    this.pin(next);
    if (next.begin < this.right - this.span || next.end > this.right) this.pauseAt(next.end + this.span / 2);
  }

  // Drawing

  resize() {
    const ratio = devicePixelRatio || 1;
    this.width = this.canvas.clientWidth;
    if (isPanel && !this.isFull) this.lanes = stretched(LANES.compact, this.canvas.clientHeight);
    this.canvas.width = Math.round(this.width * ratio);
    this.canvas.height = Math.round(this.lanes.height * ratio);
    this.pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.drawn = undefined;
  }
  x(time) {
    return this.width - (this.edge - time) / this.perPixel();
  }

  draw(time) {
    this.edge = this.right ?? time;
    const { pen, lanes, width } = this;
    if (width < 40 || this.past?.span) return;
    pen.clearRect(0, 0, width, lanes.height);
    pen.save();
    this.drawGround();
    pen.beginPath();
    pen.rect(lanes.left, 0, width - lanes.left, lanes.height);
    pen.clip();
    const begin = this.edge - this.span;
    const rows = [];
    const shown = this.items.filter((item) => item.end >= begin && Math.min(item.received, item.begin) <= this.edge);
    for (const item of shown) this.drawItem(item, rows);
    for (const item of [this.pointed, this.pinned]) if (item) this.drawFrame(item);
    pen.restore();
    if (this.isFull) this.drawLabels();
    return shown;
  }

  drawGround() {
    const { pen, lanes, width } = this;
    pen.fillStyle = theme.lane;
    pen.fillRect(lanes.left, lanes.middle - lanes.half, width - lanes.left, 2 * lanes.half);
    if (this.isFull) this.drawAxis();
    if (!isConnected && toldUntil < this.edge) this.block(toldUntil, this.edge, lanes.middle - lanes.half, 2 * lanes.half, theme.unknown);
    pen.fillStyle = theme.middle;
    pen.fillRect(lanes.left, lanes.middle - 0.5, width - lanes.left, 1);
  }

  drawAxis() {
    const { pen, lanes, width } = this;
    const step = [0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10].find((each) => each / this.perPixel() > 84) ?? 20;
    const digits = step < 0.01 ? 3 : step < 0.1 ? 2 : step < 1 ? 1 : 0;
    pen.font = "11px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "top";
    for (let tick = Math.ceil((this.edge - this.span) / step); tick * step <= this.edge; tick++) {
      const x = this.x(tick * step);
      pen.fillStyle = theme.grid;
      pen.fillRect(Math.round(x), 4, 1, lanes.axis - 4);
      pen.fillStyle = theme.quiet;
      if (x > lanes.left + 30 && x < width - 34) pen.fillText(clock(tick * step, digits), x, lanes.axis + 6);
    }
  }

  drawLabels() {
    const { pen, lanes } = this;
    pen.font = "12px system-ui, sans-serif";
    pen.fillStyle = theme.quiet;
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    const at = lanes.left - 10;
    if (!this.isAsked) pen.fillText(LANE_NAMES.wait, at, (lanes.wait[0] + lanes.wait[1]) / 2);
    pen.fillText(LANE_NAMES.request, at, lanes.middle - lanes.half / 2);
    pen.fillText(LANE_NAMES.response, at, lanes.middle + lanes.half / 2);
  }

  drawItem(item, rows) {
    const { middle, half } = this.lanes;
    const { state } = item;
    if (state === "port") return this.drawPort(item);
    if (state === "refused") return this.drawRefused(item);
    if (item.kind === "heard") return this.drawHeard(item);
    const ink = this.ink(item.unit);
    this.drawWait(item, rows, ink);
    this.inked(item.begin, item.left, middle - half, half, ink);
    this.label(item.begin, item.left, middle - half / 2, item.unit);
    if (FAILED.has(state)) {
      this.block(item.left, item.back, middle, half, theme.lost);
      this.block(item.left, item.back, middle + half - 2, 2, theme.bad);
      // When the broken frame came is not recorded: it is a mark, and not to scale.
      if (state === "broken") this.zigzag(this.x(item.end) - (this.isFull ? 24 : 16), this.isFull ? 10 : 7, theme.warn);
      this.cross(this.x(item.end), middle + half / 2);
      return;
    }
    this.block(item.left, item.back, middle - 3, 6, ink.tint);
    if (item.end > item.back || item.fact.response) this.inked(item.back, item.end, middle, half, ink);
    this.label(item.back, item.end, middle + half / 2, item.unit);
    if (state === "exception") this.badge(this.x(item.end), middle + half, "!");
  }

  drawWait(item, rows, ink) {
    const [top, bottom] = this.lanes.wait;
    if (item.begin - item.received < 0.0005) return;
    const height = this.isFull ? 5 : 3;
    const most = Math.floor((bottom - top) / (height + 2));
    let row = rows.findIndex((end) => end <= item.received);
    if (row < 0) row = Math.min(rows.length, most - 1);
    rows[row] = item.begin;
    this.block(item.received, item.begin, bottom - (row + 1) * (height + 2), height, ink.soft);
  }

  drawHeard(item) {
    const { middle, half } = this.lanes;
    if (item.state === "noise" || item.state === "broken") return this.zigzag(this.x(item.begin), this.x(item.end) - this.x(item.begin), theme.warn);
    const isRequest = item.fact.owner === "another's request" || item.fact.owner === "an echo";
    const y = isRequest ? middle - half : middle;
    if (item.state === "late") return this.outline(item.begin, item.end, y + 3, half - 6, theme.bad);
    this.block(item.begin, item.end, y + half / 4, half / 2, theme.foreign + "55");
    this.outline(item.begin, item.end, y + half / 4, half / 2, theme.foreign);
  }

  drawPort(item) {
    const { pen, lanes } = this;
    const x = Math.round(this.x(item.end));
    pen.fillStyle = item.fact.reason ? theme.bad : theme.good;
    for (let y = 0; y < lanes.middle + lanes.half; y += 8) pen.fillRect(x - 1, y, 2, 5);
  }

  drawRefused(item) {
    const { pen, lanes } = this;
    const x = this.x(item.end), y = lanes.wait[1] - 2, size = this.isFull ? 6 : 4;
    pen.fillStyle = theme.bad;
    pen.beginPath();
    pen.moveTo(x - size, y - 2 * size);
    pen.lineTo(x + size, y - 2 * size);
    pen.lineTo(x, y);
    pen.fill();
  }

  drawFrame(item) {
    const { middle, half } = this.lanes;
    const [from, to] = [this.x(item.begin), this.x(item.end)];
    const { pen } = this;
    pen.strokeStyle = theme.ink;
    pen.lineWidth = 2;
    pen.strokeRect(from - 3, middle - half - 4, Math.max(2, to - from) + 6, 2 * half + 8);
  }

  /** A block of a unit: with its pattern where there is room for it. */
  inked(from, to, y, height, ink) {
    this.block(from, to, y, height, this.x(to) - this.x(from) < 5 ? ink.colour : ink.fill);
  }

  label(from, to, y, unit) {
    const left = Math.max(this.x(from), this.lanes.left), right = Math.min(this.x(to), this.width);
    if (!this.isFull || right - left < 30) return;
    const { pen } = this;
    pen.fillStyle = theme.ground;
    pen.fillRect((left + right) / 2 - 13, y - 9, 26, 18);
    pen.fillStyle = theme.ink;
    pen.font = "600 12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(unit, (left + right) / 2, y + 0.5);
  }

  block(from, to, y, height, fill) {
    const x = this.x(from);
    const size = Math.max(to > from ? 1.2 : 0, this.x(to) - x);
    this.pen.fillStyle = fill;
    this.pen.fillRect(x, y, size, height);
  }

  outline(from, to, y, height, colour) {
    const x = this.x(from);
    this.pen.strokeStyle = colour;
    this.pen.lineWidth = 1.5;
    this.pen.strokeRect(x, y, Math.max(3, this.x(to) - x), height);
  }

  /** A frame with torn edges: what came is broken. */
  zigzag(left, size, colour) {
    const { pen } = this;
    const { middle, half } = this.lanes;
    const right = left + Math.max(5, size), teeth = this.isFull ? 5 : 3;
    const [top, bottom] = [middle + half * 0.15, middle + half * 0.85];
    const step = (bottom - top) / (2 * teeth);
    pen.beginPath();
    for (let tooth = 0; tooth <= 2 * teeth; tooth++) pen.lineTo(left + (tooth % 2 ? 3 : 0), top + tooth * step);
    for (let tooth = 2 * teeth; tooth >= 0; tooth--) pen.lineTo(right + (tooth % 2 ? 3 : 0), top + tooth * step);
    pen.closePath();
    pen.fillStyle = colour;
    pen.fill();
  }

  cross(x, y) {
    const { pen } = this;
    const size = this.isFull ? 6 : 4;
    pen.lineCap = "round";
    for (const [colour, width] of [[theme.ground, 5], [theme.bad, 2.5]]) {
      pen.strokeStyle = colour;
      pen.lineWidth = width;
      pen.beginPath();
      pen.moveTo(x - size, y - size);
      pen.lineTo(x + size, y + size);
      pen.moveTo(x + size, y - size);
      pen.lineTo(x - size, y + size);
      pen.stroke();
    }
  }

  badge(x, y, text) {
    const { pen } = this;
    const size = this.isFull ? 7 : 5;
    pen.fillStyle = theme.warn;
    pen.beginPath();
    pen.arc(x, y, size, 0, 7);
    pen.fill();
    pen.fillStyle = theme.ground;
    pen.font = `bold ${size * 1.7}px system-ui, sans-serif`;
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    pen.fillText(text, x, y + 0.5);
  }

  ink(unit) {
    const at = Math.max(0, this.order.indexOf(unit));
    const colour = theme.units[at % theme.units.length];
    return { colour, fill: patternOf(at % PATTERNS, colour), tint: colour + "66", soft: colour + "aa" };
  }

  itemAt(x, y) {
    let found, nearest = 6;
    const inWaits = y < this.lanes.wait[1] + 6;
    for (const item of this.items) {
      if (item.end < this.edge - this.span || item.begin > this.edge) continue;
      const from = this.x(inWaits ? Math.min(item.received, item.begin) : item.begin), to = this.x(inWaits ? Math.max(item.begin, item.received) : item.end);
      const away = x < from ? from - x : x > to ? x - to : 0;
      if (away < nearest || (away === nearest && away === 0)) [found, nearest] = [item, away];
    }
    return found;
  }

  // Words

  /** What the span that is shown was used for, and the counts of it. */
  tell(shown) {
    const begin = this.edge - this.span;
    const inside = (from, to) => Math.max(0, Math.min(to, this.edge) - Math.max(from, begin));
    const sums = { request: 0, think: 0, response: 0, lost: 0 };
    const counts = { requests: 0, timeout: 0, failed: 0, broken: 0, foreign: 0, refused: 0, silent: 0 };
    for (const item of shown) {
      if (item.kind === "exchange" || item.kind === "answered") {
        counts.requests++;
        sums.request += inside(item.begin, item.left);
        sums[FAILED.has(item.state) ? "lost" : "think"] += inside(item.left, item.back);
        sums.response += inside(item.back, item.end);
      } else if (item.kind === "heard") sums.response += inside(item.begin, item.end);
      if (["timeout", "failed", "refused", "silent"].includes(item.state)) counts[item.state]++;
      if (item.state === "broken" || item.state === "noise") counts.broken++;
      if (item.state === "foreign" || item.state === "late") counts.foreign++;
    }
    const busy = sums.request + sums.think + sums.response + sums.lost;
    sums.free = Math.max(0, this.span - busy);
    setText(this.summary, isConnected ? countsInWords(counts, this.span) : _("no connection, trying again"));
    if (this.isFull && isConnected) this.showShares(sums);
    if (this.isFull) this.showLegend();
  }

  showShares(sums) {
    if (!this.shareParts) {
      const names = this.isAsked ? SHARES_ASKED : SHARES;
      this.shareParts = new Map(Object.keys(names).map((name) => [name, element("span", "share " + name)]));
      for (const [name, part] of this.shareParts) part.append(element("i", "bar"), element("b", "", ""), " " + names[name]);
      this.shares.replaceChildren(...this.shareParts.values());
    }
    const total = Object.values(sums).reduce((sum, each) => sum + each, 0) || 1;
    for (const [name, part] of this.shareParts) {
      part.style.setProperty("--share", (sums[name] / total).toFixed(4));
      setText(part.querySelector("b"), percent(sums[name] / total));
    }
  }

  showLegend() {
    const key = this.order.map((unit) => `${unit}${this.names.get(unit) ?? ""}`).join() + theme.ground;
    if (key === this.legendKey) return;
    this.legendKey = key;
    this.detail.replaceChildren();
    this.showDetail();
    const units = this.order.map((unit) => entry(named(unit, this.names.get(unit)), (pen) => {
      pen.fillStyle = this.ink(unit).fill;
      pen.fillRect(0, 0, 18, 12);
    }));
    const marks = Object.entries(MARKS).filter(([name]) => !this.isAsked || ["exception", "broken", "foreign"].includes(name));
    this.legend.replaceChildren(...units, ...marks.map(([name, text]) => entry(text, (pen) => drawMark(pen, name))));
  }

  /** How a transaction is drawn, with the names of its parts. */
  sample() {
    const made = element("canvas", "sample"), ratio = devicePixelRatio || 1, pen = made.getContext("2d");
    [made.width, made.height] = [470 * ratio, 76 * ratio];
    made.setAttribute("aria-hidden", "true");
    if (!theme.units) return made; // it is drawn again when there are colours
    pen.scale(ratio, ratio);
    const ink = this.ink(this.order[0]), think = (this.isAsked ? SHARES_ASKED : SHARES).think;
    const part = (x, y, width, height, fill) => ((pen.fillStyle = fill), pen.fillRect(x, y, width, height));
    part(0, 16, 470, 60, theme.lane);
    if (!this.isAsked) part(10, 5, 90, 5, ink.soft);
    part(100, 16, 90, 30, ink.fill);
    part(190, 43, 160, 6, ink.tint);
    part(350, 46, 90, 30, ink.fill);
    pen.font = "12px system-ui, sans-serif";
    pen.textAlign = "center";
    pen.textBaseline = "middle";
    const text = (words, x, y, isOnBlock) => {
      const width = pen.measureText(words).width + 10;
      if (isOnBlock) part(x - width / 2, y - 9, width, 18, theme.ground);
      pen.fillStyle = theme.ink;
      pen.fillText(words, x, y + 0.5);
    };
    if (!this.isAsked) text(LANE_NAMES.wait, 55, 28);
    text(LANE_NAMES.request, 145, 31, true);
    text(think, 270, 31);
    text(LANE_NAMES.response, 395, 61, true);
    return made;
  }

  showDetail() {
    if (!this.isFull || this.past.span) return;
    const item = this.pinned ?? this.pointed;
    if (item === this.detailed && this.detail.hasChildNodes()) return;
    this.detailed = item;
    if (!item) return this.detail.replaceChildren(element("p", "hint", _("Point at a transaction, or use ← and →, to see its frames.")), this.sample(), element("p", "quiet keys", KEYS));
    const index = this.items.indexOf(item), before = this.items[index - 1];
    this.detail.replaceChildren(...detailOf(item, this.line, before ? item.begin - before.end : undefined));
  }
}

const spanInWords = (span) => (span < 60 ? seconds(span) : span < 3600 ? `${span / 60} min` : `${span / 3600} h`);

function countsInWords({ requests, timeout, failed, broken, refused, silent, foreign }, span) {
  const perSecond = requests / span;
  const [lost, damaged, others] = isPanel
    ? [_("%(count)s failed", { count: failed }), _("%(count)s broken", { count: broken }), _("%(count)s foreign", { count: foreign })]
    : [_("%(count)s without a valid response", { count: failed }), ngettext("%(count)s broken frame", "%(count)s broken frames", broken), ngettext("%(count)s foreign frame", "%(count)s foreign frames", foreign)];
  return [
    requests ? _("%(count)s requests/s", { count: perSecond.toFixed(perSecond < 10 ? 1 : 0) }) : _("no requests"),
    ...failuresInWords(timeout), failed && lost, broken && damaged, ...failuresInWords(0, 0, refused),
    silent && _("%(count)s not answered", { count: silent }), foreign && others,
  ].filter(Boolean).join(" · ");
}

// The table: the same in words

function showTable(strip) {
  const body = document.querySelector(`table[data-trace] tbody`);
  if (!body || strip.isPaused || !strip.isNew) return;
  strip.isNew = false;
  document.querySelector("p.empty")?.remove();
  const rows = strip.items.slice(-ROWS).reverse().map((item) => {
    const row = document.createElement("tr"), { fact } = item;
    const state = element("td", "", "");
    state.append(stateOf(item));
    const took = item.took === undefined ? "" : ms(item.took), limit = fact.limit_ms === undefined ? "" : ms(fact.limit_ms);
    const cells = [element("td", "", clock(item.end, 3)), element("td", "", titleOf(item)), state, resultOf(item)];
    row.append(...cells, ...[fact.wait_ms === undefined ? "" : ms(fact.wait_ms), took, limit].map((text) => element("td", "number", text)));
    return row;
  });
  body.replaceChildren(...rows);
}

// Colours and patterns

let theme = {};
const patterns = new Map();

function readTheme() {
  const style = getComputedStyle(document.documentElement);
  const colour = (name) => style.getPropertyValue("--" + name).trim();
  theme = { ground: colour("ground"), ink: colour("ink"), quiet: colour("quiet"), bad: colour("bad"), warn: colour("warn"), good: colour("good"), grid: colour("grid"), lane: colour("lane"), middle: colour("middle"), foreign: colour("foreign"), units: colour("units").split(" ") };
  patterns.clear();
  theme.lost = patternOf("lost", theme.bad);
  theme.unknown = patternOf("lost", theme.quiet);
  showMarks();
}

/** A fill of one colour: 0 plain, 1 slanted, 2 dotted, 3 upright; `lost` is thin lines on the ground. */
function patternOf(kind, colour) {
  const key = kind + colour;
  if (patterns.has(key)) return patterns.get(key);
  if (kind === 0) return colour;
  const tile = document.createElement("canvas"), size = 8;
  const ratio = Math.max(1, Math.round(devicePixelRatio || 1));
  tile.width = tile.height = size * ratio;
  const pen = tile.getContext("2d");
  pen.scale(ratio, ratio);
  const isLine = kind === "lost";
  if (!isLine) {
    pen.fillStyle = colour;
    pen.fillRect(0, 0, size, size);
  }
  pen.fillStyle = pen.strokeStyle = isLine ? colour : "#fff";
  pen.globalAlpha = isLine ? 0.6 : 0.75;
  pen.lineWidth = isLine ? 1 : 1.6;
  pen.beginPath();
  if (kind === 1 || isLine) for (const at of [-size, 0, size]) pen.moveTo(at, size), pen.lineTo(at + size, 0);
  if (kind === 2) for (const [x, y] of [[2, 2], [6, 6]]) pen.moveTo(x, y), pen.arc(x, y, 1.3, 0, 7), pen.fill();
  if (kind === 3) pen.fillRect(1, 0, 1.8, size), pen.fillRect(5, 0, 1.8, size);
  if (kind === 1 || isLine) pen.stroke();
  const made = pen.createPattern(tile, "repeat");
  made.setTransform(new DOMMatrix().scale(1 / ratio));
  patterns.set(key, made);
  return made;
}

/** On a panel the signs of all lines are explained once. */
function showMarks() {
  document.querySelector("[data-marks]")?.replaceChildren(...Object.entries(MARKS).map(([name, text]) => entry(text, (pen) => drawMark(pen, name))));
}

/** The sign of a mark, in a box of 18 by 12. */
function drawMark(pen, name) {
  const self = Object.create(Strip.prototype, { pen: { value: pen }, isFull: { value: false }, lanes: { value: { middle: -3, half: 18, wait: [0, 12] } }, x: { value: (time) => time } });
  if (name === "timeout") pen.fillStyle = theme.lost, pen.fillRect(0, 0, 18, 12), self.cross(9, 6);
  if (name === "broken") self.zigzag(3, 10, theme.warn);
  if (name === "foreign") pen.fillStyle = theme.foreign + "55", pen.fillRect(1, 1, 16, 10), self.outline(1, 17, 1, 10, theme.foreign);
  if (name === "late") self.outline(1, 17, 1, 10, theme.bad);
  if (name === "exception") self.badge(9, 6, "!");
  if (name === "refused") self.drawRefused({ end: 9 });
}

function entry(text, paint) {
  const made = element("li"), swatch = document.createElement("canvas"), ratio = devicePixelRatio || 1;
  [swatch.width, swatch.height] = [18 * ratio, 12 * ratio];
  swatch.setAttribute("aria-hidden", "true");
  const pen = swatch.getContext("2d");
  pen.scale(ratio, ratio);
  paint(pen);
  made.append(swatch, text);
  return made;
}

function setText(node, text) {
  if (node.textContent !== text) node.textContent = text;
}

// The stream

let offset; // the gateway's clock minus ours, in seconds
let isConnected = true;
let toldUntil; // by the gateway's clock
let source;
const now = () => Date.now() / 1000 + (offset ?? 0) - BEHIND;

/** Reads the stream. What breaks off is read again, with what has happened since. */
function follow(strips) {
  const lastOf = () => new Map(strips.map((strip) => [strip, strip.items.at(-1)?.fact.time ?? 0]));
  let last = lastOf(), heardAt;
  const open = () => {
    source?.close();
    heardAt = Date.now();
    if (document.hidden) return;
    const byName = new Map(strips.map((strip) => [strip.line.name, strip]));
    const only = strips.length === 1 && strips[0].isFull ? "&points=true&line=" + encodeURIComponent(strips[0].line.name) : "";
    const missing = toldUntil === undefined ? 0 : Math.ceil(now() - toldUntil) + 2;
    source = new EventSource(`/api/v1/trace?seconds=${Math.min(KEPT, Math.max(20, missing))}${only}`);
    source.onopen = () => {
      isConnected = true;
      last = lastOf();
    };
    source.onerror = () => (isConnected = false);
    source.onmessage = ({ data }) => {
      const fact = JSON.parse(data);
      heardAt = Date.now();
      isConnected = true;
      if (fact.kind === "clock") {
        const seen = fact.time - Date.now() / 1000;
        offset = offset === undefined || Math.abs(seen - offset) > 2 ? seen : Math.max(seen, offset - 0.001);
        toldUntil = fact.time;
      }
      const strip = byName.get(fact.line);
      if (strip && fact.time > (last.get(strip) ?? 0)) strip.add(fact);
    };
  };
  // A network that is pulled is no error, and one that the gateway refuses is not tried again by the browser.
  setInterval(() => {
    if (document.hidden || Date.now() - heardAt < SILENT) return;
    isConnected = false;
    open();
  }, SILENT / 2);
  document.addEventListener("visibilitychange", open);
  open();
  return open;
}

/** Lines come, go and change with a reload of the config: a strip whose line is as it was stays. */
function adopt(strips, place, fresh) {
  const figures = [...fresh.querySelectorAll("figure.strip")];
  const keyOf = (figure) => JSON.stringify({ ...figure.dataset });
  const there = new Map(strips.map((strip) => [keyOf(strip.figure), strip]));
  if (figures.map(keyOf).join() === [...there.keys()].join()) return false;
  const wanted = figures.map((figure) => there.get(keyOf(figure)) ?? new Strip(figure));
  for (const strip of strips) if (!wanted.includes(strip)) strip.close();
  place.prepend(...wanted.map((strip) => strip.figure));
  strips.splice(0, strips.length, ...wanted);
  return true;
}

function start() {
  const place = document.querySelector("[data-keep=strips]");
  const strips = [...place.querySelectorAll("figure.strip")].map((figure) => new Strip(figure));
  readTheme();
  for (const query of ["(prefers-color-scheme: dark)", "print"]) matchMedia(query).addEventListener("change", readTheme);
  const reopen = follow(strips);
  document.addEventListener("renewed", ({ detail }) => {
    if (adopt(strips, place, detail)) reopen();
    for (const strip of strips) strip.renew(detail);
  });
  const isCalm = matchMedia("(prefers-reduced-motion: reduce)");
  let drawnAt = -Infinity, toldAt = -Infinity;
  const frame = (at) => {
    requestAnimationFrame(frame);
    if (at - drawnAt < (isCalm.matches ? 1000 : strips.length > 1 ? 90 : 30)) return;
    drawnAt = at;
    const isTime = at - toldAt > 500;
    if (isTime) toldAt = at;
    for (const strip of strips) {
      const shown = strip.draw(now());
      if (isTime && shown) strip.tell(shown), strip.forget(now());
      if (isTime && strip.isFull) showTable(strip);
    }
  };
  requestAnimationFrame(frame);
}

start();
