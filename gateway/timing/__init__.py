"""Times: of characters and frames on a line, of a device's responses, and the time limit of a transaction."""
