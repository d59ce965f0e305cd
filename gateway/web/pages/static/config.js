// A text of the config as it is written: lines with numbers, what check says beside them, and completion of keys.
// Without this, the form does the same by a page for each check. Tab leaves the text, as in every form.
import { _ } from "./texts.js";
import { completing } from "./completion.js";

const form = document.querySelector("form[data-change]");
const CHECK_AFTER = 1500; // milliseconds without a key
const PATIENCE = 90000;

const element = (tag, className, text = "") => Object.assign(document.createElement(tag), { className, textContent: text });

function editor(area) {
  const numbers = element("pre", "numbers"), beside = element("div", "beside"), inner = element("div", "");
  for (const each of [numbers, beside]) each.setAttribute("aria-hidden", "true");
  beside.append(inner);
  area.before(numbers);
  area.after(beside);
  let count = 0, found = [];

  function number() {
    const lines = area.value.split("\n").length;
    if (lines === count) return;
    count = lines;
    draw();
  }

  function draw() {
    const worst = new Map();
    for (const { line, severity } of found) if (worst.get(line) !== "error") worst.set(line, severity);
    numbers.replaceChildren();
    let plain = "";
    for (let line = 1; line <= count; line++) {
      if (!worst.has(line)) {
        plain += `${line}\n`;
        continue;
      }
      numbers.append(plain, element("b", worst.get(line), `${line}`), "\n");
      plain = "";
    }
    numbers.append(plain);
    const height = parseFloat(getComputedStyle(area).lineHeight);
    inner.style.height = `${(count + 1) * height}px`;
    const told = new Set();
    inner.replaceChildren(
      ...found.filter(({ line }) => line <= count && !told.has(line) && told.add(line)).map(({ line, severity, text }) => {
        const row = element("p", severity, text);
        row.title = text;
        row.style.top = `${(line - 1) * height}px`;
        return row;
      }),
    );
    scroll();
  }

  const scroll = () => (numbers.scrollTop = beside.scrollTop = area.scrollTop);
  area.addEventListener("scroll", scroll);
  area.addEventListener("input", number);
  number();

  return {
    mark(problems) {
      found = problems;
      draw();
    },
    goTo(line, column) {
      const lines = area.value.split("\n").slice(0, line - 1);
      const at = lines.reduce((sum, each) => sum + each.length + 1, 0) + column - 1;
      area.focus();
      area.setSelectionRange(at, at);
      area.scrollTop = Math.max(0, (line - 5) * parseFloat(getComputedStyle(area).lineHeight));
    },
    renumber: number,
  };
}

function start() {
  const area = form.elements.text, state = form.querySelector("[data-state]"), result = document.querySelector("[data-result]");
  const shown = editor(area);
  let asked = 0, timer = 0;
  completing(area, form.dataset.keys);

  function show() {
    const rows = [...result.querySelectorAll("tr[data-line]")];
    shown.mark(rows.map((row) => ({ line: Number(row.dataset.line), severity: row.dataset.severity, text: row.querySelector("[lang=en]").innerText.split("\n")[0] })));
    for (const row of rows) {
      const place = row.cells[1], button = element("button", "place", place.textContent);
      button.type = "button";
      button.addEventListener("click", () => shown.goTo(Number(row.dataset.line), Number(row.dataset.column)));
      place.replaceChildren(button);
    }
  }

  async function check() {
    clearTimeout(timer);
    const own = ++asked;
    state.textContent = _("Checking …");
    try {
      const body = new URLSearchParams([...new FormData(form), ["only_result", ""]]);
      const response = await fetch(form.action, { method: "POST", body, headers: { Accept: "text/html" }, signal: AbortSignal.timeout(PATIENCE) });
      const page = new DOMParser().parseFromString(await response.text(), "text/html");
      if (own !== asked) return; // the text is another one by now
      if (!response.ok) throw new Error(page.querySelector("[role=alert]")?.textContent ?? response.statusText);
      result.replaceChildren(...page.querySelector("[data-result]").childNodes);
      state.textContent = result.querySelector(".state").textContent;
      show();
    } catch (error) {
      if (own === asked) state.textContent = `${_("Not checked")}: ${error.message}`;
    }
  }

  form.addEventListener("submit", (event) => {
    if (event.submitter?.hasAttribute("formaction")) return;
    event.preventDefault();
    check();
  });
  area.addEventListener("input", () => {
    clearTimeout(timer);
    timer = setTimeout(check, CHECK_AFTER);
  });
  const open = document.querySelector("[data-open]");
  open.hidden = false;
  open.querySelector("input").addEventListener("change", async ({ target }) => {
    if (!target.files.length) return;
    area.value = await target.files[0].text();
    shown.renumber();
    check();
  });
  if (result.querySelector(".state")) show();
}

if (form) start();
