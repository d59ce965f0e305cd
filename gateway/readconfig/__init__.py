"""Reads a config as a plan, in a process of its own, and checks the files that it names (ADR 24).

- process, reader    the process, and the program that runs in it
- text_check, text_reader    the same for a text that is no file yet
- file_troubles    files that the config names
- password, page_users    secrets, and the users of the web page, in their files
- expiry       certificates that expire soon
- libraries    libraries that are not installed
"""
