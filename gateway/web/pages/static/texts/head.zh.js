export const TEXTS = {
  apart: (time, isAhead) => ` · 比您的时钟${isAhead ? "快" : "慢"} ${time}`,
};
