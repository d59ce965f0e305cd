"""Libraries that are loaded when something of them is used, not when they are imported (ADR 24).

asyncio imports `ssl` whether it is needed or not, which is a seventh of what a gateway without TLS takes.
"""

import sys
from importlib import import_module
from threading import RLock
from types import ModuleType
from typing import Any, Final

#: TLS, asyncio's part of it, digests of certificates; the history of the web page.
LIBRARIES: Final = ("ssl", "asyncio.sslproto", "hashlib", "sqlite3")


def defer(*names: str) -> None:
    """Have a stand-in for each library that is not loaded. `import NAME` finds it; `from NAME import X` loads it."""
    for name in names:
        sys.modules.setdefault(name, _StandIn(name))


class _NotLoaded:
    """A class of a library without which it has no instances."""


class _StandIn(ModuleType):
    """Has what the library has, which is loaded when the first of it is looked up."""

    _turn: Final = RLock()
    _library: ModuleType | None = None

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):  # asked while it is imported
            raise AttributeError(name)
        if name == "SSLSocket" and self._library is None:
            return _NotLoaded  # asyncio asks of every socket whether it is one
        found = getattr(self._loaded(), name)
        setattr(self, name, found)
        return found

    def _loaded(self) -> ModuleType:
        with self._turn:
            if sys.modules.get(self.__name__) is self:
                del sys.modules[self.__name__]
        try:  # not in turn: the import may wait for one of another thread, which waits for its turn
            self._library = import_module(self.__name__)
        finally:
            if self._library is None:  # it cannot be imported: the next use tries again
                sys.modules.setdefault(self.__name__, self)
        return self._library
