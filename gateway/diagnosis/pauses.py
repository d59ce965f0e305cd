"""How the last requests to another server fared, by what was before them: some servers lose those that come too soon.

All is found in the records of the trace, so the more of them there are, the surer it is.
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from math import ceil, comb, inf
from typing import Final, NamedTuple

from gateway.trace.records import Sent

#: Fewer than this prove nothing.
ENOUGH: Final = 3
#: Of those that came too soon, this share is lost at least; of the others at most this part of that share.
LOST: Final = 0.2
FEWER: Final = 0.25
#: That so few of the others are lost must be this unlikely, if all are lost alike: the situations are sorted so that
#: most of the lost requests are in one.
CHANCE: Final = 0.01
#: A server that needs more silence than this has another fault. One lost request in ten may have another reason.
LONGEST: Final = 0.5
#: A server that loses requests after less rest than this, or fewer of them, has another fault.
LONG_REST: Final = 1.0
_MOST: Final = 0.3
_OTHER_REASONS: Final = 0.1
#: The gaps that are proposed, and the longest of them if shorter ones are not known to be too short.
_GAPS: Final = (0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0)
_USUAL_GAP: Final = 0.1
_LONGER: Final = 1.2
_ANSWERED: Final = frozenset({"ok", "exception"})
_LOST: Final = frozenset({"timeout", "sent_again"})


@dataclass(frozen=True, slots=True)
class Losses:
    """Requests that got no response, `lost` of `asked`, among those that were sent in the same situation."""

    lost: int = 0
    asked: int = 0

    @property
    def share(self) -> float:
        """The lost share."""
        return self.lost / self.asked if self.asked else 0.0

    def is_worse_than(self, other: "Losses") -> bool:
        """Tell whether the situation explains the losses: in the `other` one there are few, and not by chance."""
        is_bad = self.lost >= ENOUGH and self.share >= LOST
        is_good = other.asked - other.lost >= ENOUGH and other.share <= FEWER * self.share
        return is_bad and is_good and self._chance_beside(other) <= CHANCE

    def _chance_beside(self, other: "Losses") -> float:
        """Compute the chance that of all that were lost no more are among the others, if all are lost alike."""
        lost = self.lost + other.lost
        ways = sum(comb(other.asked, each) * comb(self.asked, lost - each) for each in range(other.lost + 1))
        return ways / comb(self.asked + other.asked, lost)


@dataclass(frozen=True, slots=True)
class Pauses:
    """The losses of requests sent up to `silence` seconds after a response (`soon`) or `later`.

    Those of the same requests when they are sorted otherwise: sent while another one was under way (`beside`) or not
    (`alone`); and of the latter those to a unit that was not asked for `rest` seconds before (`rested`) or was
    in half of that time (`awake`). `needed` is a gap that should do.
    """

    soon: Losses = Losses()
    later: Losses = Losses()
    beside: Losses = Losses()
    alone: Losses = Losses()
    rested: Losses = Losses()
    awake: Losses = Losses()
    silence: float = 0.0
    rest: float = inf
    needed: float = 0.0

    @property
    def needs_gap(self) -> bool:
        """Whether the server loses requests that come soon after a response."""
        return self.silence <= LONGEST and self.soon.is_worse_than(self.later)

    @property
    def needs_turns(self) -> bool:
        """Whether it loses requests that come while it has another one."""
        return self.beside.is_worse_than(self.alone)

    @property
    def needs_wake(self) -> bool:
        """Whether it loses the first request to a unit that was not asked for some time."""
        is_asleep = self.rest >= LONG_REST and self.rested.share >= _MOST
        return is_asleep and self.rested.is_worse_than(self.awake)


NO_PAUSES: Final = Pauses()


class Asked(NamedTuple):
    """What became of a request, and what was before it: a `pause` since a response, or others `beside` it.

    The last request to the same unit ended `rest` seconds before; infinity if none is known, or if it was sent again.
    """

    is_lost: bool
    pause: float
    is_beside: bool
    rest: float = inf


def situations(records: Iterable[Sent]) -> Iterator[Asked]:
    """Tell what was before each request to one server, except those to units that have not answered at all."""
    ended = [each for each in sorted(records, key=lambda one: one.sent_at) if each.result in _ANSWERED | _LOST]
    answering = {each.name for each in ended if each.result in _ANSWERED}
    last_response, ends_at = -inf, -inf
    responses: list[float] = []
    unit_ended_at: dict[str, float] = {}
    for each in ended:
        last_response = max((at for at in responses if at <= each.sent_at), default=last_response)
        responses = [at for at in responses if at > each.sent_at]
        is_lost = each.result in _LOST
        if each.name in answering:
            rest = inf if each.result == "sent_again" else each.sent_at - unit_ended_at.get(each.name, -inf)
            yield Asked(is_lost, each.sent_at - last_response, each.sent_at < ends_at, rest)
        ends_at = max(ends_at, each.at)
        unit_ended_at[each.name] = each.at
        if not is_lost:
            responses.append(each.at)


def pauses_of(found: Sequence[Asked]) -> Pauses:
    """Sort requests to one server by what was before them."""
    silence = _silence(sorted(one.pause for one in found if one.is_lost))
    enough = min((one.pause for one in found if one.pause > silence and not one.is_lost), default=inf)
    first = [one for one in found if not one.is_beside and one.rest < inf]
    rest = _rest(sorted(one.rest for one in first if one.is_lost))
    return Pauses(
        soon=_losses(one for one in found if one.pause <= silence),
        later=_losses(one for one in found if one.pause > silence),
        beside=_losses(one for one in found if one.is_beside),
        alone=_losses(one for one in found if not one.is_beside),
        rested=_losses(one for one in first if one.rest >= rest),
        awake=_losses(one for one in first if one.rest < rest / 2),
        silence=silence,
        rest=rest,
        needed=_needed(silence, enough),
    )


def _silence(lost: list[float]) -> float:
    """Find the silence within which all but a few were lost that were lost."""
    return lost[ceil((1 - _OTHER_REASONS) * len(lost)) - 1] if lost else 0.0


def _rest(lost: list[float]) -> float:
    """Find the rest after which all but a few were lost that were lost."""
    return lost[int(_OTHER_REASONS * len(lost))] if lost else inf


def _needed(silence: float, was_enough: float) -> float:
    """Choose a gap that is clearly longer than `silence`, which was too short."""
    at_least = max(_LONGER * silence, min(was_enough, _USUAL_GAP))
    return next((gap for gap in _GAPS if gap >= at_least), _GAPS[-1])


def _losses(asked: Iterable[Asked]) -> Losses:
    lost = [one.is_lost for one in asked]
    return Losses(sum(lost), len(lost))
