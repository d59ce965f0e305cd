"""Times: of characters and frames on a line, of a device's responses, and the time limit of a transaction.

- characters   how long characters take
- table        the timing table of a device
- budget       the limit of one request: wire time, the device's time with its margin, latency of the port
- measured, histogram, proposal    what was measured, and the table that follows from it
- verdict      whether a limit is too short or too long
- usage, history    who used a line, and what units did in the last days
- trend        values of points in slots of time, and how a file has them
- clock_setting   how a wall clock is set, and whether earlier times may be wrong
- lease_time   the shares of a lease (ADR 26)
"""
