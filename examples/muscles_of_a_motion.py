# %% [markdown]
# # Muscles of a motion
#
# The muscle-redundancy problem with the glenohumeral constraint, of the bundled model in the bundled arm raise. For
# your own: `cs.load_model("model.osim")` and `cs.load_motion(model, "motion.mot")`.

# %%
import numpy as np

import cuffstation as cs

model = cs.load_model()
motion = cs.load_motion(model, cutoff_hz=3.0, every=5)
print(model, motion, sep="\n")

# %%
solution = cs.solve_motion(model, motion)
print(solution)
peaks = solution.to_dataframe()[list(solution.muscles)].max().sort_values(ascending=False)
print(peaks.head(8).to_string(float_format="{:.3f}".format))

# %% [markdown]
# Results are arrays, frames first. The effort with and without the glenohumeral constraint:

# %%
free = cs.solve_motion(model, motion, cs.RedundancyOptions(has_glenoid_cone=False))
more = np.nanmean(solution.effort) / np.nanmean(free.effort) - 1
print(f"the glenohumeral constraint increases the effort by {100 * more:.0f} %")

# %%
cs.plot(solution)
