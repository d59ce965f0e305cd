"""A unit as the specification describes it, in dictionaries and by the letter: what an image is compared with."""

from math import ceil

from gateway.modbus.codes import Area


class Refused(Exception):  # noqa: N818 - it is the exception code of a response
    pass


class Model:
    """`items` are the numbers at the addresses that exist."""

    def __init__(self, items: dict[Area, dict[int, int]]) -> None:
        self.items = items

    def answer(self, pdu: bytes) -> bytes:
        meanings = {
            1: self._read_bits,
            2: self._read_bits,
            3: self._read_registers,
            4: self._read_registers,
            5: self._write_coil,
            6: self._write_register,
            15: self._write_coils,
            16: self._write_registers,
            22: self._mask_register,
            23: self._read_write_registers,
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


def _counted_registers(function: int, values: list[int]) -> bytes:
    return bytes((function, 2 * len(values))) + b"".join(value.to_bytes(2, "big") for value in values)
