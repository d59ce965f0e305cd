"""Whether a limit suits the response times under it: one rule for `status`, for the log and for the page of a unit."""

from typing import Final, Literal

#: `few`: too few responses to say; `tight`: the next slow one is a time-out; `long`: far too long.
Verdict = Literal["few", "tight", "right", "long"]

#: From which share of the limit on 99 of 100 responses are near it, and up to which it is far too long if there is no
#: timing table to compare it with.
CLOSE: Final = 0.8
FAR: Final = 0.05
#: From how many milliseconds on a limit can be far too long, and from how many times what a timing table would make it.
LONG: Final = 500
FAR_BEYOND: Final = 5
#: How many responses say that a limit is tight, and how many that it may be shorter.
ENOUGH: Final = 20
ENOUGH_TO_SHORTEN: Final = 100


def verdict(
    share: float | None, responses: int, late: int, limit_ms: float, proposed_ms: float | None = None
) -> Verdict:
    """Judge a limit: 99 of 100 of `responses` took at most this `share` of it, and `late` came after it.

    `proposed_ms` is the limit by a timing table from these responses, if there is one: it tells what is far too long.
    """
    if late:
        return "tight"
    if share is None or responses < ENOUGH:
        return "few"
    if share >= CLOSE:
        return "tight"
    is_far = share <= FAR if proposed_ms is None else limit_ms >= FAR_BEYOND * proposed_ms
    if not is_far or limit_ms < LONG:
        return "right"
    return "long" if responses >= ENOUGH_TO_SHORTEN else "few"
