"""What `profile` prints.

- known      the profiles that there are, and their list
- picture    one of them
"""
