"""What `profile` prints and adds.

- known      the profiles that there are, and their list
- picture    one of them
- adding     a file that becomes one
"""
