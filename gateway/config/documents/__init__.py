"""What is made of the schema, and of profiles.

- json_schema    the schema for editors
- points         the points of a profile as CSV, and in words for tables
"""
