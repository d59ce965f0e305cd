import { ms } from "../quantities.js";

export const TEXTS = {
  onTheWire: (address) => `线上地址 ${address}`,
  named: (unit, name) => (name ? `${unit} ${name}` : `单元 ${unit}`),
  states: {
    ok: "成功", exception: "异常响应", timeout: "超时", broken: "坏帧", failed: "无有效响应", late: "迟到的响应", foreign: "外来通信",
    noise: "干扰", refused: "未发送", port: "串口", answered: "已响应", silent: "未响应",
  },
  results: {
    resting: "暂停请求该单元", overdue: "等待迟到的响应", queue_full: "队列已满", expired: "排队过久", line_down: "线路断开", no_route: "无此单元", only_heard: "仅监听，不询问",
    denied: "无权限", unwanted: "客户端已离开", refused: "被拒绝", timeout: "没有时间重发", line_lost: "线路丢失",
  },
  owners: {
    "another client": "对其他客户端的响应", "a late response": "对先前请求的迟到响应", "an echo": "请求的回波",
    "another's request": "其他客户端的请求", nobody: "无人请求的帧", noise: "不构成帧的字节", "a damaged frame": "帧中有损坏的字符",
  },
  portOpen: "端口已打开",
  portLost: (reason) => `端口丢失：${reason}`,
  asked: (address, client) => `为 ${client} 请求从站地址 ${address}`,
  sources: (sources) => `数值来自 ${sources}`,
  times: (wait, request, think, response, limit) => `排队 ${ms(wait)} · 请求 ${ms(request)} · 设备 ${ms(think)} · 响应 ${ms(response)} · 时限 ${ms(limit)}`,
  timesLost: (wait, request, lost, limit) => `排队 ${ms(wait)} · 请求 ${ms(request)} · ${ms(lost)} 内无有效响应 · 时限 ${ms(limit)}`,
  gap: (gap) => `此前静默 ${ms(gap)}`,
  more: (count) => `另有 ${count} 个`,
  pointsFrame: "含义",
  requestFrame: "请求",
  responseFrame: "响应",
  heardFrame: "收到",
  noFrame: "什么也没有收到",
};
