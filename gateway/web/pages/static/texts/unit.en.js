export const TEXTS = {
  reading: "Reading …",
  failed: "Not read",
};
