"""Virtual units: registers of many devices under one unit, in one block (`[[image]] map`).

- settings     what a row maps, as the config says it
- row          the values of a row: converted when they were polled, fresh or not when they are read
- layout       from an address to its row, or to what else is there
- block        the values of all rows and own registers, and which of them are fresh
- writes       from a client's write to the request that the device gets
- unit         the unit: answers reads from its rows, passes writes on, and has registers of its own
"""
