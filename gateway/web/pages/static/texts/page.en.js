export const TEXTS = {
  unreachable: (time) => `The gateway cannot be reached. What is shown is of ${time}.`,
};
