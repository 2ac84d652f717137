"""Recordings of a rig, real or stand-in: the format, reading, writing and checking.

Version 1 holds hits of a sliding object: `format` defines it, `read` and `write` read and write folders,
`checks`
validates. Version 2 holds joints and bodies of any MuJoCo model: `signals` defines, reads and writes it,
`channels` defines the meaning of columns, `signal_checks` validates. `data_quality` and `signal_quality`
warn. `python -m slapshot.recordings FOLDER` checks and describes either.
"""
