"""What several commands need.

- daemon    which gateway is meant, and the conversation with it
- columns, table, progress, terminal    tables, how far a long command is, what a terminal is given
- usage, examples, first_steps    wrong arguments, examples of right ones, and what to do before all
"""
