export const TEXTS = {
  unreachable: (time) => `无法连接网关。所示为 ${time} 的状态。`,
};
