// The texts of a script in the language of the page. They stand in texts/NAME.en.js and texts/NAME.zh.js.
const code = document.documentElement.lang.split("-")[0];

export const textsOf = async (name) => (await import(`./texts/${name}.${code}.js`)).TEXTS;
