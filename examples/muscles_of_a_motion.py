# %% [markdown]
# # Muscles of a motion
#
# The muscle-redundancy problem with the glenohumeral constraint. Without arguments: the bundled model and arm raise.
# With arguments: `muscles_of_a_motion.py MODEL.osim MOTION.mot`.

# %%
import sys

import numpy as np

import cuffstation as cs

source, path = sys.argv[1:3] if len(sys.argv) > 2 else ("bundled", None)
model = cs.load_model(source)
motion = cs.load_motion(model, path, cutoff_hz=3.0, every=5)
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
cs.plot(solution).savefig("muscles.png")
