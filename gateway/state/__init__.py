"""Files that survive a restart, a crash and a worn flash card.

- memory, entry_file    addresses of devices that moved, rates that changed: JSON with a copy (ADR 29)
- page_log, pages    values of images (ADR 8)
- database, row_file     SQLite with a sum for each row; what is in memory, written to it once a minute
- applied_configs    the last configs that were in use
- files        how files are opened, locked and replaced
- file_trouble, troubles, status    files and folders that cannot be written
"""
