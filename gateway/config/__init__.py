"""The config file: from its text to the settings of the parts.

- load         reads a file into tables, or lists all its mistakes
- included     the files that it includes
- check        calls the checks of these tables against each other, in their order
- resolve      turns tables without mistakes into the settings of all parts
- add_ons      the list of sections that add a part to the gateway: `[web]`, `[mqtt]`, `[fleet]`
- values       the kinds of values that keys have
- schema       the keys, section by section
- reading, machine    the text of a file; what is seen of this machine
- plan, checks    the settings; the checks
- importing, documents    configs of other programs; what is made of the schema
- problem      a mistake, and its place
"""
