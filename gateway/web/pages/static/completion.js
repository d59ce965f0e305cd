// Completion in a text of TOML: tables, keys and values of a config, from the JSON that is made of its schema.
const MOST = 60;

/** Where the end of this text stands: in a header, at a key or at a value, of which table, and what is written of it. */
export function contextOf(text) {
  const headers = [...text.matchAll(/^[ \t]*(\[\[?)([^\[\]\n#=]*)(\]?)/gm)].filter(({ 2: name }) => /^[\w\s."-]*$/.test(name));
  const header = headers.at(-1);
  if (header && !header[3]) return text.slice(header.index).includes("\n") ? null : { at: "header", opening: header[1], written: header[2].trimStart() };
  const path = header ? header[2].split(".").map((part) => part.trim().replaceAll('"', "")) : [];
  const rest = header ? text.slice(header.index + header[0].length).replace(/^\]/, "") : text;
  const inside = []; // brackets that are open, each with the key before it
  let at = "key", key = "", word = "";
  for (let index = 0; index < rest.length; index++) {
    const sign = rest[index];
    if (sign === "#") {
      const end = rest.indexOf("\n", index);
      if (end < 0) return null;
      index = end - 1;
    } else if (sign === '"' || sign === "'") {
      const fence = rest.startsWith(sign.repeat(3), index) ? sign.repeat(3) : sign;
      let end = index + fence.length;
      while (end < rest.length && !rest.startsWith(fence, end)) end += sign === '"' && rest[end] === "\\" ? 2 : 1;
      if (end >= rest.length) return fence.length > 1 || at === "key" ? null : { at: "value", path: [...path, ...inside.flatMap((each) => each.keys)], key, written: rest.slice(index + 1), quote: sign };
      if (at === "key") word = rest.slice(index + fence.length, end);
      index = end + fence.length - 1;
    } else if (sign === "=") [at, key, word] = ["value", word, ""];
    else if (sign === "{" || sign === "[") {
      inside.push({ sign, key, keys: sign === "{" ? [key] : [] });
      [at, word] = [sign === "{" ? "key" : "value", ""];
    } else if (sign === "}" || sign === "]") {
      key = inside.pop()?.key ?? "";
      [at, word] = ["after", ""];
    } else if (sign === ",") [at, word] = [inside.at(-1)?.sign === "{" ? "key" : "value", ""];
    else if (sign === "\n") {
      if (!inside.length) [at, key] = ["key", ""];
      word = "";
    } else if (/\s/.test(sign)) at = at === "value" && word ? "after" : at;
    else word += sign;
  }
  if (at === "after" || (at === "key" && /\s$/.test(rest) && word)) return null;
  return { at, path: [...path, ...inside.flatMap((each) => each.keys)], key, written: word };
}

/** What may stand there: `{insert, what}`, of which `insert` replaces what is written. */
export function choices(tables, context) {
  if (!context) return [];
  if (context.at === "header") {
    const sections = Object.entries(tables[""]).filter(([, each]) => each.table);
    return sections.map(([name, each]) => ({ insert: `${each.list ? "[[" : "["}${name}${each.named ? "." : each.list ? "]]" : "]"}`, name, what: each.what ?? "" })).filter(({ name }) => name.startsWith(context.written));
  }
  const keys = tables[tableAt(tables, context.path)];
  if (!keys) return [];
  if (context.at === "key")
    return Object.entries(keys).filter(([name, each]) => name.startsWith(context.written) && (context.path.length || !each.table)).map(([name, each]) => ({ insert: `${name} = `, name, what: each.what ?? "" }));
  const asText = (value) => (typeof value !== "string" ? `${value}` : context.quote ? `${value}${context.quote}` : `"${value}"`);
  return (keys[context.key]?.values ?? []).filter((value) => `${value}`.startsWith(context.written) && (typeof value === "string" || !context.quote)).map((value) => ({ insert: asText(value), name: `${value}`, what: "" }));
}

function tableAt(tables, path) {
  let table = "", isName = false;
  for (const part of path) {
    if (isName) isName = false;
    else {
      const next = tables[table]?.[part];
      if (!next?.table) return undefined;
      [table, isName] = [next.table, next.named === true];
    }
  }
  return table;
}

/** Complete what is written in a text area. Only Enter takes a choice, and only after an arrow: Tab and Enter stay what they are. */
export function completing(area, address) {
  const list = document.createElement("ul");
  Object.assign(list, { className: "completion", id: "completion", hidden: true });
  list.setAttribute("role", "listbox");
  list.setAttribute("aria-label", area.closest("form").dataset.completion);
  area.parentElement.append(list);
  area.setAttribute("aria-autocomplete", "list");
  area.setAttribute("aria-controls", list.id);
  let tables, shown = [], chosen = -1, written = "";

  async function offer(isWanted) {
    tables ??= await (await fetch(address)).json();
    if (area.selectionStart !== area.selectionEnd) return close();
    const context = contextOf(area.value.slice(0, area.selectionStart));
    if (!context || !(isWanted || context.written)) return close();
    written = context.at === "header" ? `${context.opening}${context.written}` : context.written;
    shown = choices(tables, context).slice(0, MOST);
    if (!shown.length || (shown.length === 1 && shown[0].name === context.written)) return close();
    chosen = -1;
    list.replaceChildren(...shown.map((each, index) => option(each, index)));
    list.hidden = false;
    place();
  }

  function option({ name, what }, index) {
    const row = document.createElement("li"), key = document.createElement("code");
    Object.assign(row, { id: `completion-${index}` });
    row.setAttribute("role", "option");
    row.setAttribute("aria-selected", "false");
    key.textContent = name;
    row.append(key, ` ${what}`);
    row.addEventListener("pointerdown", (event) => {
      event.preventDefault(); // the text keeps the focus
      take(index);
    });
    return row;
  }

  function place() {
    const before = area.value.slice(0, area.selectionStart).split("\n"), style = getComputedStyle(area), line = parseFloat(style.lineHeight);
    const width = widthOf(style) * (before.at(-1).length - written.length);
    const below = area.offsetTop + before.length * line - area.scrollTop + parseFloat(style.paddingTop), height = list.offsetHeight;
    const isAbove = below + height > area.offsetTop + area.clientHeight && below - line > height;
    list.style.top = `${isAbove ? below - line - height : below}px`;
    list.style.left = `${Math.max(0, Math.min(area.offsetLeft + width - area.scrollLeft, area.offsetLeft + area.clientWidth - 240))}px`;
  }

  function choose(step) {
    list.children[chosen]?.setAttribute("aria-selected", "false");
    chosen = (chosen + step + shown.length + (chosen < 0 && step < 0 ? 1 : 0)) % shown.length;
    const row = list.children[chosen];
    row.setAttribute("aria-selected", "true");
    row.scrollIntoView({ block: "nearest" });
    area.setAttribute("aria-activedescendant", row.id);
  }

  function take(index) {
    const { insert } = shown[index], begin = area.selectionStart - written.length;
    let end = area.selectionStart;
    while (end - begin < insert.length && area.value[end] === insert[end - begin]) end++; // a quote or bracket that closes is there
    close();
    area.focus();
    area.setSelectionRange(begin, end);
    // So that Ctrl+Z takes it back; setRangeText cannot.
    if (!document.execCommand("insertText", false, insert)) area.setRangeText(insert, begin, end, "end");
  }

  function close() {
    [list.hidden, chosen, shown] = [true, -1, []];
    area.removeAttribute("aria-activedescendant");
  }

  area.addEventListener("input", (event) => (event.inputType === "insertText" && event.data?.length === 1 ? offer(false) : close()));
  area.addEventListener("keydown", (event) => {
    if (event.key === " " && event.ctrlKey) [event.preventDefault(), offer(true)];
    if (list.hidden) return;
    if (event.key === "ArrowDown" || event.key === "ArrowUp") [event.preventDefault(), choose(event.key === "ArrowDown" ? 1 : -1)];
    else if (event.key === "Enter" && chosen >= 0) [event.preventDefault(), take(chosen)];
    else if (["Escape", "Enter", "ArrowLeft", "ArrowRight", "Home", "End"].includes(event.key)) close();
  });
  area.addEventListener("blur", close);
  area.addEventListener("scroll", close);
}

let measured = 0;

/** The width of a character: all are as wide as each other. */
function widthOf(style) {
  if (!measured) {
    const pen = document.createElement("canvas").getContext("2d");
    pen.font = `${style.fontSize} ${style.fontFamily}`;
    measured = pen.measureText("0".repeat(100)).width / 100;
  }
  return measured;
}
