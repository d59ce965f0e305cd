// Quantities as all languages write them.
export const hour = (time) => new Date(time * 1000).toLocaleTimeString("en-GB", { hour: "2-digit", minute: "2-digit" });
export const ms = (value) => (value < 10 ? value.toFixed(1) : value.toFixed(0)) + " ms";
export const percent = (share) => `${(100 * share).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`;
export const seconds = (value) => (value < 1 ? `${(1000 * value).toFixed(0)} ms` : `${Number(value.toPrecision(2))} s`);
