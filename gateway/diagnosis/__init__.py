"""Rules that find faults of a set-up, and their remedies. `tools` gathers the evidence.

- ports, lines, monitors, units, images, clients, state    the rules, by subject
- last         faults that may have been repaired
- finding, evidence    the results of the rules, and their input
"""
