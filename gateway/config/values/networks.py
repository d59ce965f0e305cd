"""Networks and addresses of clients, and the sites beside them."""

from ipaddress import IPv4Network, IPv6Network, ip_interface, ip_network
from typing import Final

from gateway.config.problem import WrongValue
from gateway.config.values.site import Site, is_site

_IPV4_MAPPED: Final = IPv6Network("::ffff:0:0/96")


def parse_networks(value: object) -> tuple[IPv4Network | IPv6Network, ...]:
    """Parse networks such as "10.2.0.0/24", or single addresses."""
    return tuple(map(_network, _list(value)))


def parse_networks_or_sites(value: object) -> tuple[IPv4Network | IPv6Network | Site, ...]:
    """Parse networks, single addresses, or the names of sites."""
    return tuple(
        Site(each) if isinstance(each, str) and is_site(each) and not each.isdecimal() else _network(each)
        for each in _list(value)  # one of digits only is an address with its dots forgotten
    )


def _list(value: object) -> list[object]:
    if not isinstance(value, list):
        raise WrongValue("must be a list", 'write it as ["10.2.0.0/24"]')
    return value


def _network(text: object) -> IPv4Network | IPv6Network:
    if not isinstance(text, str):
        raise WrongValue(f"{text} is not a valid network", 'write it as "10.2.0.0/24"')
    try:
        interface = ip_interface(text)
    except ValueError as wrong:
        raise WrongValue(f'"{text}" is not a valid network', 'write it as "10.2.0.0/24" or "10.2.0.7"') from wrong
    network = interface.network
    if interface.ip != network.network_address:
        what = f'"{text}" is an address in the network {network}, and not that network'
        raise WrongValue(what, f'write "{network}" for all of it, or "{interface.ip}" for that address')
    return _plain_ipv4(network)


def _plain_ipv4(network: IPv4Network | IPv6Network) -> IPv4Network | IPv6Network:
    """Turn IPv4 networks that are written as IPv6 ones into IPv4: such clients of an IPv6 listener are IPv4 clients."""
    if network.version == 6 and network.prefixlen >= _IPV4_MAPPED.prefixlen and network.subnet_of(_IPV4_MAPPED):
        return ip_network((int(network.network_address) & 0xFFFFFFFF, network.prefixlen - _IPV4_MAPPED.prefixlen))
    return network
