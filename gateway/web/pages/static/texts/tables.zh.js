export const TEXTS = {
  find: "查找行",
  found: (count, all) => ` ${count} / ${all}`,
};
