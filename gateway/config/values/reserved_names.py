"""What [[access]] calls ways to the gateway that no [[listen]] names."""

from collections.abc import Mapping
from typing import Final

CONTROL: Final = "control"
WEB: Final = "web"
MQTT: Final = "mqtt"
FLEET: Final = "fleet"
EMBEDDED: Final = "embedded"
RESERVED: Final[Mapping[str, str]] = {
    CONTROL: "the control socket",
    MQTT: "the client of the MQTT broker",
    WEB: "the web page and its API",
    FLEET: "the other sites",
    EMBEDDED: "the program that the gateway is a part of",
}
#: Clients that come this way have no address.
WITHOUT_ADDRESSES: Final = (CONTROL, MQTT, EMBEDDED)
