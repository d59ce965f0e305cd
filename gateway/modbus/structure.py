"""How a request is refused whose bytes are against the specification."""

from gateway.errors import IllegalDataValue, RequestError


def need(
    fits: bool,  # noqa: FBT001 - reads as the rule it states
    pdu: bytes,
    rule: str,
    error: type[RequestError] = IllegalDataValue,
) -> None:
    """Say that `pdu` breaks `rule`, unless it fits.

    Raises:
        RequestError: `error`, when it does not fit; the message shows the rule and the bytes.
    """
    if not fits:
        raise error(f"function {pdu[0]:02d}: {rule}: {pdu.hex(' ').upper()}")
