"""Rules that find what is wrong with a set-up, and what mends it. `tools` gathers the evidence.

- ports, lines, units, clients, state    one module for each subject
- last         when a fault may have been repaired
- finding, evidence    what is found, and of what
"""
