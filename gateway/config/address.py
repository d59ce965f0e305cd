"""Network addresses: `tcp://0.0.0.0:502`, `tcp://[::]:502`, `rtu+tcp://server:4001`."""

import re
from dataclasses import dataclass
from ipaddress import ip_address
from typing import Final

from gateway.config.problem import WrongValue

#: Ports that an address may leave out.
DEFAULT_PORTS: Final = {"tcp": 502, "udp": 502, "tls": 802}

_ADDRESS = re.compile(r"([a-z+]+)://(?:\[([0-9A-Fa-f:.%\w]*)\]|([^\[\]:/@]*))(?::(\d+))?/?")


@dataclass(frozen=True, slots=True)
class Address:
    """A host (a name, or an IP address without brackets) and a port, and what is spoken there."""

    scheme: str
    host: str
    port: int

    @property
    def is_loopback(self) -> bool:
        """Whether only programs on this machine can reach it."""
        try:
            return ip_address(self.host).is_loopback
        except ValueError:
            return self.host == "localhost"

    def __str__(self) -> str:
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"{self.scheme}://{host}:{self.port}"


def parse_address(value: object, schemes: tuple[str, ...]) -> Address:
    """The address that `value` names; one of `schemes` is spoken there.

    Raises:
        WrongValue: `value` is no such address.
    """
    example = f"{schemes[0]}://127.0.0.1:{DEFAULT_PORTS.get(schemes[0], 5020)}"
    match = _ADDRESS.fullmatch(value) if isinstance(value, str) else None
    if match is None:
        raise WrongValue("is no address", f'write it as "{example}"; an IPv6 address stands in brackets')
    scheme, ipv6, name, port = match.groups()
    if scheme not in schemes:
        raise WrongValue(f"{scheme}:// is not known here", f"it can be {', '.join(f'{one}://' for one in schemes)}")
    host = ipv6 if ipv6 is not None else name
    if host in ("", "*"):
        raise WrongValue("names no host", f'"{scheme}://0.0.0.0:{port or 502}" stands for every IPv4 address')
    if port is None and scheme not in DEFAULT_PORTS:
        raise WrongValue("names no port", f'write "{value}:PORT"')
    number = int(port) if port else DEFAULT_PORTS[scheme]
    if number > 65535:
        raise WrongValue(f"port {number} is above 65535")
    return Address(scheme, host, number)
