"""Rules about mirrors and virtual units."""

from collections.abc import Iterator, Sequence
from shlex import quote
from typing import Final

from gateway.config.values.duration import show_age
from gateway.diagnosis.evidence import PolledEvidence, SourceEvidence
from gateway.diagnosis.finding import Finding

#: What has not been fresh for so long is told, in seconds: a device may be off for a moment.
LONG: Final = 60.0
#: So many sources are named.
_MOST_NAMED: Final = 8


def about_polled(image: PolledEvidence) -> Iterator[Finding]:
    """Find the sources of a mirror or virtual unit that had no fresh value for long, or have no valid one."""
    known = image.sources
    lost = [each for each in known if each.is_lost or (each.since is not None and each.since > max(LONG, image.stale))]
    refused = [each for each in lost if each.refused]
    silent = [each for each in lost if not each.refused]
    invalid = [each for each in known if each.invalid and each not in lost]
    for those, what, remedy in (
        (silent, "no fresh values of {}: ", _why),
        (refused, "values of {} are refused with an exception: ", _where),
        (invalid, "values of {} are not valid, or do not fit their rows: ", _how),
    ):
        if those:
            named = what.format(_some(len(those), known)) + _listed(
                [_since(each, is_told=each in lost) for each in those]
            )
            yield Finding("note", image.label, named, remedy(those[0]), image.name)
    if known and not lost and not invalid:
        what = "its source has answered" if len(known) == 1 else f"all of its {len(known)} sources have answered"
        yield Finding("ok", image.label, what, unit=image.name)


def _some(count: int, known: Sequence[SourceEvidence]) -> str:
    return "its source" if len(known) == 1 else f"{count} of {len(known)} sources"


def _since(source: SourceEvidence, *, is_told: bool) -> str:
    since = "never read" if source.since is None else f"for {show_age(1000 * source.since)}"
    return f"{source.name} ({since})" if is_told else source.name


def _listed(names: Sequence[str]) -> str:
    more = len(names) - _MOST_NAMED
    return ", ".join(names[:_MOST_NAMED]) + (f" and {more} more" if more > 0 else "")


def _why(source: SourceEvidence) -> str:
    if source.is_heard:
        return f"modbus-gateway trace {quote(source.line)} shows what others read of it, and how often"
    remedy = f"modbus-gateway trace --why {quote(source.name)} tells what became of its polls"
    return f"{remedy}; see the rows about {source.line}" if source.line else remedy


def _where(source: SourceEvidence) -> str:
    return f"correct the rows of {source.name} in the config: poll_refused in the log names the addresses"


def _how(source: SourceEvidence) -> str:
    return f"modbus-gateway read {quote(source.name)}"
