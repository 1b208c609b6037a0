"""The tolerances of the tests, each with its reason. No test has a bare number of its own."""

# Two expressions for one quantity, in double precision: rounding errors of the terms, which random
# states of order one and up to a few hundred terms raise to some hundred units in the last place.
# Always taken relative to the size of the terms.
IDENTITY = 1e-12

# Two ways through time: both runs carry the error of the step size control, at rtol = 1e-10, which
# grows by a factor of about ten over the simulated time.
SOLVED = 1e-9

# Central differences: a step h leaves h² of truncation and ε/h of rounding (ε: the error of the
# function itself, some 1e-13 for a fixed number of steps), 1e-9 to 1e-7 at their best step.
DIFFERENCED = 1e-6

# Published digits: the printed ones are good to more than ten places, and the run that meets them
# is allowed ten times the tolerance of its own step size control.
PUBLISHED = 1e-8
