"""What several commands need.

- daemon    which gateway is meant, and the conversation with it
- columns, progress    tables, and how far a long command is
- terminal, paint, cells    what a terminal is given, its colours, and the width of text
- watching, keyboard    what `-w` shows on the whole screen, and the keys
- usage, examples, first_steps    wrong arguments, examples of right ones, and what to do before all
"""
