"""What [[access]] calls ways to the gateway that no [[listen]] names."""

from typing import Final

CONTROL: Final = "control"
WEB: Final = "web"
RESERVED: Final = {CONTROL: "the control socket", WEB: "the web page and its API"}
