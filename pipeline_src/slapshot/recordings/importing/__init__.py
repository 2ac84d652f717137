"""Import of CSV files: a mapping, a YAML file, defines which column is what.

`mapping` reads that file, `csv_files` the tables, `segmentation` finds the hit in each, `track_importer`
writes the recording. `slapshot import MAPPING SOURCE OUT` is all of it.
"""
