"""Decides when the next message with kept readings is sent, after all others. Times are seconds of any clock."""

from collections.abc import Callable
from dataclasses import replace
from typing import Final, Protocol

from gateway.plant.kept.backlog import Batch
from gateway.plant.kept.unconfirmed import Holds, Unconfirmed
from gateway.plant.messages import Form, Message, Reading, Readings, Record

#: The least time between two of these messages, and that before one is sent again which the broker has refused for now.
PAUSE: Final = 0.1
REFUSED_PAUSE: Final = 30.0
#: How long after the birth the first one is sent: if the broker was restarted, its readers connect again meanwhile.
SETTLING: Final = 3.0
#: About the largest and the smallest of these messages, in bytes. A slow network, or a broker that takes small messages
#: only, must not lose its connection by them again and again.
LARGEST: Final = 32_000
SMALLEST: Final = 1_000
#: A message that is confirmed within so many seconds is followed by one of twice the size, any other by one of half.
QUICKLY: Final = 1.0


class Keeps(Holds, Protocol):
    """What keeps readings: see Keeper."""

    def take(self, may_tell: Callable[[str], bool], room: int) -> Batch | None:
        """Return the next records to send; None if there are none at present."""

    def sent(self, batch: Batch) -> None:
        """Forget a batch: it was confirmed."""

    def give_up(self, batch: Batch) -> None:
        """Forget a batch that cannot be sent."""

    def rewind(self) -> None:
        """Send again what was not confirmed: the connection is lost."""


class History:
    """Kept readings as messages of a form, one at a time. A reading that the birth has told is not sent again."""

    def __init__(self, keeps: Keeps, form: Form) -> None:
        self._keeps = keeps
        self._unconfirmed = Unconfirmed(keeps)
        self._form = form
        #: What the births have told, and what was left out for those that are not confirmed yet.
        self._told: dict[str, Readings] = {}
        self._left_out: dict[str, dict[str, Reading]] = {}
        self._room = self._most = 4 * SMALLEST
        self._sent_at = 0.0
        #: When the next message may be sent; None while there is no connection.
        self._next_at: float | None = None
        #: Whether there was nothing to send.
        self._is_idle = False
        self._message: Message | None = None
        self._batch = Batch("")

    def keep(self, device: str, readings: Readings) -> None:
        """Keep readings of a device."""
        if readings:
            self._unconfirmed.hold(device)
            self._keeps.keep(device, readings)
            self._is_idle = False

    def telling(self, message: Message, now: float) -> None:
        """Note that a message is published which tells new readings."""
        self._unconfirmed.sent(message, now)

    def hold_slow(self, now: float) -> None:
        """Keep the readings for which the broker takes long, as they may be lost with the gateway."""
        self._unconfirmed.hold_slow(now)

    def look(self) -> None:
        """Note that there may be something to send again."""
        self._is_idle = False

    def born(self, device: str, readings: Readings) -> None:
        """Note the readings that a birth tells."""
        self._told[device] = readings
        self._left_out.setdefault(device, {})

    def confirmed_birth(self, device: str) -> None:
        """Note that the broker has the last birth of a device."""
        self._left_out.pop(device, None)

    def refused_birth(self, device: str) -> None:
        """Note that the broker has refused the birth of a device: what it has told is sent."""
        self._told.pop(device, None)
        self.keep(device, self._left_out.pop(device, {}))

    def begin(self, now: float, largest: int) -> None:
        """Begin to send: the birth is confirmed. The broker takes messages of `largest` bytes."""
        self._most = min(LARGEST, largest // 2)
        self._next_at, self._is_idle = now + SETTLING, False

    def end(self) -> None:
        """Send no more: the connection is lost. The new readings of all that is not confirmed are kept."""
        self._unconfirmed.end()
        if self._message is not None:
            self._resize(1 / 4)
        self._next_at = self._message = None
        self._told.clear()
        for device in list(self._left_out):
            self.keep(device, self._left_out.pop(device))
        self._keeps.rewind()

    def deadline(self) -> float | None:
        """Return when the next message may be sent; None while there is none, or one is not confirmed."""
        return None if self._is_idle or self._message is not None else self._next_at

    def take(self, now: float, at: float) -> Message | None:
        """Return the next message, if it is time for one and there is something to tell. `at` is the Unix time."""
        due = self.deadline()
        if due is None or now < due:
            return None
        while (batch := self._keeps.take(self._form.may_tell, min(self._room, self._most))) is not None:
            records = [self._untold(batch.device, record) for record in batch.records]
            batch.records = records = [record for record in records if record.values]
            message = self._form.history(batch.device, records, at) if records else None
            if message is not None:
                self._batch, self._message, self._sent_at = batch, message, now
                return message
            (self._keeps.give_up if records else self._keeps.sent)(batch)
        self._is_idle = True
        return None

    def confirmed(self, message: Message, now: float) -> None:
        """Note that the broker has a message."""
        if message is self._message:
            self._keeps.sent(self._batch)
            self._resize(2 if now - self._sent_at < QUICKLY else 1 / 2)
            self._message, self._next_at = None, now + PAUSE
        elif self._unconfirmed.answered(message):
            self._is_idle = False

    def refused(self, message: Message, now: float, *, is_passing: bool) -> bool:
        """Note that the broker has refused a message, for now or for ever; tell whether it is one of these.

        If another one is refused for now, its new readings are kept.
        """
        if message is not self._message:
            self._unconfirmed.answered(message)
            if is_passing:
                self.keep(message.device, message.told)
            return False
        if is_passing:
            self._keeps.rewind()
        else:
            self._keeps.give_up(self._batch)
        self._message, self._next_at = None, now + (REFUSED_PAUSE if is_passing else PAUSE)
        return True

    def _resize(self, factor: float) -> None:
        self._room = max(SMALLEST, min(LARGEST, round(self._room * factor)))

    def _untold(self, device: str, record: Record) -> Record:
        """Leave out the readings that the birth has told."""
        told = self._told.get(device, {})
        again = {name: told[name] for name in record.values if name in told and told[name].at == record.at}
        if not again:
            return record
        if device in self._left_out:
            self._left_out[device].update(again)
        return replace(record, values={name: value for name, value in record.values.items() if name not in again})
