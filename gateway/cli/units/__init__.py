"""Units as commands read and write them: through the gateway or directly.

- words, mbpoll    what was typed, and options of mbpoll that were typed by habit
- on_unit, unit    finds a unit, and opens it through the gateway or directly; requests one after the other
- values    the values that they read
- direct, direct_scan, device_server    without a gateway
- simulated    the devices that `simulate` plays
- active_calibration    requests for the answer times of a device
"""
