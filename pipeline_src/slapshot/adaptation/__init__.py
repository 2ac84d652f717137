"""Methods that adapt a learned dynamics model to a new condition from a few noisy samples.

A method is a file of this package: it implements the interface of `method.py` and names its class
`METHOD`. Nothing here reads files; data come in standardised, as tensors of shape (M, B, N, d):
M independently trained models, B tasks, N samples in a sequence.
"""
