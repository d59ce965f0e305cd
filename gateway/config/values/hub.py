"""Values of the file that `fleet hub` reads."""

from gateway.config.problem import NotText, WrongValue
from gateway.config.values.address import Address
from gateway.config.values.files import check_path
from gateway.config.values.fleet import parse_server
from gateway.config.values.site import parse_lease_name, parse_site


def parse_control(value: object) -> tuple[str, ...]:
    """Parse the site that may ask all others, or a list of several.

    Raises:
        WrongValue: one of them is no name of a site, or there is none.
    """
    names = tuple(map(parse_site, value if isinstance(value, list) else [value]))
    if not names:
        raise WrongValue("names no site", 'such as control = "control"')
    return names


def parse_site_lease(value: object) -> str:
    """Parse a lease that belongs to a site: SITE.NAME.

    Raises:
        WrongValue: it has no site, or cannot be a lease.
    """
    name = parse_lease_name(value)
    if "." not in name:
        raise WrongValue(
            f'"{name}" does not say whose lease it is', f"write SITE.{name}, also in the config of the site"
        )
    return name


def parse_hub_address(value: object) -> Address:
    """Parse the host, and perhaps the port, of the hub.

    Raises:
        WrongValue: it is neither a name nor an address.
    """
    if not isinstance(value, str):
        raise NotText
    if "://" in value:
        raise WrongValue("has a protocol", "write only HOST or HOST:PORT; with certificate and key it is tls://")
    address = parse_server(f"nats://{value}")
    if not address.port:
        raise WrongValue("port 0 is not the port of a server")
    return address


def parse_plain_path(value: object) -> str:
    """Parse the absolute path of a file or folder on another machine.

    Raises:
        WrongValue: it is not absolute, or has characters that cannot be seen.
    """
    if not isinstance(value, str):
        raise NotText
    if not value.startswith("/"):
        raise WrongValue("is not an absolute path", "write it from / on, as it is on the machine that uses it")
    return check_path(value)
