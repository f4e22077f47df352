# %% [markdown]
# # Fit a cuff, and change one assumption
#
# Stiffness, damping and migration of every cuff of a session, with their uncertainty and its causes; then the same
# donning without its last trial. `station demo` records `simulated/demo`.

# %%
import sys
from pathlib import Path

import cuffstation as cs

SESSION = Path(sys.argv[1] if len(sys.argv) > 1 else "simulated/demo")
if not any(SESSION.glob("*.mcap")):
    sys.exit(f"{SESSION} has no recording; record simulated/demo with `station demo`")
session = cs.fit_session(SESSION)
print(session.to_dataframe().to_string(index=False))

# %% [markdown]
# Contributions to a standard error: noise, the lag between force and markers, the gain of the load cell, …

# %%
cuff = session.cuffs["hand"]
for cause, part in cuff.stiffness.parts.items():
    print(f"{cause:16} {part:8.2f} N/m")
print(cuff.verdict)

# %% [markdown]
# The same fit without the last trial. The bounce trials calibrate lag and gain of the load cell.

# %%
used = [trial.file for trial in cuff.trials if trial.state == "used"]
fewer = cs.fit_donning([SESSION / file for file in (*session.bounces, *used[:-1])])
print(f"with all trials: {cuff}", f"without {used[-1]}: {fewer}", sep="\n")

# %% [markdown]
# Write the cuffs to a file, which `station assess` also reads.

# %%
cs.write_cuffs("cuffs.json", session.cuffs)
print(cs.read_cuffs("cuffs.json")["hand"])
cs.plot(cuff).savefig("trials.png")
cs.plot(session).savefig("cuffs.png")
