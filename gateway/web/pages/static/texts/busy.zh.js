export const TEXTS = {
  time: "时间",
  busy: "占用率",
  failed: "无响应的请求",
  span: (hours) => (hours > 24 ? `${hours / 24} 天` : `${hours} 小时`),
  tick: (date, isLong) => (isLong || (!date.getHours() && !date.getMinutes()) ? date.toLocaleDateString("zh-CN", { weekday: "short", day: "numeric" }) : date.toLocaleTimeString("zh-CN", { hour: "2-digit", minute: "2-digit", hour12: false })),
};
