"""What a site tells of itself beside its state: its config, adapters and certificates, and what `doctor` finds there.

In an entry of the bucket times are ages in seconds, so that no two clocks are compared. All sites may read it, so it
has neither secrets nor addresses of clients.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import date
from typing import Any, Final, TypeVar

from gateway.clock.times import rfc_3339
from gateway.fleet.headers import text_of

#: The most lines that are down, adapters, certificates and findings of a site in an entry; the longest of their texts.
MOST_NAMES: Final = 100
MOST_ADAPTERS: Final = 32
MOST_CERTIFICATES: Final = 8
MOST_FINDINGS: Final = 3
LONGEST_TEXT: Final = 160
#: The largest number that a site may tell, and the longest time in seconds: others could not be shown or exported.
_MOST: Final = 1_000_000
_LONGEST: Final = 1e10
_LONGEST_CONFIG: Final = 12

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class SiteAdapter:
    """The hardware behind the serial port of a `line`. `ids` are vendor and product on USB, such as `0403:6001`."""

    line: str
    port: str
    driver: str
    ids: str


@dataclass(frozen=True, slots=True)
class SiteCertificate:
    """A file that table `used_by` names by `key`; it is valid until this date."""

    used_by: str
    key: str
    until: str


@dataclass(frozen=True, slots=True)
class SiteFinding:
    """What `doctor` would have somebody mend, `about` a line, a unit or another part."""

    about: str
    what: str


@dataclass(frozen=True, slots=True)
class SiteInventory:
    """What a site is and has. Two sites have the same `config` if only names of sites, secrets and comments differ.

    The config is `applied` since this time. Certificates are those that expire first. `doctor` was last asked when it
    was `examined`, without sending anything: it found so much `to_fix`, of which some is in `worst`, and `notes`.
    """

    config: str
    applied: str
    adapters: tuple[SiteAdapter, ...]
    certificates: tuple[SiteCertificate, ...]
    to_fix: int
    notes: int
    worst: tuple[SiteFinding, ...]
    examined: str


@dataclass(frozen=True, slots=True)
class OwnInventory:
    """The inventory of this site. Its config was `applied_at` and it was `examined_at` by the event loop's clock."""

    config: str
    applied_at: float
    adapters: tuple[SiteAdapter, ...]
    certificates: tuple[SiteCertificate, ...]
    to_fix: int
    notes: int
    worst: tuple[SiteFinding, ...]
    examined_at: float

    def told(self, now: float) -> dict[str, Any]:
        """Make JSON values of it for the entry of this site."""
        return {
            "config": self.config,
            "config_s": round(now - self.applied_at),
            "adapters": [
                [each.line, each.port[:LONGEST_TEXT], each.driver, each.ids] for each in self.adapters[:MOST_ADAPTERS]
            ],
            "certificates": [[each.used_by, each.key, each.until] for each in self.certificates[:MOST_CERTIFICATES]],
            "to_fix": self.to_fix,
            "notes": self.notes,
            "worst": [[each.about, each.what[:LONGEST_TEXT]] for each in self.worst[:MOST_FINDINGS]],
            "examined_s": round(now - self.examined_at),
        }


def inventory_in(told: Any, at: float) -> SiteInventory | None:
    """Decode the inventory in an entry that was stored `at`, in seconds since 1970.

    None if it is malformed: another version may have another one, and its site is shown all the same.
    """
    if not isinstance(told, Mapping):
        return None
    try:
        return SiteInventory(
            config=text_of(str(told["config"]), _LONGEST_CONFIG),
            applied=_since(told["config_s"], at),
            adapters=_rows(SiteAdapter, told["adapters"], 4, MOST_ADAPTERS),
            certificates=tuple(map(_valid, _rows(SiteCertificate, told["certificates"], 3, MOST_CERTIFICATES))),
            to_fix=count_in(told["to_fix"]),
            notes=count_in(told["notes"]),
            worst=_rows(SiteFinding, told["worst"], 2, MOST_FINDINGS),
            examined=_since(told["examined_s"], at),
        )
    except (ValueError, TypeError, LookupError, OverflowError):
        return None


def count_in(told: Any) -> int:
    """Decode a number; raises ValueError, TypeError or OverflowError if it cannot be one of a site."""
    if not 0 <= (count := int(told)) <= _MOST:
        raise ValueError
    return count


def age_in(told: Any) -> float:
    """Decode a time in seconds; raises ValueError, TypeError or OverflowError if it cannot be one of a site."""
    if not 0 <= (seconds := float(told)) <= _LONGEST:
        raise ValueError
    return seconds


def _rows(kind: Callable[..., T], told: Any, count: int, most: int) -> tuple[T, ...]:
    """Decode rows of `count` texts; raises ValueError or TypeError for others."""
    rows = [[text_of(str(each), LONGEST_TEXT) for each in row] for row in told[:most]]
    if any(len(row) != count for row in rows):
        raise ValueError
    return tuple(kind(*row) for row in rows)


def _valid(certificate: SiteCertificate) -> SiteCertificate:
    """Return a certificate with a date; raises ValueError for others."""
    date.fromisoformat(certificate.until)
    return certificate


def _since(seconds: Any, at: float) -> str:
    """Find the time of an age; raises ValueError, TypeError or OverflowError if there is none."""
    return rfc_3339(at - age_in(seconds), "seconds")
