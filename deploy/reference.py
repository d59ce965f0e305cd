"""Writes docs/configuration.md: `python -m deploy.reference > docs/configuration.md`."""

import sys
from collections.abc import Iterator, Mapping, Sequence
from inspect import getdoc
from types import NoneType
from typing import Annotated, Any, Final, Literal, get_args, get_origin

from pydantic.fields import FieldInfo

from gateway.config.documents.json_schema import default_text
from gateway.config.schema.config import INCLUDE, Config
from gateway.config.schema.table import Table, keys_of, row_model
from gateway.config.values.kind import Kind

SMALLEST: Final = """\
[[line]]
port   = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0"
baud   = 19200
format = "8E1"
"""

EXAMPLE: Final = """\
[[listen]]                       # where clients connect
name    = "scada"
bind    = "tcp://[::]:502"
unit0   = "broadcast"            # a write to unit 0 goes to every device and image, without a response

[[line]]                         # an RS-485 line with six devices of three kinds
name    = "hall-a"
port    = "/dev/serial/by-id/usb-FTDI_FT232R_USB_UART_A50285BI-if00-port0"
baud    = 19200
format  = "8E1"
devices = [                      # unit = address on the line, as = unit ID for clients
  { unit = 1, as = 41, name = "silo-1", profile = "weigher" },
  { unit = 6, as = 46, name = "press",  profile = "v80", timeout = "400 ms" },
  { unit = "10-13", as = "110-113", name = "drive-*", profile = "generic" },
]

[[line]]                         # an ASCII line for a motion controller
name    = "axis"
port    = "/dev/ttyS1"
mode    = "ascii"
format  = "7E1"
profile = "mint"
devices = [{ unit = 2 }]

[[image]]                        # a register map in the gateway, shared by all clients
unit    = 200
name    = "shift-data"
holding = 100
coils   = 16
initial.holding = [{ at = 0, values = [1, 2, 3] }]

[[line]]                         # an old HMI is the client on this line, the gateway its server
name    = "panel"
port    = "/dev/ttyS2"
mode    = "ascii"
format  = "7E1"
role    = "server"
serves  = [41, 46, 200]

[profile.slow-drive]             # a kind of device of your own, for `profile` of a line or a device
title     = "Drive with a slow processor"
functions = [3, 6, 16]           # others are answered 01 and not sent
limits    = { 3 = 20 }           # its manual allows 20 registers in a request
timing    = [                    # from its manual: 15 ms for one register, 60 ms for 20
  { fc = 3, items = 1, time = "15 ms" }, { fc = 3, items = 20, time = "60 ms" },
]
timeout   = "500 ms"             # for functions that are not in `timing`
points    = [                    # what its registers mean: modbus-gateway read UNIT speed
  { name = "speed", holding = 10, type = "int32", swap = "words", scale = 0.1, unit = "rpm", write = true },
  { name = "state", holding = 8, labels = { 0 = "off", 1 = "running", 7 = "fault" } },
]
"""

_OPENING: Final = f"""\
# Configuration

<!-- Made by `python -m deploy.reference` from gateway/config/schema: change the text there. -->

The gateway reads one [TOML](https://toml.io) file: `/etc/modbus-gateway/gateway.toml`, or `FILE` in
`modbus-gateway run FILE`. The smallest useful file has one port and its settings:

```toml
{SMALLEST}```

Local clients then connect to `tcp://127.0.0.1:5020`, and every unit ID from 1 to 247 is passed through to the line.
`listen = []` at the top of the file says that no client connects by TCP or UDP.

- `modbus-gateway ports` lists the serial ports of the machine.
- `modbus-gateway check FILE` prints every error with line and column, and checks ports and addresses without opening
  them. Then it shows the effect of the file: listeners, the device behind each unit ID, access rights, and the longest
  time that a client may have to wait. Set the time-outs of your clients above that.

In a checkout, the command is `./deploy/go` instead of `modbus-gateway`.

An editor with a TOML language server ([Taplo](https://taplo.tamasfe.dev); in VS Code, *Even Better TOML*) completes
keys, shows what they mean and marks mistakes if it has the schema. Write it beside the config, and name it in the first
line:

    modbus-gateway check --schema > gateway.schema.json

```toml
#:schema ./gateway.schema.json
```

## An example

```toml
{EXAMPLE}```

## How values are written

| value | written |
|---|---|
| duration | text with a unit: `"250 ms"`, `"10 min"`, `"1 h"`, `"7 days"`; at least 1 ms. `"0"` only where stated |
| units | a number `7`, a range `"10-13"`, or a list of both: `["10-13", 20]`; 1-247, and up to 255 where stated |
| addresses | protocol addresses from 0: a count `100` (0-99), `"1-99"`, `"0x0100-0x01FF"`, or a list; 40001 is 0 |
| address | `"tcp://host:port"`, or `"tcp://host"` for port 502; IPv6 in brackets: `"tcp://[::1]:502"` |
| path | the path of a file; a relative one counts from the folder of the config, not from the working directory |
| format | data bits, parity, stop bits, in quotes: `"8E1"`, `"8N2"`, `"7O1"` |

Unknown keys are errors.

## Time limits

A device must have responded, after the last character of the request was sent, within

    transmission time of the longest expected response + margin x timing(function, items) + latency

Between the points of `timing` the time is interpolated. Below the first point it is constant; above the last point the
last slope continues. A `timeout` replaces `margin x timing`: that of a device always, that of a profile for functions
that are not in its `timing`. `modbus-gateway profile NAME` prints the limits of a profile.
"""

_PROFILES: Final = """\
## Where profiles come from

`profile = "NAME"` means the first of these that there is:

1. `[profile.NAME]` in the config,
2. `profiles/NAME.toml` beside the config,
3. `/etc/modbus-gateway/profiles/NAME.toml`, for all configs of the machine,
4. a [shipped profile](profiles/index.md).

A file has one kind of device, in a table `[profile.NAME]` as in a config, and is called `NAME.toml`.

- `modbus-gateway profile list` shows all profiles, each with its place and what it hides.
- `modbus-gateway profile add FILE` checks a file and puts it into `/etc/modbus-gateway/profiles`.
- A change of a file takes effect with `modbus-gateway reload`, as one of the config does.
- The gateway only reads the files of profiles that are in use. `check` warns of others that are broken.
"""

_PLAIN: Final[Mapping[Any, str]] = {int: "number", float: "number", str: "text", bool: "`true` or `false`"}


def document() -> str:
    """Write the whole page."""
    parts = [_OPENING, *_sections(), _PROFILES]
    return "\n".join(parts)


def _sections() -> Iterator[str]:
    told: dict[type[Table], str] = {}
    site, include = (Config.model_fields[key].description for key in ("site", INCLUDE))
    yield f"## Every key\n\nAt the top of the file:\n\n- `site`, text. {site}\n- `include`, a list of text. {include}\n"
    for key, field in zip(keys_of(Config), Config.model_fields.values(), strict=True):
        model = row_model(field.annotation)
        if model is not None:
            yield f"### `{_heading(key, field)}`\n\n{getdoc(model)}\n\n{_keys(model)}"
            yield from _inner_tables(model, key, told)


def _heading(key: str, field: FieldInfo) -> str:
    """Write the heading of a section."""
    kind = get_origin(field.annotation)
    return f"[[{key}]]" if kind is tuple else f"[{key}.NAME]" if kind is Mapping else f"[{key}]"


def _inner_tables(model: type[Table], path: str, told: dict[type[Table], str]) -> Iterator[str]:
    """Describe the tables inside a table: keys with the same type together, and each kind of table once."""
    inner: dict[type[Table], list[str]] = {}
    for key, field in zip(keys_of(model), model.model_fields.values(), strict=True):
        row = row_model(field.annotation)
        if row is not None:
            inner.setdefault(row, []).append(f"{path}.{key}")
    for row, paths in inner.items():
        named = ", ".join(f"`{one}`" for one in paths)
        if row in told:
            yield f"#### In {named}\n\nAs in {told[row]}.\n"
        else:
            told[row] = named
            yield f"#### In {named}\n\n{getdoc(row)}\n\n{_keys(row)}"
            yield from _inner_tables(row, paths[0], told)


def _keys(model: type[Table]) -> str:
    rows = [
        f"| `{key}` | {_kind(field.annotation, field.metadata)} | {_default(field)} | {field.description} |"
        for key, field in zip(keys_of(model), model.model_fields.values(), strict=True)
    ]
    return "\n".join(["| key | value | default | meaning |", "|---|---|---|---|", *rows, ""])


def _kind(annotation: Any, metadata: Sequence[Any] = ()) -> str:
    """Name a type."""
    named = next((one.name for one in metadata if isinstance(one, Kind)), None)
    if named is not None:
        return str(named)
    if annotation in _PLAIN:
        return _PLAIN[annotation]
    if row_model(annotation) is not None:
        return "table" if isinstance(annotation, type) else "list of tables"
    return _kind_of_compound(get_origin(annotation), get_args(annotation))


def _kind_of_compound(origin: Any, parts: tuple[Any, ...]) -> str:
    if origin is Annotated:
        return _kind(parts[0], parts[1:])
    if origin is Literal:
        return " or ".join(f'`"{choice}"`' for choice in parts)
    if origin is tuple:
        item = _kind(parts[0])
        return f"list of {item}" if item.endswith("`") else f"list of {item}s"
    return " or ".join(_kind(part) for part in parts if part is not NoneType)


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**must be given**"
    text = default_text(field)
    return text and f"`{text}`"


if __name__ == "__main__":
    sys.stdout.write(document())
