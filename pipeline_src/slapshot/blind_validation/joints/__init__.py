"""The proof for joints: cases of the joint lab, diagnosed by the joint engine, then scored by the truth."""
