const counted = (count, word) => (count ? `${word} ${count} 次` : "");

export const TEXTS = {
  lanes: { wait: "排队", request: "请求", response: "响应" },
  pause: "暂停",
  resume: "实时",
  reconnecting: "连接中断，正在重试",
  zoomIn: "放大",
  zoomOut: "缩小",
  share: { request: "请求", think: "等待设备", response: "响应", lost: "无有效响应", free: "空闲" },
  shareAsked: { request: "请求", think: "等待网关", response: "响应", free: "静默" },
  counts: (perSecond, others) =>
    [
      perSecond ? `每秒 ${perSecond} 个请求` : "没有请求", counted(others.timeout, "超时"), counted(others.failed, "无有效响应"),
      counted(others.broken, "坏帧"), counted(others.refused, "未发送"), counted(others.silent, "未响应"),
      counted(others.foreign, "外来帧"),
    ].filter(Boolean).join(" · "),
  briefCounts: (perSecond, others) =>
    [
      perSecond ? `每秒 ${perSecond} 个请求` : "没有请求", others.timeout ? `超时 ${others.timeout}` : "", others.failed ? `失败 ${others.failed}` : "", others.broken ? `坏帧 ${others.broken}` : "",
      others.refused ? `未发送 ${others.refused}` : "", others.silent ? `未响应 ${others.silent}` : "", others.foreign ? `外来帧 ${others.foreign}` : "",
    ].filter(Boolean).join(" · "),
  marks: { exception: "异常响应", timeout: "超时", broken: "坏帧", foreign: "外来通信", late: "迟到的响应", refused: "未发送" },
  hint: "指向一次事务，或用 ← 和 → 选择，即可查看其帧。",
  keys: "空格键暂停，+ 和 − 缩放，← 和 → 切换到前后事务，拖动或 Page Up、Page Down 移动，End 键回到实时。",
  strip: (line) => `线路 ${line} 最近几秒的活动`,
};
