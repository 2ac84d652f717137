"""Goal reaching with an adapted model: commands that hit a target, and informative exploration.

The paper proposes both and does neither: "used to find a better policy, e.g. by backpropagating through the
learned model or by training an inverse model", and "a more informed search strategy, for example based on
uncertainty". Optimisers use only what the camera of a rig observes, never the true parameters of a stand-in.
"""
