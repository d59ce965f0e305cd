export const TEXTS = {
  pause: "暂停",
  resume: "实时",
  reconnecting: "连接中断，正在重试",
  perSecond: (count) => `每秒 ${count} 条记录`,
  leftOut: (count) => `其中 ${count} 条未显示`,
  missed: (count) => `丢失 ${count} 条`,
  waiting: (count) => `已暂停，此后又有 ${count} 条`,
};
