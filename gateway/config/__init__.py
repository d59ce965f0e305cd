"""The config file: from its text to the settings of the parts.

`load` reads a file into tables, `check` checks these against each other, `resolve` makes the settings of them, and
`add_ons` lists the sections that add a part to the gateway. Below these, each in a room of its own: kinds of values,
the schema, the reading of the text, what is seen of this machine, the plan (the settings), and the checks. Beside them:
configs of other programs, and the documents that are made of the schema.
"""
