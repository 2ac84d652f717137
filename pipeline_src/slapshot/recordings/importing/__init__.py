"""Import of tracks from anybody's CSV files: a mapping, a YAML file, says which column is what.

`mapping` reads that file, `csv_files` the tables, `cut` finds the hit in each, `importer` writes the
recording. `slapshot import MAPPING SOURCE OUT` is all of it.
"""
