# %% [markdown]
# # Fit a cuff, and change one assumption
#
# Stiffness, damping and migration of every cuff of a session, with their uncertainty and its causes; then the same
# without the bounce trial that calibrates the load cell. For your own recordings, set SESSION to their folder.

# %%
import cuffstation as cs

SESSION = cs.sample_session()
session = cs.fit_session(SESSION)
print(session.to_dataframe().to_string(index=False))

# %% [markdown]
# Contributions to a standard error: noise, the lag between force and markers, the gain of the load cell, …

# %%
cuff = session.cuffs["hand"]
print(cuff.report())

# %% [markdown]
# Lag and gain as declared, not as the bounce trial measured them, change the damping (true: 210 N s/m):

# %%
used = [trial.file for trial in cuff.trials if trial.state == "used"]
declared = cs.fit_donning([SESSION / file for file in used])
print(f"with the bounce: {cuff}", f"without: {declared}", sep="\n")

# %% [markdown]
# Write the cuffs to a file, which `station assess` also reads.

# %%
cs.write_cuffs("cuffs.json", session.cuffs)
print(cs.read_cuffs("cuffs.json")["hand"])

# %%
cs.plot(session)
