"""Recordings of a rig, real or stand-in: the format, reading, writing and checking.

Version 1 is of hits of a sliding object: `format` says what it is, `read` and `write` move it from and to a
folder, `checks` holds what it must satisfy. Version 2 is of joints and bodies of any MuJoCo model: `signals`
says what it is, reads and writes it, `channels` what a column may mean, `signal_checks` what it must satisfy.
`python -m slapshot.recordings FOLDER` checks and describes either.
"""
