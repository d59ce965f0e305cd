import { ms } from "../quantities.js";

const counted = (count, word) => (count ? `${word} ${count} 次` : "");

export const TEXTS = {
  lanes: { wait: "排队", request: "请求", response: "响应" },
  pause: "暂停",
  resume: "实时",
  reconnecting: "连接中断，正在重试",
  zoomIn: "放大",
  zoomOut: "缩小",
  unit: (unit) => `单元 ${unit}`,
  named: (unit, name) => (name ? `${unit} ${name}` : `单元 ${unit}`),
  share: { request: "请求", think: "等待设备", response: "响应", lost: "无有效响应", free: "空闲" },
  counts: (perSecond, timeout, failed, broken, foreign) =>
    [
      `每秒 ${perSecond} 个请求`, counted(timeout, "超时"), counted(failed, "无有效响应"),
      counted(broken, "坏帧"), counted(foreign, "外来帧"),
    ].filter(Boolean).join(" · "),
  states: {
    ok: "正常", exception: "异常响应", timeout: "超时", broken: "坏帧", failed: "无有效响应", late: "迟到的响应", foreign: "外来通信",
    noise: "干扰", refused: "未发送", port: "串口", answered: "已响应", silent: "未响应",
  },
  marks: { exception: "异常响应", timeout: "超时", broken: "坏帧", foreign: "外来通信", late: "迟到的响应", refused: "未发送" },
  owners: {
    "another client": "对其他客户端的响应", "a late response": "对先前请求的迟到响应", "an echo": "请求的回波",
    "another's request": "其他客户端的请求", nobody: "无人请求的帧", noise: "不构成帧的字节", "a damaged frame": "帧中有损坏的字符",
  },
  portOpen: "端口已打开",
  portLost: (reason) => `端口丢失：${reason}`,
  asked: (address, client) => `为 ${client} 请求从站地址 ${address}`,
  times: (wait, request, think, response, limit) => `排队 ${ms(wait)} · 请求 ${ms(request)} · 设备 ${ms(think)} · 响应 ${ms(response)} · 时限 ${ms(limit)}`,
  timesLost: (wait, request, lost, limit) => `排队 ${ms(wait)} · 请求 ${ms(request)} · ${ms(lost)} 内无有效响应 · 时限 ${ms(limit)}`,
  gap: (gap) => `此前静默 ${ms(gap)}`,
  requestFrame: "请求",
  responseFrame: "响应",
  heardFrame: "收到",
  noFrame: "什么也没有收到",
  hint: "指向一次事务，或用 ← 和 → 选择，即可查看其帧。",
  keys: "空格键暂停，+ 和 − 缩放，← 和 → 切换到前后事务，拖动可移动，End 键回到实时。",
  strip: (line) => `线路 ${line} 最近几秒的活动`,
};
