"""A whole config file: its sections, and the keys of the small ones. docs/configuration.md is made from this folder."""

from collections.abc import Mapping
from typing import Annotated, Final, Literal

from pydantic import Field

from gateway.config.schema.access import Access
from gateway.config.schema.add_ons import Fleet, Mqtt, Web
from gateway.config.schema.image import Image
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.table import Table
from gateway.config.schema.upstream import Upstream
from gateway.config.values.duration import DEFAULT_RING
from gateway.config.values.key_types import Include, ListOf, OwnUnit, Size, SocketPath

#: The section of profiles.
PROFILE: Final = "profile"
#: The key that names further files.
INCLUDE: Final = "include"


class Own(Table):
    """The state of the gateway as a unit with [registers](own-registers.md); without this table there is none."""

    unit: OwnUnit = Field(description="Its unit ID for clients, 1-247 or 255.")


class Control(Table):
    """The control socket, which the commands use: `status`, `reload`, `read`, `trace` and others."""

    socket: SocketPath | None = Field(
        None,
        description="Its path. Default: `/run/modbus-gateway/control.sock`; without root "
        "`$XDG_RUNTIME_DIR/modbus-gateway/control.sock`, or `control.sock` beside the config if that is not set. "
        "[Commands](tools.md#which-gateway-a-command-speaks-to) find another path by `--config FILE` or "
        "`--control PATH`.",
    )


class Trace(Table):
    """The last transactions, which are always kept in memory: `modbus-gateway trace` shows them."""

    ring: Size = Field(
        DEFAULT_RING,
        description='How much memory they may take. `"0"`: none is kept, and there is nothing to show.',
    )


class Log(Table):
    """The log on standard error."""

    level: Literal["debug", "info", "warning", "error"] = Field("info", description="The lowest level that is written.")
    format: Literal["auto", "console", "json", "journald"] = Field(
        "auto",
        description="`console`: text. `json`: one object on each line. `journald`: systemd's journal, with a field for "
        "each field of an event. `auto`: `journald` under systemd, otherwise `console`.",
    )


class Config(Table):
    """A whole file."""

    site: str = Field(
        "",
        description="The name of the plant: in the titles of web pages, in the topics of `[mqtt]`, and its name in "
        "`[fleet]`.",
    )
    include: Include = Field(
        (),
        description="Files that are read behind this one, in the order of the list, then of their names. More: "
        "[A config in several files](service.md#a-config-in-several-files).",
    )
    listen: Annotated[tuple[Listen, ...], ListOf] = ()
    line: Annotated[tuple[Line, ...], ListOf] = ()
    image: Annotated[tuple[Image, ...], ListOf] = ()
    upstream: Annotated[tuple[Upstream, ...], ListOf] = ()
    profile: Mapping[str, ProfileTable] = Field({})
    access: Annotated[tuple[Access, ...], ListOf] = ()
    own: Own | None = Field(None, alias="self")
    web: Web | None = None
    mqtt: Mqtt | None = None
    fleet: Fleet | None = None
    trace: Trace = Trace()
    control: Control | None = None
    log: Log = Log()

    @property
    def listens_by_default(self) -> bool:
        """Whether there is the default listener: the file says nothing of any. `listen = []` says there is none."""
        return not self.has("listen")
