"""The kinds of values that keys have: what a user writes becomes what parts are given."""
