"""A unit as the specification describes it, in dictionaries and by the letter: what an image is compared with."""

from math import ceil

from gateway.modbus.codes import Area


class Refused(Exception):  # noqa: N818 - it is the exception code of a response
    pass


class Model:
    """`items` are the numbers at the addresses that exist, `objects` its identification; it calls itself `name`.

    `log` are the events since the beginning, the oldest first.
    """

    def __init__(self, items: dict[Area, dict[int, int]], name: bytes = b"", objects=None) -> None:
        self.items = items
        self.name = name
        self.objects: dict[int, bytes] = objects or {}
        self.messages = self.exceptions = self.performed = 0
        self.log: list[int] = []

    def answer(self, pdu: bytes) -> bytes:
        self.messages += 1
        self.log.append(0x80)
        response = self._respond(pdu)
        refused = response[0] >= 0x80
        self.exceptions += refused
        self.performed += not refused and pdu[0] not in {11, 12}
        self.log.append(0x41 if refused else 0x40)
        return response

    def _respond(self, pdu: bytes) -> bytes:
        meanings = {
            1: self._read_bits,
            2: self._read_bits,
            3: self._read_registers,
            4: self._read_registers,
            5: self._write_coil,
            6: self._write_register,
            8: self._diagnose,
            11: self._count_events,
            12: self._log_events,
            15: self._write_coils,
            16: self._write_registers,
            17: self._report_name,
            22: self._mask_register,
            23: self._read_write_registers,
            43: self._identify,
        }
        if pdu[0] not in meanings:
            return bytes((pdu[0] | 0x80, 1))
        try:
            return meanings[pdu[0]](pdu)
        except Refused as refused:
            return bytes((pdu[0] | 0x80, refused.args[0]))

    def _read_bits(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 5, 1 <= _word(pdu, 3) <= 2000)
        area = {1: Area.COILS, 2: Area.DISCRETE}[pdu[0]]
        data = bytearray(ceil(_word(pdu, 3) / 8))
        for at, bit in enumerate(self._get(area, _word(pdu, 1), _word(pdu, 3))):
            data[at // 8] |= bit << at % 8
        return bytes((pdu[0], len(data))) + data

    def _read_registers(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 5, 1 <= _word(pdu, 3) <= 125)
        area = {3: Area.HOLDING, 4: Area.INPUT}[pdu[0]]
        return _counted_registers(pdu[0], self._get(area, _word(pdu, 1), _word(pdu, 3)))

    def _write_coil(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 5, _word(pdu, 3) in {0xFF00, 0})
        self._set(Area.COILS, _word(pdu, 1), [int(_word(pdu, 3) == 0xFF00)])
        return pdu

    def _write_register(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 5)
        self._set(Area.HOLDING, _word(pdu, 1), [_word(pdu, 3)])
        return pdu

    def _write_coils(self, pdu: bytes) -> bytes:
        count = _word(pdu, 3)
        _require(len(pdu) > 6, 1 <= count <= 1968, pdu[5:6] == bytes((ceil(count / 8) & 0xFF,)))
        _require(len(pdu) == 6 + pdu[5])
        self._set(Area.COILS, _word(pdu, 1), [pdu[6 + at // 8] >> at % 8 & 1 for at in range(count)])
        return pdu[:5]

    def _write_registers(self, pdu: bytes) -> bytes:
        count = _word(pdu, 3)
        _require(len(pdu) > 6, 1 <= count <= 123, pdu[5:6] == bytes((2 * count & 0xFF,)))
        _require(len(pdu) == 6 + pdu[5])
        self._set(Area.HOLDING, _word(pdu, 1), [_word(pdu, 6 + 2 * at) for at in range(count)])
        return pdu[:5]

    def _mask_register(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 7)
        (current,) = self._get(Area.HOLDING, _word(pdu, 1), 1)
        and_mask, or_mask = _word(pdu, 3), _word(pdu, 5)
        self._set(Area.HOLDING, _word(pdu, 1), [(current & and_mask) | (or_mask & (0xFFFF ^ and_mask))])
        return pdu

    def _read_write_registers(self, pdu: bytes) -> bytes:
        read, count = (_word(pdu, 1), _word(pdu, 3)), _word(pdu, 7)
        _require(len(pdu) > 10, 1 <= read[1] <= 125, 1 <= count <= 121, pdu[9:10] == bytes((2 * count & 0xFF,)))
        _require(len(pdu) == 10 + pdu[9])
        self._get(Area.HOLDING, *read)
        self._set(Area.HOLDING, _word(pdu, 5), [_word(pdu, 10 + 2 * at) for at in range(count)])
        return _counted_registers(pdu[0], self._get(Area.HOLDING, *read))

    def _diagnose(self, pdu: bytes) -> bytes:
        _require(len(pdu) >= 3)
        sub = _word(pdu, 1)
        if sub == 0:
            _require(len(pdu) >= 5, len(pdu) % 2 == 1)
            return pdu
        _require(len(pdu) == 5 or sub in {5, 6, 7, 8, 9, 0x13} or sub > 0x14)
        _require(sub != 2 or _word(pdu, 3) == 0)  # its structure is known, so it is checked first
        if sub not in {10, 11, 12, 13, 14, 15, 16, 17, 18, 20}:
            raise Refused(1)
        _require(_word(pdu, 3) == 0)
        if sub == 10:
            self.messages = self.exceptions = self.performed = 0
        counted = {11: self.messages, 13: self.exceptions, 14: self.messages}
        return pdu[:3] + counted.get(sub, 0).to_bytes(2, "big")

    def _count_events(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 1)
        return pdu + bytes(2) + self.performed.to_bytes(2, "big")

    def _log_events(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 1)
        counts = bytes(2) + self.performed.to_bytes(2, "big") + self.messages.to_bytes(2, "big")
        return _counted(pdu, counts + bytes(self.log[::-1][:64]))

    def _report_name(self, pdu: bytes) -> bytes:
        _require(len(pdu) == 1)
        return _counted(pdu, self.name + b"\xff")

    def _identify(self, pdu: bytes) -> bytes:
        _require(len(pdu) >= 2)
        if pdu[1] != 14:
            raise Refused(1)
        _require(len(pdu) == 4 and 1 <= pdu[2] <= 4)
        if pdu[2] == 4:
            if pdu[3] not in self.objects:
                raise Refused(2)
            chosen = [pdu[3]]
        else:
            chosen = [number for number in sorted(self.objects) if number < 3 or pdu[2] > 1]
            if pdu[3] in chosen:
                chosen = [number for number in chosen if number >= pdu[3]]
        objects = b"".join(_counted(bytes((number,)), self.objects[number]) for number in chosen)
        return pdu[:3] + bytes((0x82, 0, 0, len(chosen))) + objects

    def _get(self, area: Area, start: int, count: int) -> list[int]:
        items = self.items[area]
        if any(address not in items for address in range(start, start + count)):
            raise Refused(2)
        return [items[address] for address in range(start, start + count)]

    def _set(self, area: Area, start: int, values: list[int]) -> None:
        self._get(area, start, len(values))
        self.items[area].update(enumerate(values, start))


def _require(*rules: bool) -> None:
    if not all(rules):
        raise Refused(3)


def _word(pdu: bytes, at: int) -> int:
    return int.from_bytes(pdu[at : at + 2], "big")


def _counted(head: bytes, data: bytes) -> bytes:
    return head + bytes((len(data),)) + data


def _counted_registers(function: int, values: list[int]) -> bytes:
    return _counted(bytes((function,)), b"".join(value.to_bytes(2, "big") for value in values))
