"""The addresses of listeners and clients as text."""

from typing import Final

IPV4_MAPPED: Final = "::ffff:"


def url(scheme: str, host: str, port: int) -> str:
    """Format a listener's address: `tcp://127.0.0.1:5020`."""
    return f"{scheme}://{join_host_port(host, port)}"


def show_host(host: str) -> str:
    """Format a peer's address; that of an IPv4 client on an IPv6 socket as IPv4: `10.0.0.7`."""
    return host.removeprefix(IPV4_MAPPED) if "." in host else host


def join_host_port(host: str, port: int) -> str:
    """Join host and port: `10.0.0.7:502`, `[fe80::1]:502`."""
    host = show_host(host)
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def split_host(client: str) -> str:
    """Return the host of a result of `join_host_port`; a text without a port is returned as it is."""
    host, _, port = client.rpartition(":")
    return host.strip("[]") if port.isdecimal() else client
