export const TEXTS = {
  apart: (time, isAhead) => ` · ${time} ${isAhead ? "ahead of" : "behind"} your clock`,
};
