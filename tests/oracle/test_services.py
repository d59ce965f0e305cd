"""The functions without items against pymodbus: what it asks we read, what it answers we accept, and the other way."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymodbus.framer import FramerRTU
from pymodbus.pdu import DecodePDU, ModbusPDU, diag_message, file_message, mei_message, other_message
from pymodbus.pdu.file_message import FileRecord

from gateway.images.services import Diagnostics, Identity
from gateway.modbus.pdu import parse_request
from kit.asked import Asked
from kit.asker import Asker

WORDS = st.integers(0, 0xFFFF)
RECORDS = st.lists(
    st.tuples(WORDS, WORDS, st.integers(1, 20).flatmap(lambda n: st.binary(min_size=2 * n, max_size=2 * n))),
    min_size=1,
    max_size=4,
)
OBJECTS = st.dictionaries(st.integers(0, 255), st.binary(min_size=1, max_size=40), min_size=1, max_size=5)
COUNTERS = [
    (getattr(diag_message, name + "Request"), getattr(diag_message, name + "Response"))
    for name in (
        "ReturnDiagnosticRegister",
        "ReturnBusMessageCount",
        "ReturnBusCommunicationErrorCount",
        "ReturnBusExceptionErrorCount",
        "ReturnDeviceMessageCount",
        "ReturnDeviceNoResponseCount",
        "ReturnDeviceNAKCount",
        "ReturnDeviceBusyCount",
        "ReturnDeviceBusCharacterOverrunCount",
    )
]


def with_fields(message: ModbusPDU, **fields) -> ModbusPDU:
    """Some classes of pymodbus take their fields only afterwards."""
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def pdu(message: ModbusPDU) -> bytes:
    return bytes((message.function_code,)) + message.encode()


def records(each) -> list[FileRecord]:
    return [FileRecord(file, record, data) for file, record, data in each]


def to_read(each) -> list[FileRecord]:
    return [FileRecord(file, record, record_length=len(data)) for file, record, data in each]


#: Request and response of each function.
EXCHANGES = {
    7: st.builds(
        lambda status: (
            other_message.ReadExceptionStatusRequest(),
            with_fields(other_message.ReadExceptionStatusResponse(), status=status),
        ),
        st.integers(0, 255),
    ),
    8: st.builds(
        lambda data: (
            diag_message.ReturnQueryDataRequest(message=data),
            diag_message.ReturnQueryDataResponse(message=data),
        ),
        st.integers(1, 125).flatmap(lambda n: st.binary(min_size=2 * n, max_size=2 * n)),
    ),
    "8, counters": st.builds(
        lambda kind, count: (kind[0](message=0), kind[1](message=count)), st.sampled_from(COUNTERS), WORDS
    ),
    "8, clear": st.sampled_from(
        [
            (diag_message.ClearCountersRequest(), diag_message.ClearCountersResponse()),
            (diag_message.ClearOverrunCountRequest(), diag_message.ClearOverrunCountResponse()),
        ]
    ),
    11: st.builds(
        lambda count: (
            other_message.GetCommEventCounterRequest(),
            with_fields(other_message.GetCommEventCounterResponse(), count=count, status=True),
        ),
        WORDS,
    ),
    12: st.builds(
        lambda messages, events, log: (
            other_message.GetCommEventLogRequest(),
            other_message.GetCommEventLogResponse(message_count=messages, event_count=events, events=list(log)),
        ),
        WORDS,
        WORDS,
        st.binary(max_size=64),
    ),
    17: st.builds(
        lambda identifier, runs: (
            other_message.ReportDeviceIdRequest(),
            other_message.ReportDeviceIdResponse(identifier=identifier, status=runs),
        ),
        st.binary(max_size=250),
        st.booleans(),
    ),
    20: st.builds(
        lambda each: (
            file_message.ReadFileRecordRequest(to_read(each)),
            file_message.ReadFileRecordResponse(records(each)),
        ),
        RECORDS,
    ),
    21: st.builds(
        lambda each: (
            file_message.WriteFileRecordRequest(records(each)),
            file_message.WriteFileRecordResponse(records(each)),
        ),
        RECORDS,
    ),
    24: st.builds(
        lambda at, values: (
            file_message.ReadFifoQueueRequest(at),
            file_message.ReadFifoQueueResponse(values),
        ),
        WORDS,
        st.lists(WORDS, max_size=31),
    ),
    43: st.builds(
        lambda code, objects: (
            mei_message.ReadDeviceInformationRequest(code, 0),
            mei_message.ReadDeviceInformationResponse(code, objects),
        ),
        st.integers(1, 3),
        OBJECTS,
    ),
    "43, one": st.builds(
        lambda number, value: (
            mei_message.ReadDeviceInformationRequest(4, number),
            mei_message.ReadDeviceInformationResponse(4, {number: value}),
        ),
        st.integers(0, 255),
        st.binary(min_size=1, max_size=240),
    ),
}


@pytest.mark.parametrize("function", EXCHANGES)
@given(data=st.data())
def test_we_read_what_it_asks_and_accept_what_it_answers(function, data):
    request, response = map(pdu, data.draw(EXCHANGES[function]))
    asked = parse_request(request)
    assert asked.accepts(response)
    assert asked.response_size in {None, len(response)}
    assert len(response) <= asked.longest_response


@pytest.mark.parametrize("function", EXCHANGES)
@given(data=st.data(), unit=st.integers(1, 247))
def test_rtu_ends_on_the_last_byte_of_what_it_sends(function, data, unit):
    request, response = map(pdu, data.draw(EXCHANGES[function]))
    its = FramerRTU(DecodePDU(is_server=False)).encode(response, unit, 0)
    cut = data.draw(st.integers(0, len(its) - 1))
    framer = Asked(unit, parse_request(request))
    assert framer.received(its[:cut], 0.0) == []
    assert framer.received(its[cut:], 0.0) == [(unit, response)]


def its(response: bytes) -> ModbusPDU:
    decoded = DecodePDU(is_server=False).decode(response)
    assert decoded is not None
    return decoded


def test_it_reads_who_an_image_is():
    image = Identity("shift-data")
    report = its(image.report(b"\x11"))
    assert (report.identifier, report.status) == (b"shift-data", True)
    said = its(image.identify(bytes.fromhex("2B 0E 02 00")))
    assert (said.read_code, said.conformity, said.more_follows, said.number_of_objects) == (2, 0x82, 0, 4)
    assert (said.information[0], said.information[6]) == (b"modbus-gateway", b"shift-data")


def test_it_reads_the_counters_and_the_log_of_an_image():
    diagnostics = Diagnostics()
    for pdu in ("03 0000 0001", "06 0000 0001"):
        request = Asker().ask(pdu, unit=10)
        diagnostics.received(request)
        diagnostics.done(request)
    counter = its(diagnostics.event_counter(b"\x0b"))
    assert (counter.status, counter.count) == (True, 2)
    log = its(diagnostics.event_log(b"\x0c"))
    assert (log.status, log.event_count, log.message_count, log.events) == (True, 2, 2, [0x40, 0x80, 0x40, 0x80])
    assert its(diagnostics.perform(bytes.fromhex("08 000B 0000"))).message == 2
