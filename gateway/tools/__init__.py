"""What finds faults and measures: these send requests of their own.

- doctor, evidence, questions, search    what `doctor` looks at and asks; `diagnosis` has the rules
- examinations, outside    an examination for a page; what is seen of a port without opening it
- scan, scans    units that answer on a line, and which scans may be begun
- bench        what a line carries
- hardware_report    what an adapter does
"""
