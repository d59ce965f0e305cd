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

    @property
    def folder(self) -> str:
        """What all topics of the site begin with."""
        return f"{_ROOT}/{self.site}/"

    def values(self, device: str) -> str:
        """The last values of a device."""
        return f"{self.folder}{device}"

    def device(self, topic: str) -> str | None:
        """The device whose last values have this topic; None if it is another topic."""
        name = topic.removeprefix(self.folder)
        return name if name != topic and "/" not in name else None

    def availability(self, device: str) -> str:
        """Whether a device answers."""
        return f"{self.values(device)}/availability"

    def setting(self, device: str, point: str) -> str:
        """Takes values for a point."""
        return f"{self.values(device)}/{point}/set"

    def result(self, device: str, point: str) -> str:
        """What became of a value for a point."""
        return f"{self.values(device)}/{point}/result"
