"""The contexts in use. A reload replaces all of them at once, or none."""

from collections.abc import Iterable, Iterator, Mapping

from gateway.errors import TlsError
from gateway.tls.contexts import Expiry, Loaded, load
from gateway.tls.settings import Secured, TlsSettings


class TlsStore:
    """The loaded context of each address. Connections look theirs up when they begin."""

    def __init__(self) -> None:
        #: By address of the config, and by settings.
        self._all: Mapping[Secured, Loaded] = {}
        self._contexts: Mapping[TlsSettings, Loaded] = {}

    def __getitem__(self, settings: TlsSettings) -> Loaded:
        """Return the context loaded for `settings`."""
        return self._contexts[settings]

    def get(self, settings: TlsSettings, default: Loaded) -> Loaded:
        """Return the context loaded for `settings`; `default` if no address uses them any more."""
        return self._contexts.get(settings, default)

    def adopt(self, loaded: Mapping[Secured, Loaded]) -> Mapping[Secured, Loaded]:
        """Use exactly these contexts from now on. Return the previous ones."""
        before, self._all = self._all, loaded
        self._contexts = {one.settings: each for one, each in loaded.items()}
        return before

    def add(self, loaded: Mapping[Secured, Loaded]) -> Mapping[Secured, Loaded]:
        """Use these contexts too. Return the previous ones."""
        return self.adopt({**self._all, **loaded})

    def renew(self, settings: TlsSettings, before: Loaded, fresh: Loaded) -> None:
        """Replace `before`, if it is still used for `settings`, with the equal context `fresh`."""
        if self._contexts.get(settings) is before:
            self.adopt({one: fresh if one.settings == settings else each for one, each in self._all.items()})

    def expiries(self) -> Iterator[tuple[Secured, Expiry]]:
        """Yield the validity of each file, with the address that uses it."""
        for secured, loaded in self._all.items():
            for expiry in loaded.expiries:
                yield secured, expiry


def find_warnings(loaded: Mapping[Secured, Loaded]) -> Iterator[str]:
    """Yield the warnings about peers that cannot connect, with the place in the config."""
    for secured, each in loaded.items():
        for said in each.warnings:
            yield f"{secured.source}: {secured.name}: {said}"


def load_all(wanted: Iterable[Secured]) -> dict[Secured, Loaded]:
    """Load the contexts of all addresses. Blocks while it reads files.

    Raises:
        TlsError: a file cannot be used; the message names its place in the config.
    """
    found = {}
    for one in wanted:
        try:
            found[one] = load(one.settings)
        except TlsError as error:
            raise TlsError(f"{one.source}: {error}") from error
    return found
