"""Network addresses: `tcp://0.0.0.0:502`, `tcp://[::]:502`, `rtu+tcp://server:4001`."""

import re
from dataclasses import dataclass
from ipaddress import IPv4Address, IPv6Address, ip_address
from typing import Final

from gateway.config.problem import WrongValue

#: Ports that an address may leave out.
DEFAULT_PORTS: Final = {
    "tcp": 502,
    "udp": 502,
    "tls": 802,
    "mqtt": 1883,
    "mqtts": 8883,
    "ws": 80,
    "wss": 443,
    "nats": 4222,
}

_ADDRESS = re.compile(r"([a-z+]+)://(?:\[([^\[\]/@]*)\]|([^\[\]:/@]*))(?::([0-9]{1,20}))?/?")
_LABEL = r"(?!-)[A-Za-z0-9_-]{1,63}(?<!-)"
_HOST_NAME = re.compile(rf"{_LABEL}(?:\.{_LABEL})*")
#: The network interface behind an IPv6 address, fe80::1%eth0: as long as Linux lets its name be (IFNAMSIZ).
_INTERFACE = re.compile(r"[!-~]{1,15}")
#: What `localhost` stands for (RFC 6761, 6.3).
_LOCALHOST: Final = (ip_address("127.0.0.1"), ip_address("::1"))


@dataclass(frozen=True, slots=True)
class Address:
    """A protocol, a host (a name, or an IP address without brackets) and a port."""

    scheme: str
    host: str
    port: int

    @property
    def is_wildcard(self) -> bool:
        """Tell whether it stands for every IPv4 or every IPv6 address of this machine."""
        ip = _ip(self.host)
        return ip is not None and ip.is_unspecified

    def has_port_of(self, other: "Address") -> bool:
        """Tell whether both have the same port. Port 0 is a different one each time; UDP and TCP ports are distinct."""
        return self.port != 0 and (self.scheme == "udp", self.port) == (other.scheme == "udp", other.port)

    def collides_with(self, other: "Address") -> bool:
        """Tell whether both cannot be bound: they are the same, or one is a wildcard that includes the other.

        IPv4 and IPv6 have separate ports: 0.0.0.0 and [::] can both be bound. `localhost` is bound in both.
        """
        if not self.has_port_of(other):
            return False
        mine, others = _bound_ips(self.host), _bound_ips(other.host)
        if not mine or not others:
            return self.host.lower() == other.host.lower()
        return any(_overlap(one, another) for one in mine for another in others)

    def is_reached_by(self, other: "Address") -> bool:
        """Tell whether a client that connects to `other` reaches a listener at this address, as far as can be seen."""
        if not self.collides_with(other) and not self.takes_ipv4_of(other):
            return False
        return not self.is_wildcard or other.is_wildcard or other.is_loopback

    def takes_ipv4_of(self, other: "Address") -> bool:
        """Tell whether it is [::], which takes IPv4 clients too, and `other` an IPv4 address with the same port."""
        if not self.has_port_of(other):
            return False
        mine, others = _ip(self.host), _ip(other.host)
        if mine is None or others is None:
            return False
        return mine.is_unspecified and (mine.version, others.version) == (6, 4)

    @property
    def ip_version(self) -> int | None:
        """Tell 4 or 6; None for a name, which may stand for addresses of both kinds."""
        ip = None if self.host == "localhost" else _ip(self.host)
        return None if ip is None else ip.version

    @property
    def is_loopback(self) -> bool:
        """Tell whether only programs on this machine can reach it."""
        ip = _ip(self.host)
        return ip is not None and ip.is_loopback

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


#: Those of device servers, whose bytes go straight to a line.
_RAW: Final = frozenset({"rtu+tcp", "ascii+tcp"})


def _elsewhere(scheme: str, schemes: tuple[str, ...]) -> str:
    """Say where an address with this scheme belongs, if it was taken for that of a line, or of another server."""
    if scheme in ("tcp", "tls") and set(schemes) == _RAW:
        return "; a Modbus TCP server belongs in [[upstream]], as `to`"
    if scheme in _RAW and "fleet" in schemes:
        return "; a device server belongs in [[line]], as `port`"
    return ""


def parse_address(value: object, schemes: tuple[str, ...]) -> Address:
    """Parse an address with one of `schemes`."""
    example = f"{schemes[0]}://127.0.0.1:{DEFAULT_PORTS.get(schemes[0], 5020)}"
    match = _ADDRESS.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise WrongValue("is not a valid address", f'write it as "{example}"; an IPv6 address needs brackets')
    scheme, ipv6, name, port = match.groups()
    if scheme not in schemes:
        usable = ", ".join(f"{one}://" for one in schemes)
        raise WrongValue(f"unknown protocol {scheme}://", f"it can be {usable}{_elsewhere(scheme, schemes)}")
    host = ipv6 if ipv6 is not None else name
    if host in ("", "*"):
        raise WrongValue("names no host", f'"{scheme}://0.0.0.0:{port or 502}" stands for every IPv4 address')
    _check_host(host, in_brackets=ipv6 is not None)
    host = _plain_ipv4(host)
    if port is None and scheme not in DEFAULT_PORTS:
        raise WrongValue("names no port", f'write "{value}:PORT"')
    number = int(port) if port else DEFAULT_PORTS[scheme]
    if number > 65535:
        raise WrongValue(f"port {number} is above 65535")
    return Address(scheme, host, number)


def _check_host(host: str, *, in_brackets: bool) -> None:
    if in_brackets:
        ip = _ip(host)
        if not isinstance(ip, IPv6Address) or (ip.scope_id and _INTERFACE.fullmatch(ip.scope_id) is None):
            raise WrongValue(f"{host!a} is not a valid IPv6 address", "such as [::1] or [fe80::1%eth0]")
    elif host.replace(".", "").isdecimal():
        if _ip(host) is None:
            raise WrongValue(f'"{host}" is not a valid IPv4 address', "four numbers from 0 to 255, such as 10.2.0.7")
    elif _HOST_NAME.fullmatch(host) is None:
        remedy = "letters, digits and hyphens, in parts joined by single dots, such as plc.example"
        raise WrongValue(f"{host!a} is not a valid host name", remedy)


def _plain_ipv4(host: str) -> str:
    """Turn an IPv4 address that is written as an IPv6 one into IPv4, which can be bound; leave others as they are."""
    ip = _ip(host)
    return str(ip.ipv4_mapped) if isinstance(ip, IPv6Address) and ip.ipv4_mapped is not None else host


def _ip(host: str) -> IPv4Address | IPv6Address | None:
    """Read `host` as an IP address; None for a name."""
    try:
        return ip_address("127.0.0.1" if host == "localhost" else host)
    except ValueError:
        return None


def _bound_ips(host: str) -> tuple[IPv4Address | IPv6Address, ...]:
    """List what is bound for `host`; nothing is known of a name."""
    ip = _ip(host)
    return _LOCALHOST if host == "localhost" else () if ip is None else (ip,)


def _overlap(one: IPv4Address | IPv6Address, other: IPv4Address | IPv6Address) -> bool:
    return one.version == other.version and (one == other or one.is_unspecified or other.is_unspecified)
