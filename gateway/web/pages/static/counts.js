// Counts of requests and of what failed, in words; what there was none of is left out.
import { _, ngettext } from "./texts.js";

export const requestsInWords = (count) => (count ? ngettext("%(count)s request", "%(count)s requests", count) : "");

export const failuresInWords = (timeouts, failed, unsent, exceptions) => [
  timeouts ? ngettext("%(count)s time-out", "%(count)s time-outs", timeouts) : "",
  failed ? _("%(count)s without a valid response", { count: failed }) : "",
  unsent ? _("%(count)s not sent", { count: unsent }) : "",
  exceptions ? ngettext("%(count)s exception", "%(count)s exceptions", exceptions) : "",
];
