"""The topics of plain messages: `modbus/SITE/DEVICE` and those below it."""

from dataclasses import dataclass
from typing import Final

_ROOT: Final = "modbus"


@dataclass(frozen=True, slots=True)
class Topics:
    """The topics of a site."""

    site: str

    @property
    def status(self) -> str:
        """Whether the gateway is connected."""
        return f"{_ROOT}/{self.site}/status"

    def values(self, device: str) -> str:
        """The last values of a device."""
        return f"{_ROOT}/{self.site}/{device}"

    def availability(self, device: str) -> str:
        """Whether a device answers."""
        return f"{self.values(device)}/availability"

    def setting(self, device: str, point: str) -> str:
        """Takes values for a point."""
        return f"{self.values(device)}/{point}/set"

    def result(self, device: str, point: str) -> str:
        """What became of a value for a point."""
        return f"{self.values(device)}/{point}/result"
