"""The config as a plan: read in a process of its own, with what is wrong with the files that it names (ADR 24).

- process, reader    the process, and what runs in it
- file_troubles, certificate_troubles    files that the config names
- password, page_users    secrets, and the users of the web page, in their files
- expiry       certificates that will soon not be valid any more
- libraries    what is said of a library that is not installed
"""
