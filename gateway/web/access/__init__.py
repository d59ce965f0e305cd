"""Who may do what over HTTP.

- guard        what each request passes first: who asks, and whether that is allowed
- sessions     who is logged in, and who has failed to too often
- user_table   the users of the file, as it is now
"""
