"""Claims of the paper, tested on our results: one file for each claim."""
