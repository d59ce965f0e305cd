"""What is made of the schema, and of profiles.

- json_schema    the schema for editors
- points_csv     the points of a profile as CSV
- point_rows     points in words, for tables
"""
