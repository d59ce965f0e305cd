"""From the text of a config file to its tables, with the place of each mistake."""
