"""Who may do what, as long as the config names no rights: clients on this machine write, all others only read."""

from ipaddress import IPv6Address, ip_address

from gateway.modbus.codes import READING_FUNCTIONS, READING_IDENTIFICATION


def may_write(host: str) -> bool:
    """Whether a client from the address `host` may change devices: from loopback only, `::ffff:127.0.0.1` included."""
    address = ip_address(host)
    if isinstance(address, IPv6Address) and address.ipv4_mapped is not None:
        address = address.ipv4_mapped
    return address.is_loopback


def allows(may_write: bool, pdu: bytes) -> bool:  # noqa: FBT001 - a right is a truth value
    """Whether the request is within the client's rights; whatever is not known to only read is a write."""
    return may_write or pdu[0] in READING_FUNCTIONS or pdu.startswith(READING_IDENTIFICATION)
