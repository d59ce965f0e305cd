"""Config keys for features that this version does not have. When one is implemented, delete its lines here."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, Final

from gateway.config.problem import Path, Problem, error, warning
from gateway.config.schema import Access, Config, Listen, Table, Upstream


@dataclass(frozen=True, slots=True)
class Gap:
    """A use of a table that is not implemented: `applies` to a table of that kind at `key`, "" for the table itself."""

    kind: type[Table]
    key: str
    applies: Callable[[Any], bool]
    what: str
    #: Whether no other problem of the table is reported.
    says_all: bool = True

    def found_at(self, table: Table) -> Path | None:
        """Where `table` uses the missing feature, or None."""
        if not isinstance(table, self.kind) or not self.applies(table):
            return None
        return (*table.path, self.key) if self.key else table.path


#: The gateway cannot do what the file says: errors.
REFUSED: Final = (
    Gap(Listen, "bind", lambda listen: listen.bind.scheme == "tls", "a tls:// listener"),
    Gap(Upstream, "to", lambda upstream: upstream.to.scheme == "tls", "an upstream over tls://", says_all=False),
    Gap(Access, "role", lambda access: access.role is not None, "the role of a TLS client", says_all=False),
)

#: The gateway works without it: one warning for each.
WITHOUT_EFFECT: Final = (Gap(Config, "site", lambda config: bool(config.site), "site"),)


def check_built(config: Config) -> Iterator[Problem]:
    """All uses that this version refuses, and one warning for each key without effect."""
    tables = list(_tables(config))
    for gap in REFUSED:
        places = filter(None, map(gap.found_at, tables))
        yield from (error(path, f"{gap.what} is not built yet in this version") for path in places)
    for gap in WITHOUT_EFFECT:
        first = next(filter(None, map(gap.found_at, tables)), None)
        if first is not None:
            yield warning(first, f"{gap.what} has no effect yet in this version")


def unbuilt_tables(config: Config) -> frozenset[Path]:
    """The tables that are not implemented at all."""
    kinds = [gap for gap in REFUSED if gap.says_all]
    return frozenset(table.path for table in _tables(config) if any(gap.found_at(table) is not None for gap in kinds))


def refusal(kind: type[Table], path: Path) -> Problem | None:
    """The problem for an unreadable table, if every table of this kind is refused."""
    gap = next((gap for gap in REFUSED if gap.kind is kind and not gap.key), None)
    return None if gap is None else error(path, f"{gap.what} is not built yet in this version")


def _tables(config: Config) -> Iterator[Table]:
    """Every table of which a use may be missing."""
    yield from (config, *config.listen, *config.image, *config.upstream, *config.access)
    for line in config.line:
        yield from (line, *(line.devices or ()))
    yield from filter(None, (config.web,))
