"""The config in use, and another one in its place.

- view, applied    the config in use, and those that were in use before
- check, commands    a text that might replace it, and the commands that do it
- reload       the operations `which` and `reload`
"""
