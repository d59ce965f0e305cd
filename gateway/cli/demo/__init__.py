"""What the demo runs and prints.

- script, stage        lines, requests and the responses that are expected; how they are printed
- live, traffic        what those see who stay: more lines, a page and its user, certificates, and clients that poll
- past, past_values    the day before it began, which is made up
"""
