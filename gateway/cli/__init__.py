"""The command line.

- main      finds the command, and says of an error what is to be said
- verbs     the commands: one module for each, with its name
- kit       what several commands need: the conversation with a gateway, tables, the terminal
- show      what commands print
- units     units as commands read and write them
- profiles  what `profile` prints
- doctor    what `doctor` looks at without a gateway
- demo      what `demo` runs and prints
"""
