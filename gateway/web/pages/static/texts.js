// Texts in the language of the page, looked up by their English. Other languages than it have theirs in texts/CODE.js,
// which deploy/translations.py makes.
const code = document.documentElement.lang.split("-")[0];
const { plural, texts } = code === "en" ? { plural: (count) => Number(count !== 1), texts: {} } : await import(`./texts/${code}.js`);

const filled = (text, values) => text.replace(/%\((\w+)\)s/g, (_all, name) => values[name]);

/** Translate a text; `%(name)s` in it stands for the value of that name. */
export const _ = (english, values = {}) => filled(texts[english] ?? english, values);

/** Translate a word that means something else in another context. */
export const pgettext = (context, english) => texts[`${context}\u0004${english}`] ?? english;

/** Translate a text that differs with `count`, which `%(count)s` stands for. */
export const ngettext = (one, many, count) => filled((texts[one] ?? [one, many])[plural(count)], { count });
