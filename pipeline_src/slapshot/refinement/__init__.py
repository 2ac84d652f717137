"""Range refinement: narrower ranges of randomisation, and a noise level, from beliefs about recordings.

"this analysis can be used to search for a range of randomization parameters that encapsulate the real
conditions with a much smaller margin of error [...] Similarly, comparing cluster sizes [...] can provide a
more accurate measure about the noise level in the real domain" (paper, section IV-C). Nothing here has access
to the lab.
"""
