"""The gateway as a part of another program; `gateway/__init__.py` exports what is public of it.

- gateway         a gateway that a program starts and stops
- life            the task of such a gateway
- unit_client     a unit, to be read and written
- reading         the value of a point
- log             events, for Python's logging
"""
