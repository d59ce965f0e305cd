"""The keys of `[web]`."""

from typing import Annotated

from pydantic import Field

from gateway.config.schema.table import Table
from gateway.config.values.key_types import (
    CredentialFile,
    ListOf,
    Name,
    Networks,
    SocketPath,
    TokenFile,
    TrendDuration,
    WebAddress,
)


class Web(Table):
    """The web page, the HTTP API, and metrics for Prometheus; without this table there are none. See [web](web.md)."""

    bind: WebAddress = Field(
        description="Where to listen: `http://` or `https://`. Clients on this machine read without a password; if "
        "other machines can connect, `users`, `token` or `proxy` must be given."
    )
    certificate: CredentialFile | None = Field(
        None, description="With `https://`: the file with the certificate and its chain (PEM)."
    )
    key: CredentialFile | None = Field(
        None,
        description="With `https://`: the file with the private key (PEM); only its owner and group may read it.",
    )
    users: SocketPath | None = Field(
        None,
        description="The file with the users, and with programs that have a token and a role, made by "
        "`modbus-gateway user`. Changes apply within 5 s.",
    )
    proxy: Networks | None = Field(
        None,
        description="Addresses of reverse proxies that ask for the password: the header `X-Forwarded-User` of their "
        "requests names the user, whose role is that in `users`, otherwise viewer.",
    )
    hosts: Annotated[tuple[Name, ...], ListOf] = Field(
        (), description="Names by which it may be called, beside its addresses and `localhost`."
    )
    token: TokenFile | None = Field(
        None,
        description="The file with the token that programs send for `/metrics` and reads of the API "
        "(`Authorization: Bearer ...`). If it is given, `/metrics` needs it or a login also from this machine.",
    )
    write: bool = Field(
        False,
        description="Whether users and programs with the role `operator` may write coils and registers through it.",
    )
    values: TrendDuration = Field(
        24 * 3600.0,
        description="How long values of points are kept for trends, in `trends.sqlite` in the state directory: up to "
        '`"24 h"` in slots of 1 min, up to `"7 days"` in slots of 10 min; `"0"` = not. At most 32 MiB: then the oldest '
        "are dropped.",
    )
    history: bool = Field(
        True,
        description="Whether the history of units (one day) and lines (one week) is kept in `history.sqlite` in the "
        "state directory. If not, it is lost at a restart, and so are trends.",
    )
