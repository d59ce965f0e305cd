"""Tools that find faults and measure; they send requests of their own.

- doctor, evidence, questions, search    `doctor`: its evidence and its reads; `diagnosis` has the rules
- examinations, outside    examinations for the web page; facts about a port without opening it
- scan, scans, signs    a scan of a line for units, the conditions for it, and signs of some kinds of devices
- bench        the throughput of a line
- hardware_report    the behaviour of an adapter
"""
