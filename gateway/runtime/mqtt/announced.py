"""What was announced to brokers: they keep it, so a device or point that is gone must be cleared there.

    {"homeassistant/device/plant-2/silo-1/config": {"weight": "sensor"}, "modbus/plant-2/silo-1": {"": "plain"}}

As brokers keep it, this list outlives reloads and restarts.
"""

from typing import TYPE_CHECKING, Final

from gateway.state.entry_file import EntryFile

if TYPE_CHECKING:
    from gateway.plant.discovery import Announced

FILE_NAME: Final = "home-assistant.json"


class AnnouncedDevices:
    """What was announced and not cleared yet; saved in a `file`, if there is one."""

    def __init__(self, file: EntryFile | None = None) -> None:
        self.file = file
        self._entries: dict[str, dict[str, str]] = {} if file is None else file.read()

    def entries(self) -> "Announced":
        """Return all entries."""
        return dict(self._entries)

    def add(self, announced: "Announced") -> None:
        """Note what is about to be announced, before it is."""
        for topic, components in announced.items():
            self._change(topic, {**self._entries.get(topic, {}), **components})

    def replace(self, now: "Announced") -> None:
        """Note that everything has been cleared except what is announced `now`."""
        for topic in {*self._entries, *now}:
            self._change(topic, dict(now.get(topic, {})))

    def _change(self, topic: str, components: dict[str, str]) -> None:
        if components == self._entries.get(topic, {}):
            return
        self._entries[topic] = components
        if not components:
            del self._entries[topic]
        if self.file is not None:
            self.file.change(topic, components or None)


def is_entry(value: object) -> bool:
    """Return whether this is an entry of the file."""
    return isinstance(value, dict) and all(isinstance(each, str) for each in (*value, *value.values()))
