export const TEXTS = {
  find: "Find rows",
  found: (count, all) => ` ${count} of ${all}`,
};
