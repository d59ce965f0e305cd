"""What Home Assistant was told is known after a restart, until it was taken back."""

import json

import pytest

from gateway.runtime.mqtt.announced import AnnouncedDevices, is_entry
from gateway.state.entry_file import EntryFile

SILO = "homeassistant/device/plant-2/silo-1/config"
DRIVE = "homeassistant/device/plant-2/drive-1/config"
OTHER = "homeassistant/device/plant-3/silo-1/config"


@pytest.fixture
def file(tmp_path):
    return tmp_path / "home-assistant.json"


def opened(file):
    events = []
    devices = AnnouncedDevices(EntryFile(file, is_entry, events.append))
    assert events == []
    return devices


def after_a_restart(devices, file):
    devices.file.close()
    return opened(file)


def test_what_was_announced_is_known_after_a_restart(file):
    devices = opened(file)
    devices.add({SILO: {"weight": "sensor"}, OTHER: {"weight": "sensor"}})
    assert after_a_restart(devices, file).entries() == {SILO: {"weight": "sensor"}, OTHER: {"weight": "sensor"}}


def test_a_component_is_known_until_it_is_taken_back(file):
    devices = opened(file)
    devices.add({SILO: {"weight": "sensor", "state": "sensor"}})
    devices.add({SILO: {"weight": "sensor"}})
    devices = after_a_restart(devices, file)
    assert devices.entries() == {SILO: {"weight": "sensor", "state": "sensor"}}
    devices.replace({SILO: {"weight": "sensor"}})
    assert after_a_restart(devices, file).entries() == {SILO: {"weight": "sensor"}}


def test_a_device_that_was_taken_back_is_forgotten(file):
    devices = opened(file)
    devices.add({SILO: {"weight": "sensor"}, DRIVE: {"speed": "number"}, OTHER: {"weight": "sensor"}})
    devices.replace({DRIVE: {"speed": "number"}})
    devices = after_a_restart(devices, file)
    assert devices.entries() == {DRIVE: {"speed": "number"}}


def test_without_change_nothing_is_written(file):
    devices = opened(file)
    devices.add({SILO: {"weight": "sensor"}})
    devices.file.close()
    written = file.stat().st_mtime_ns
    devices.add({SILO: {"weight": "sensor"}})
    devices.replace({SILO: {"weight": "sensor"}})
    devices.file.close()
    assert file.stat().st_mtime_ns == written


def test_without_a_file_it_is_known_as_long_as_the_process_runs():
    devices = AnnouncedDevices()
    devices.add({SILO: {"weight": "sensor"}})
    assert devices.entries() == {SILO: {"weight": "sensor"}}


@pytest.mark.parametrize("entry", [1, "a", [], {"weight": 1}, {"weight": {}}])
def test_a_damaged_entry_is_none(entry, file):
    file.write_text(json.dumps({SILO: entry}), encoding="utf-8")
    events = []
    assert AnnouncedDevices(EntryFile(file, is_entry, events.append)).entries() == {}
    assert events
