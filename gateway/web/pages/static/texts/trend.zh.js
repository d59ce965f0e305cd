export const TEXTS = {
  time: "时间",
  least: "最小值",
  mean: "平均值",
  greatest: "最大值",
  date: (date) => date.toLocaleString("zh-CN", { weekday: "short", hour: "2-digit", minute: "2-digit", hour12: false }),
  tick: (date, isLong) => (isLong || (!date.getHours() && !date.getMinutes()) ? date.toLocaleDateString("zh-CN", { weekday: "short", day: "numeric" }) : date.toLocaleTimeString("zh-CN", { hour: "2-digit", minute: "2-digit", hour12: false })),
};
