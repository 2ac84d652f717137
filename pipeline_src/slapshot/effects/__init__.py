"""Effects: the catalogue of physics that a nominal scene may lack, one file each.

To add one is to add a file here, or to name a module of one's own in the configuration
(`diagnosis.effects`); `catalogue` finds both.
"""
