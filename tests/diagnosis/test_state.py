"""What to do about files of the state folder."""

from gateway.diagnosis.state import about_state_file


def test_a_file_that_another_gateway_has_open_is_no_matter_of_permissions():
    found = about_state_file("/s/history.sqlite", "locked; is another modbus-gateway running?", was_damaged=False)
    assert found.what == "/s/history.sqlite cannot be written: locked; is another modbus-gateway running?"
    assert (
        found.remedy == "start one of the two with a folder of its own: STATE_DIRECTORY=FOLDER modbus-gateway run ..."
    )


def test_a_file_that_cannot_be_written_for_another_reason_is_one():
    assert about_state_file("/s/a", "read-only", was_damaged=False).remedy.startswith("findmnt -T /s/a")
