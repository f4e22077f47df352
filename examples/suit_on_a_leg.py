# %% [markdown]
# # A suit on a leg: an elastic cord from a shank cuff to the heel
#
# How much effort of the ankle's muscles does a cord behind the ankle save over a stride, with a rigid and with a
# yielding shank cuff, and which rest length is best? The leg has three segments and three muscles. Stride and ground
# reaction force are smooth curves of textbook shape, not measured. The cuff is the hand cuff of the published study,
# because no shank cuff has been measured yet. `leg/make_leg.py` names the sources of the figures.

# %%
from pathlib import Path

import numpy as np

import cuffstation as cs

FOLDER = Path(globals().get("__file__", "suit_on_a_leg.py")).parent / "leg"
LOADS = FOLDER / "ground.xml"
leg = cs.load_model(FOLDER / "leg.osim")
stride = cs.load_motion(leg, FOLDER / "stride.mot", cutoff_hz=6.0)

# %% [markdown]
# Actuators move hip and knee, whose muscles are not in the model. They have no weight: only the ankle counts.

# %%
carried = ("thigh_angle", "hip_x", "hip_y", "knee_angle")
options = cs.RedundancyOptions(unweighted_coordinates=carried, reactions=cs.ReactionRequest(("ankle",)))
bare = cs.solve_motion(leg, stride, options, external_loads=LOADS)
print(bare.to_dataframe()[list(bare.muscles)].max().to_string(float_format="{:.2f}".format))
ankle = np.linalg.norm(bare.joint_reactions.force[:, 0], axis=1)
print(f"the ankle carries up to {ankle.max():.0f} N")

# %%
cuffs = cs.read_cuffs(FOLDER / "shank.json")
suit = FOLDER / "shank_suit.toml"
assessment = cs.assess(cuffs, leg, stride, suit, options=options, external_loads=LOADS, people=0)
table = assessment.to_dataframe().set_index("condition")
for condition, kind in (("rigid", "rigid"), ("visco_elastic", "yielding"), ("both", "yielding and migrated")):
    row = table.loc[condition]
    saved, length = 100 * (1 - row["least_effort"]), 1000 * row["rest_length_m"]
    print(f"{kind} cuff: {saved:.0f} % less effort, at a rest length of {length:.0f} mm")

# %% [markdown]
# The same as a report:
#
#     station assess --model leg.osim --motion stride.mot --cutoff-hz 6 --external-loads ground.xml \
#         --effort effort.toml --suit shank_suit.toml --cuffs shank.json --output out

# %%
cs.plot(assessment)
