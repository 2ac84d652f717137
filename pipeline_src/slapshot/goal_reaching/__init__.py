"""Acting on an adapted model: commands that hit a target, and hits that teach the most.

The paper proposes both and does neither: "used to find a better policy, e.g. by backpropagating through the
learned model or by training an inverse model", and "a more informed search strategy, for example based on
uncertainty". What acts knows of a rig what its camera sees; it never reads the truth about a stand-in.
"""
