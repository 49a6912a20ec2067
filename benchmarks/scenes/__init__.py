"""Situations that are hard, many drives each: outages, forks, parallel roads, missing streets.

Every seed is a drive of its own.  Seeds below 1000 are for development, those from
10,000 on for what is reported.
"""
