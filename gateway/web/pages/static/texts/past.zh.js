export const TEXTS = {
  hint: "指向一列，或用 ← 和 →，即可查看其数值。",
  gap: "网关未运行",
  busy: (share) => `占用率 ${share}`,
  requests: (count) => `${count} 次请求`,
  timeouts: (count) => (count ? `${count} 次超时` : ""),
  failed: (count) => (count ? `${count} 次无有效响应` : ""),
  notSent: (count) => (count ? `${count} 次未发送` : ""),
  exceptions: (count) => (count ? `${count} 次异常响应` : ""),
  mostly: (clients) => `主要来自 ${clients}`,
  answer: (time) => `平均响应 ${time}`,
};
