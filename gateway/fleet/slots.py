"""Limits on requests of other sites under way: in all, of each site, of each client there."""

from typing import Final

#: The most requests under way of one sender, and of all.
MOST_OF_SENDER: Final = 64
MOST: Final = 1024
#: The most clients of one sender that take turns with local clients. Further ones share one more turn.
MOST_CLIENTS: Final = 16
#: The shared bucket for further clients; cannot occur in a header.
_OTHERS: Final = "\n"


class Slot:
    """A `client` of another site, its number there, and the number of its requests under way."""

    __slots__ = ("client", "number", "sender", "under_way")

    def __init__(self, sender: str, client: str, number: int) -> None:
        self.sender = sender
        self.client = client
        self.number = number
        self.under_way = 0


class Slots:
    """The slots in use, and the number of requests under way in all of them."""

    def __init__(self) -> None:
        self.under_way = 0
        #: By sender, then by the sender's name of the client.
        self._slots: dict[str, dict[str, Slot]] = {}

    def take(self, sender: str, told_client: str) -> Slot | None:
        """Count one more request of a client. Return its slot; None if too many are under way."""
        slots = self._slots.get(sender) or {}
        if self.under_way >= MOST or sum(slot.under_way for slot in slots.values()) >= MOST_OF_SENDER:
            return None
        client = told_client if told_client in slots or len(slots) < MOST_CLIENTS else _OTHERS
        slot = slots.get(client)
        if slot is None:
            taken = {each.number for each in slots.values()}
            number = next(each for each in range(1, MOST_CLIENTS + 2) if each not in taken)
            slot = slots[client] = Slot(sender, client, number)
            self._slots[sender] = slots
        slot.under_way += 1
        self.under_way += 1
        return slot

    def give_back(self, slot: Slot) -> None:
        """Count the end of a request."""
        slots = self._slots[slot.sender]
        slot.under_way -= 1
        self.under_way -= 1
        if not slot.under_way:
            del slots[slot.client]
        if not slots:
            del self._slots[slot.sender]
