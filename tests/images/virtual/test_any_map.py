"""Any map: each register that is read is that of its row, of the unit's own image, or what is said of its device."""

from hypothesis import given
from hypothesis import strategies as st

from gateway.images.virtual.settings import FreshBits, SourceAge
from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span, parse_request
from gateway.registers.items import has_bits, pack_bits
from tests.images.virtual.bench import Bench, coils, holding

DEVICES = ("a", "b", "c")


@st.composite
def maps(draw):
    """Pieces behind one another, perhaps with gaps: of registers or of coils."""
    area = draw(st.sampled_from((Area.HOLDING, Area.COILS)))
    make = coils if area is Area.COILS else holding
    at, rows, fresh, ages, own = 0, [], [], [], []
    for number in range(draw(st.integers(1, 8))):
        at += draw(st.integers(0, 2))
        kind = draw(st.sampled_from(("row", "row", "row", "own", "fresh", "age")))
        count = draw(st.integers(1, 5))
        if kind == "row":
            stale = draw(st.sampled_from(("exception", "hold", 1)))
            rows.append(make(at, draw(st.sampled_from(DEVICES)), 10 * number, count, when_stale=stale))
        elif kind == "own":
            own.append((at, at + count - 1))
        elif kind == "age" and area is Area.HOLDING:
            count = 1
            ages.append(SourceAge(Span(area, at, 1), draw(st.sampled_from(DEVICES))))
        else:
            count = len(DEVICES) if area is Area.COILS else 1
            fresh.append(FreshBits(Span(area, at, count), DEVICES))
        at += count
    rows += [make(at + 10 * index, name, 200, 1) for index, name in enumerate(DEVICES)]
    return area, rows, fresh, ages, own


#: Stands for an address at which a read gets 0B.
REFUSING = None


@given(maps(), st.sets(st.sampled_from(DEVICES)), st.integers(0, 60), st.integers(1, 30))
def test_a_read_is_made_of_the_pieces_that_it_touches(drawn, silent, start, count):
    area, rows, fresh, ages, own = drawn
    bench = Bench(*rows, own={area: tuple(own)} if own else {}, fresh=tuple(fresh), ages=tuple(ages))
    for name, device in bench.devices.items():
        answer_polls(bench, device, name, silent)
    for first, last in own:
        bench.own.tables[area].assign(first, [held(area, "own", each) for each in range(first, last + 1)])
    bench.now = 1.5
    function = 1 if has_bits(area) else 3
    came = bytes.fromhex(bench.client().ask(f"{function:02X}{start:04X}{count:04X}")[0])
    known = wanted(drawn, silent)
    span = range(start, start + count)
    if any(each not in known for each in span):
        assert came == bytes((function | 0x80, 2))
    elif any(known[each] is REFUSING for each in span):
        assert came == bytes((function | 0x80, 0x0B))
    else:
        assert came == bytes((function, len(came) - 2)) + encoded(area, [known[each] for each in span])


def answer_polls(bench, device, name, silent):
    bench.poll(device)
    while device.asked:
        asked = parse_request(device.asked[0].pdu).read
        items = encoded(asked.area, [held(asked.area, name, each) for each in range(asked.start, asked.end)])
        head = bytes((device.asked[0].pdu[0], len(items)))
        device.answers("83 0B" if name in silent else (head + items).hex())


def wanted(drawn, silent):
    """What each address that exists has, or REFUSING."""
    area, rows, fresh, ages, own = drawn
    found = {each: held(area, "own", each) for first, last in own for each in range(first, last + 1)}
    for row in rows:
        for at in range(row.place.count):
            lost = 1 if row.when_stale == 1 else REFUSING
            found[row.place.start + at] = lost if row.device in silent else held(area, row.device, row.poll.first + at)
    for each in fresh:
        alive = [int(name not in silent) for name in each.devices]
        bits = alive if has_bits(area) else [sum(bit << at for at, bit in enumerate(alive))]
        found |= dict(enumerate(bits, each.place.start))
    return found | {each.place.start: 65535 if each.device in silent else 1 for each in ages}


def held(area, name, address):
    """What a device, or the unit itself, has at an address."""
    number = 1000 * ord(name[0]) + address
    return number // 3 % 2 if has_bits(area) else number % 65536


def encoded(area, numbers):
    return pack_bits(bytes(numbers)) if has_bits(area) else b"".join(each.to_bytes(2, "big") for each in numbers)
