export const TEXTS = {
  hint: "指向图中某处可查看数值；或在单元名称上按 ← 或 →。",
  gap: "网关未运行",
  idle: "未被请求",
  requests: (count) => `${count} 次请求`,
  timeouts: (count) => (count ? `${count} 次超时` : ""),
  failed: (count) => (count ? `${count} 次无有效响应` : ""),
  notSent: (count) => (count ? `${count} 次未发送` : ""),
  exceptions: (count) => (count ? `${count} 次异常响应` : ""),
  answer: (time, share) => `平均响应 ${time}，占时限 ${share}`,
  resting: (seconds) => `暂停 ${seconds} 秒`,
};
