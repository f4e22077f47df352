# %% [markdown]
# # A design study: how stiff does an arm cuff have to be?
#
# Assess arm cuffs of three stiffnesses on the bundled suit, in the bundled arm raise. The first argument may be a
# cuffs.json; the default is the hand cuff of the published study.

# %%
import json
import sys
from pathlib import Path

import cuffstation as cs

PUBLISHED = {"hand": {"stiffness_n_per_m": 8520, "damping_n_s_per_m": 210, "migration_m": 0.012}}
file = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("published.json")
if len(sys.argv) < 2:
    file.write_text(json.dumps({"cuffs": PUBLISHED}))
stiffness = json.loads(file.read_text())["cuffs"]["hand"]["stiffness_n_per_m"]
stiffness = stiffness["value"] if isinstance(stiffness, dict) else stiffness

# %%
model = cs.load_model()
motion = cs.load_motion(model)
for factor in (0.25, 1.0, 4.0):
    design = {"hand": {**PUBLISHED["hand"], "stiffness_n_per_m": factor * stiffness}}
    Path("design.json").write_text(json.dumps({"cuffs": design}))
    assessment = cs.assess(cs.read_cuffs("design.json"), model, motion, draws=0, most_frames=20)
    table = assessment.to_dataframe().set_index("condition")
    least, length = table.loc["both", ["least_effort", "rest_length_m"]]
    print(f"{factor * stiffness:7.0f} N/m: {100 * (1 - least):4.1f} % less effort, at a rest length of {length:.2f} m")

# %%
print(assessment)
cs.plot(assessment).savefig("effort.png")
