"""The keys of `[[access]]`."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.table import FunctionNumber, Table
from gateway.config.values.key_types import ListOf, Name, NetworksOrSites, RangesOfRow, Role, UnitsOrAll


class Access(Table):
    """Access rights. First match wins, by client, unit and address; no match means denied."""

    networks: NetworksOrSites | None = Field(
        None,
        alias="from",
        description='Networks or addresses of the clients; with `listen = ["fleet"]` the sites. Default: all.',
    )
    listen: Annotated[tuple[Name, ...], ListOf] | None = Field(
        None,
        description="Names of listeners, server lines, `control`, `web`, `mqtt`, `fleet` or `embedded`. Default: all. "
        "A server line, the control socket, the web page, the MQTT client and a program with its units in Python "
        "(`embedded`) keep their rights until a row names them. UDP clients can write only through a row that names "
        "their listener, other sites through one that names `fleet`. A row names either listeners for one line or "
        "upstream, or others.",
    )
    role: Role | None = Field(
        None,
        description='The role in the certificate of a TLS client; `""` for one without a role. For clients of `tls://` '
        "a row without this key counts only if it names the listener.",
    )
    units: UnitsOrAll = Field(
        "all",
        description="Unit IDs for clients, 1-255; in a row that names a listener for one line, addresses on "
        "that line, and in one that names a listener for one upstream, unit IDs of that server, 0-255. A broadcast "
        "needs the right at every unit.",
    )
    allow: Annotated[tuple[Literal["read", "write"], ...], ListOf] | None = Field(
        None,
        description="What is allowed; alternatively use `functions`. `read`: functions 1, 2, 3, 4, 7, 11, 12, 17, 20, "
        "24 and 43/14. `write`: all others. `[]`: nothing.",
    )
    functions: Annotated[tuple[FunctionNumber, ...], ListOf] | None = Field(
        None, description="Functions that are allowed, and no others."
    )
    holding: RangesOfRow | None = Field(
        None,
        description="Holding registers that the row is for. A row with this key or one of the next three is for these "
        "addresses only. Each address of a request counts by itself: for each the first matching row decides, and each "
        "of them must allow the function. What may write without telling its addresses (8, 21, 43, 65-72, 100-110 and "
        "unknown functions) is also refused by earlier rows for addresses that do not allow it. Reads without such "
        "addresses (7, 11, 12, 17, 20, 24, 43/14) pass by rows for addresses.",
    )
    input: RangesOfRow | None = Field(None, description="Input registers that the row is for.")
    coils: RangesOfRow | None = Field(None, description="Coils that the row is for.")
    discrete: RangesOfRow | None = Field(None, description="Discrete inputs that the row is for.")
    priority: Literal["normal", "high"] = Field(
        "normal",
        description="`high`: requests that the row allows take their turns first, at most once in a round of the "
        "others.",
    )
