# %% [markdown]
# # Look at a recording
#
# Streams as arrays and tables, lost samples, and the load cell in newtons. For your own recordings, set SESSION to
# their folder.

# %%
import numpy as np

import cuffstation as cs

SESSION = cs.sample_session()
recording = cs.read_recording(next(SESSION.glob("*static*.mcap")))
print(recording)

# %% [markdown]
# Every sample has a number and two clock readings: the device's, and the computer's at arrival.

# %%
force = recording.load("/force").to_dataframe()
missing = np.diff(force["sample_number"]) - 1
print(f"{len(force)} samples, {int(missing.sum())} missing; complete: {recording.complete}")
print(force.head())

# %% [markdown]
# A recording contains raw values in the unit of the device, and the calibration to newtons.

# %%
cell = recording.manifest.load_cell
newtons = cell.polarity * cell.newtons_per_unit * (force["force"] - force["force"][:100].mean())
print(f"largest force {newtons.abs().max():.1f} N")

# %%
markers = recording.load("/markers")
hidden = np.isnan(markers.values[:, :, 0]).mean(axis=0)
for label, part in zip(markers.stream.labels, hidden, strict=True):
    print(f"{label:12} hidden in {100 * part:.1f} % of {len(markers.values)} frames")

# %%
cs.plot(recording)
