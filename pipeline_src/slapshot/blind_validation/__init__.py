"""The proof: concealed cases recorded by the lab, diagnosed, and only then scored against the truth.

The lab and the diagnosis know nothing of each other; what is scored here are the files that they wrote.
"""
