"""The gateway as a part of another program; `gateway/__init__.py` exports what is public of it.

- gateway         a gateway that a program starts and stops
- life            the task of such a gateway
- reading_config, state    its config, and what it keeps in a folder
- loading         libraries of what a config uses
- belonging       the units of a program, in one gateway at a time
- unit_client     a unit, to be read and written
- addresses       addresses and values, checked before anything is sent
- reading, sampled    the value of a point, and when it was sampled
- failures        the errors for exceptions
- anywhere        methods that can be awaited in any loop
- event_stream, log    events, for the program and for Python's logging
"""
