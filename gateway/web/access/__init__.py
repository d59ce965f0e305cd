"""Who may do what over HTTP.

- guard        what each request passes first: which client it is, and whether it may do this
- sessions     sessions, and failed logins
- tokens       tokens that programs send, and wrong ones
- user_table   the users of the file, as it is now
"""
