"""Files that survive a restart, a crash and a worn flash card."""
