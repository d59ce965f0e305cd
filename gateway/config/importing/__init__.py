"""Configs and tables of others as configs and profiles of ours.

What cannot be understood or used raises ImportedFileError.

- from_mbusd, from_modbus_proxy    one program each
- from_home_assistant              its `modbus:` section
- from_csv     a table of registers
- points       points on their way into a profile, and what cannot be one
- yaml_text    YAML
- imported     what they share
"""
