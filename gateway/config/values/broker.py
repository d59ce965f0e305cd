"""What `[mqtt]` names: the broker, and how values are put into messages."""

from dataclasses import dataclass
from typing import Final

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address, parse_address
from gateway.tls.settings import SecretFile

#: The first level of topics, unless the config says otherwise.
PREFIX: Final = "modbus"
#: The first level of Sparkplug's topics.
SPARKPLUG: Final = "spBv1.0"
#: The longest prefix, in characters: whatever names follow it, a topic is short enough for MQTT.
_LONGEST_PREFIX: Final = 256
#: What Home Assistant listens to unless it is told otherwise.
HOME_ASSISTANT: Final = "homeassistant"
#: Where brokers take WebSocket connections, unless the address says it.
_PATH: Final = "/mqtt"
_SCHEMES: Final = ("mqtt", "mqtts", "ws", "wss")
#: These characters have a meaning in topics.
_IN_TOPICS: Final = frozenset("+#/\0")
_SPARKPLUG_KEYS: Final = ("group", "node", "primary_host")


@dataclass(frozen=True, slots=True)
class Broker:
    """Where a broker is. `path` is for WebSockets only."""

    address: Address
    path: str = ""

    @property
    def is_encrypted(self) -> bool:
        """Tell whether the connection is one of TLS."""
        return self.address.scheme in ("mqtts", "wss")

    def __str__(self) -> str:
        return f"{self.address}{self.path}"


@dataclass(frozen=True, slots=True)
class Sparkplug:
    """Names in Sparkplug B: `node` is empty for that of the site, `primary_host` if no host is waited for."""

    group: str
    node: str = ""
    primary_host: str = ""


def parse_broker(value: object) -> Broker:
    """Parse the address of a broker."""
    if not isinstance(value, str):
        raise NotText
    scheme, _, rest = value.partition("://")
    host, slash, path = rest.partition("/")
    if "@" in host:
        what = "contains a user, which everybody who sees the config can see"
        raise WrongValue(what, "write user and password as keys of their own")
    address = parse_address(f"{scheme}://{host}", _SCHEMES)
    if scheme not in ("ws", "wss"):
        if path:
            raise WrongValue(f"{scheme}:// has no path", f'write "{address}"')
        return Broker(address)
    if not path.isprintable() or " " in path:
        raise WrongValue("has an invalid path")
    return Broker(address, f"{slash}{path}" if path else _PATH)


def parse_password(value: object) -> SecretFile:
    """Parse the file with a password, or the name of a credential that systemd hands to the service."""
    match value:
        case {"file": str(path), **others} if path.isprintable() and path and not others:
            return SecretFile(path)
        case {"credential": str(name), **others} if name.isprintable() and name and "/" not in name and not others:
            return SecretFile(name, is_credential=True)
    remedy = 'write { file = "/etc/modbus-gateway/mqtt.password" }, or { credential = "mqtt" }'
    raise WrongValue("names no file", remedy)


def parse_prefix(value: object) -> str:
    """Parse the first level or levels of topics."""
    if not isinstance(value, str):
        raise NotText
    levels = value.split("/")
    if not all(map(is_topic_part, levels)) or value.startswith("$"):
        what = f'"{value}" cannot be the beginning of topics'
        raise WrongValue(what, "it may have no +, no #, no $ at first, and nothing empty before, behind or between /")
    if len(value) > _LONGEST_PREFIX:
        raise WrongValue(f"must have at most {_LONGEST_PREFIX} characters")
    if levels[0] == SPARKPLUG:
        raise WrongValue(f"topics below {SPARKPLUG} are those of Sparkplug B", "choose another prefix")
    return value


def parse_home_assistant(value: object) -> str | None:
    """Parse the prefix of discovery topics; None without discovery."""
    if isinstance(value, bool):
        return HOME_ASSISTANT if value else None
    if isinstance(value, str):
        return parse_prefix(value)
    raise WrongValue(f'must be true, false or a prefix of topics such as "{HOME_ASSISTANT}"')


def parse_sparkplug(value: object) -> Sparkplug | None:
    """Parse the names in Sparkplug B; None for plain JSON."""
    if value is False:
        return None
    example = 'write { group = "plant-2" }; node and primary_host are possible too'
    if not isinstance(value, dict) or "group" not in value:
        raise WrongValue("must be false or a table with a group", example)
    for key, name in value.items():
        if key not in _SPARKPLUG_KEYS:
            raise WrongValue(f'"{key}" is not a key of this table', example)
        check_topic_part(name, key)
    return Sparkplug(**value)


def check_topic_part(name: object, what: str) -> None:
    """See that a name can be one part of a topic."""
    if not isinstance(name, str) or not is_topic_part(name):
        raise WrongValue(f"{what} must be text without +, # and /")


def is_topic_part(name: str) -> bool:
    """Tell whether a name can be one part of a topic."""
    return bool(name) and name.isprintable() and not set(name) & _IN_TOPICS
