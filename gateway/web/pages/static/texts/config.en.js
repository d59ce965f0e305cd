export const TEXTS = {
  checking: "Checking …",
  failed: "Not checked",
};
