"""The keys of `[self]`, `[control]`, `[trace]` and `[log]`: the gateway itself."""

from typing import Literal

from pydantic import Field

from gateway.config.schema.table import Table
from gateway.config.values.key_types import (
    OwnUnit,
    Size,
    SocketPath,
)
from gateway.config.values.size import DEFAULT_RING


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
