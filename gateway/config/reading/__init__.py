"""From the text of a config file to its tables, with the place of each mistake.

- tables       makes a table of each section; a broken one hides no other's mistakes
- profile_file, hub_file    the file of a profile, and that of `fleet hub`
- positions, source    where keys and values stand, and where a table does once it is read
- given_table    a config that a program has made as a table, without text
- syntax, wording    what is wrong with text that is no TOML, and with values, in words
- masking, excerpt    a file without its secrets, compared with another line by line, and single lines of it
- whole_text   the text of a config and of the files that it includes
- toml_text    TOML, written
"""
