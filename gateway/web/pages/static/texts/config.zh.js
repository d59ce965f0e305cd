export const TEXTS = {
  checking: "正在检查…",
  failed: "未能检查",
};
