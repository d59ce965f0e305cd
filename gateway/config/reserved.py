"""What [[access]] calls ways to the gateway that no [[listen]] names."""

from typing import Final

CONTROL: Final = "control"
WEB: Final = "web"
MQTT: Final = "mqtt"
FLEET: Final = "fleet"
RESERVED: Final = {
    CONTROL: "the control socket",
    WEB: "the web page and its API",
    MQTT: "the client of the MQTT broker",
    FLEET: "the other sites",
}
