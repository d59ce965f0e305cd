"""Configs of other programs as one of ours."""
