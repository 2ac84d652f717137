"""Recordings of a rig, real or stand-in: the format, reading, writing and checking.

`format` says what a recording is, `read` and `write` move it from and to a folder, `checks` holds
what every recording must satisfy. `python -m slapshot.recordings FOLDER` checks and describes one.
"""
