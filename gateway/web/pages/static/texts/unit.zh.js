export const TEXTS = {
  reading: "正在读取…",
  failed: "未能读取",
};
