"""Tools that find faults and measure; they send requests of their own.

- doctor, evidence, questions, search    `doctor`: its evidence and its reads; `diagnosis` has the rules
- examinations, outside    examinations for the web page; facts about a port without opening it
- scan, scans, signs    a scan of a line for units, the conditions for it, and signs of some kinds of devices
- unused_port, page_scans    the same on a port that no line has, and scans on order of the web page
- bench        the throughput of a line
- hardware_report    the behaviour of an adapter
- site_inventory    what other sites are told of this gateway
- support, machine, bundle    a diagnostics bundle: what a gateway tells, what is seen without it, and the file
"""
