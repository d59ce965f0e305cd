"""Keeps readings that could not be published, until they are sent to the broker as history (ADR 38).

- records      readings of a device with their times, as they are written to the file, and what became of them
- backlog      what is in memory: readings that are not written yet, and those to be sent next
- file         the file of the rest
- given_up     counts what will never be sent, and tells of it
- progress     how fast the file fills, and how long it takes to send what it has
- keeper       writes and reads the file from time to time
- history      when the next message with kept readings is sent, and what became of it
- unconfirmed  readings that were sent, and are kept if the broker takes long to confirm them
"""
