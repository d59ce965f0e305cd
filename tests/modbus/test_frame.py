from gateway.modbus.frame import Frame


def test_a_frame_shows_its_bytes():
    assert repr(Frame(17, bytes.fromhex("03 00 6B 00 03"))) == "<Frame unit=17 03 00 6B 00 03>"
