"""What has happened last: every transaction on the lines, and what was heard beside them, in memory."""
