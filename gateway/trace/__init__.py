"""What has happened last: every transaction on the lines, and what was heard beside them, in memory (ADR 17).

- records      what is kept of each transaction, and what became of it
- ring         the records, bounded by bytes
- pdus         PDUs in words
- pcapng       capture files for Wireshark
"""
