import pytest

from gateway.timing.characters import CharacterFormat, LineTiming


def timing(mode: str, baud: int, text: str) -> LineTiming:
    return LineTiming(mode, baud, CharacterFormat.parse(text))


@pytest.mark.parametrize(
    ("text", "bits"), [("8E1", 11), ("8O1", 11), ("8N2", 11), ("8N1", 10), ("7E1", 10), ("7O1", 10), ("7N2", 10)]
)
def test_bits_of_a_character_with_its_start_bit(text, bits):
    character = CharacterFormat.parse(text)
    assert character.bits == bits
    assert str(character) == text


@pytest.mark.parametrize("text", ["", "8", "8E", "8E3", "9N1", "6N1", "8M1", "8e1", "8-E-1", "8E1 ", "18E1"])
def test_no_character_format(text):
    with pytest.raises(ValueError, match="written like 8E1"):
        CharacterFormat.parse(text)


def test_silences_of_the_specification_up_to_19200_baud():
    line = timing("rtu", 9600, "8E1")
    assert line.character == pytest.approx(11 / 9600)
    assert line.t35 == pytest.approx(3.5 * 11 / 9600)
    assert timing("rtu", 19200, "8E1").t35 == pytest.approx(0.002005, abs=1e-6)


@pytest.mark.parametrize("baud", [19201, 38400, 115200])
def test_silences_are_fixed_above_19200_baud(baud):
    line = timing("rtu", baud, "8E1")
    assert line.t35 == 0.001750


def test_a_device_may_need_a_longer_silence():
    assert timing("rtu", 9600, "8N1").silence(4.5) == pytest.approx(4.5 * 10 / 9600)
    assert timing("rtu", 38400, "8N1").silence(4.5) == pytest.approx(0.002250)


def test_a_read_on_the_wire():
    """RTU: unit, PDU of 5 bytes, CRC of 2. ASCII: two characters a byte, an LRC of 1, and `:`, CR, LF."""
    rtu, ascii_line = timing("rtu", 9600, "8E1"), timing("ascii", 9600, "7E1")
    assert rtu.frame(5) == pytest.approx(8 * 11 / 9600)
    assert ascii_line.frame(5) == pytest.approx(17 * 10 / 9600)


def test_the_longest_frames_are_those_of_the_specification():
    rtu, ascii_line = timing("rtu", 9600, "8E1"), timing("ascii", 9600, "7E1")
    assert rtu.longest_frame == pytest.approx(256 * 11 / 9600)
    assert ascii_line.longest_frame == pytest.approx(513 * 10 / 9600)
