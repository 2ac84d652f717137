"""Range refinement: from beliefs about recordings to narrower ranges of randomisation and a level of noise.

"this analysis can be used to search for a range of randomization parameters that encapsulate the real
conditions with a much smaller margin of error [...] Similarly, comparing cluster sizes [...] can provide a
more accurate measure about the noise level in the real domain" (paper, section IV-C). Nothing here knows the
lab.
"""
