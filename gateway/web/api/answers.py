"""What the server asks of the gateway behind it."""

from collections.abc import AsyncIterator, Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any, Protocol

from gateway.operator.operations import Traced
from gateway.profiles.point import Point
from gateway.request import Caller
from gateway.timing.history import Past
from gateway.web.api.unit_answers import UnitAnswers


class Unit(Protocol):
    """A unit that clients can ask. `functions` None means all; a dataclass."""

    @property
    def unit(self) -> int:
        """The number that clients use."""

    @property
    def name(self) -> str:
        """What it is called."""

    @property
    def kind(self) -> str:
        """What answers for it: device, upstream, image, mirror or gateway; empty if it is not configured."""

    @property
    def profile(self) -> str:
        """The name of its profile."""

    @property
    def functions(self) -> tuple[int, ...] | None:
        """The functions that it knows; None for all."""

    @property
    def limits(self) -> Mapping[int, int]:
        """The most items of a function."""

    @property
    def points(self) -> tuple[Point, ...]:
        """What its registers mean."""


class Status(Protocol):
    """How the gateway is doing: a dataclass, of which the document has the schema."""

    @property
    def clients(self) -> Sequence[Any]:
        """The clients that are connected."""

    @property
    def lines(self) -> Sequence[Any]:
        """The lines."""

    @property
    def servers(self) -> Sequence[Any]:
        """The lines where an outside client asks us."""

    @property
    def upstreams(self) -> Sequence[Any]:
        """Other servers."""

    @property
    def listeners(self) -> Sequence[Any]:
        """The addresses where clients connect."""

    @property
    def rejections(self) -> Sequence[Any]:
        """The clients that were rejected."""

    @property
    def units(self) -> Sequence[Any]:
        """The units on lines and behind other servers."""

    @property
    def images(self) -> Sequence[Any]:
        """The images."""

    @property
    def mirrors(self) -> Sequence[Any]:
        """The mirrors."""

    @property
    def brokers(self) -> Sequence[Any]:
        """The broker at which values are published, if there is one."""


@dataclass(frozen=True, slots=True)
class Answer:
    """A response PDU, and how long it took. `result` and `reason` are those of an exception of the gateway's own."""

    pdu: bytes
    elapsed_ms: float
    result: str = ""
    reason: str = ""


@dataclass(frozen=True, slots=True)
class WebClient:
    """A client of units. `is_there` tells whether it still waits."""

    caller: Caller
    is_there: Callable[[], bool]


class RightsRow(Protocol):
    """From where, through which listeners, to which units clients may do what; `source` is its place in the config."""

    @property
    def clients(self) -> str:
        """Addresses, or `anywhere`."""

    @property
    def through(self) -> str:
        """Names of listeners, or `any listener`."""

    @property
    def units(self) -> str:
        """Numbers, or `all`."""

    @property
    def may(self) -> str:
        """What they may do."""

    @property
    def source(self) -> str:
        """`gateway.toml:12`; empty for a rule that is no row."""


class Verdict(Protocol):
    """What the rights say to a request."""

    @property
    def is_admitted(self) -> bool:
        """Whether the client is not rejected."""

    @property
    def is_allowed(self) -> bool:
        """Whether it may be sent."""

    @property
    def is_routed(self) -> bool:
        """Whether there is such a unit for this client."""

    @property
    def may(self) -> str:
        """All that the client may do with the unit."""

    @property
    def rows(self) -> Sequence[RightsRow]:
        """The rows that say so; none if no row applies."""


class Finding(Protocol):
    """What doctor has found; `level` is `ok`, `note` or `fix`."""

    @property
    def level(self) -> str:
        """How bad it is."""

    @property
    def about(self) -> str:
        """A port, line, unit or client."""

    @property
    def unit(self) -> str:
        """The name of the unit that it is about; empty otherwise."""

    @property
    def what(self) -> str:
        """What is so."""

    @property
    def remedy(self) -> str:
        """What mends it: a command, or a line of the config."""


class Report(Protocol):
    """What doctor has found `at` this time of the day, by order of somebody, within `took` seconds."""

    @property
    def at(self) -> float:
        """When it was known, in seconds since 1970."""

    @property
    def by(self) -> str:
        """Who ordered it."""

    @property
    def took(self) -> float:
        """How long that took."""

    @property
    def groups(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        """The findings by line; under no name those about clients."""


class ConfigView(Protocol):
    """The config that is in use, and the file as it is now; see `operator/config_view.py`."""

    @property
    def file(self) -> str:
        """Its path."""

    @property
    def text(self) -> str:
        """What is in use, without secrets; empty if it is not known."""

    @property
    def problems(self) -> Sequence[Any]:
        """What `check` says of the file as it is now."""

    @property
    def has_errors(self) -> bool:
        """Whether the file cannot be used."""

    @property
    def difference(self) -> Sequence[str]:
        """How the file differs from what is in use, line by line."""

    @property
    def changes(self) -> Any:
        """What a reload would change: names in `added`, `removed`, `changed` and `restart`."""

    @property
    def reloaded(self) -> Any:
        """The outcome of the last reload; None without one."""

    @property
    def at(self) -> float:
        """When that was, in seconds since 1970."""

    @property
    def is_service(self) -> bool:
        """Whether systemd has started the gateway."""


class Doctor(Protocol):
    """Looks for what is wrong."""

    @property
    def is_running(self) -> bool:
        """Whether devices are being asked."""

    @property
    def last(self) -> Report | None:
        """The last examination for which they were."""

    async def measured(self) -> Report:
        """What can be found without asking anybody."""

    def start(self, user: str) -> str:
        """Begin to ask devices, by order of `user`; or why that is not done now."""


class EventSource(Protocol):
    """The events for one reader, or what the trace tells him."""

    @property
    def is_lost(self) -> bool:
        """Whether there were more events than can wait, or what he reads is there no longer: he is to be dropped."""

    async def next(self, patience: float) -> Sequence[str]:
        """The events that wait, as JSON; none if none has come within `patience` seconds."""


class Answers(UnitAnswers, Protocol):
    """What the server tells of the gateway, and what it passes on to it."""

    #: The type of `metrics`, for the response.
    content_type: str
    #: What the API tells, by the names that its document has for it: dataclasses.
    types: Mapping[str, type]
    doctor: Doctor

    @property
    def site(self) -> str:
        """The name of the plant; empty if it has none."""

    async def metrics(self) -> bytes:
        """The metrics, as text."""

    def trouble(self) -> str:
        """Why the gateway is not ready; empty if it is."""

    def failed(self, error: Exception) -> None:
        """An error that nobody foresaw has ended a request."""

    def logged_in(self, client: str, user: str) -> None:
        """Somebody has logged in."""

    def login_failed(self, client: str, user: str) -> None:
        """Somebody has sent a wrong password; `user` is empty if nobody is called so."""

    def users_rejected(self, reason: str) -> None:
        """The file with the users has changed and cannot be used."""

    async def status(self) -> Status:
        """How the gateway is doing: the same object for a second, made with pauses in which the lines work."""

    def past(self, slots: int) -> Past:
        """What lines and units did in the last slots of time, up to the present one."""

    def units(self) -> Sequence[Unit]:
        """Every unit."""

    def unit(self, wanted: int | str) -> Unit:
        """The unit of a number or a name.

        Raises:
            WrongQuestion: there is none.
        """

    async def ask(self, unit: int, pdu: bytes, client: WebClient) -> Answer:
        """Send a request to a unit, as any client's: with its rights, queue and limits."""

    async def reload(self) -> Mapping[str, Any]:
        """Read the config again; the outcome has `problems` if the file was rejected, or a `defect`."""

    async def config(self) -> ConfigView:
        """The config that is in use, and the file as it is now."""

    def trace(self, asked: Traced, host: str, per_second: int | None = None) -> EventSource:
        """What happened, and happens, for a reader at the address `host`.

        Raises:
            WrongQuestion: nothing is kept, or there is no such line, unit or result.
        """

    async def latest(self, asked: Traced, host: str, most: int) -> Sequence[Mapping[str, Any]]:
        """What happened last, the newest first, for a reader at the address `host`; it may raise as `trace` does."""

    def capture(self, asked: Traced, host: str) -> AsyncIterator[bytes]:
        """A capture file of what happened, part by part; the first one may raise as `trace` does."""

    def rights(self) -> Sequence[RightsRow]:
        """The table of rights, of which the first row that applies counts."""

    def entrances(self) -> Sequence[str]:
        """Where clients with an address come in: listeners, and `web`."""

    def verdict(self, host: str, listener: str, unit: int, function: int, role: str) -> Verdict:
        """What the rights say to a request; `role` counts at TLS listeners.

        Raises:
            WrongQuestion: `host` is no address, or there is no such listener.
        """

    def events(self, host: str) -> AbstractContextManager[EventSource]:
        """In its context events come, as a reader at the address `host` may see them."""
