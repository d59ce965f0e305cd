"""The config as a plan: read in a process of its own, with what is wrong with the files that it names."""
