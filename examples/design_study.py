# %% [markdown]
# # A design study: how stiff does an arm cuff have to be?
#
# Assess arm cuffs of three stiffnesses on the bundled suit, in the bundled arm raise. The reference is the hand cuff of
# the published study.

# %%
import cuffstation as cs

model = cs.load_model()
motion = cs.load_motion(model)
for stiffness in (2130, 8520, 34080):
    cuff = cs.Cuff("hand", stiffness=stiffness, damping=210, migration=0.012)
    assessment = cs.assess(cuff, model, motion, people=0, most_frames=20)
    both = assessment.to_dataframe().set_index("condition").loc["both"]
    saved, length = 100 * (1 - both["least_effort"]), both["rest_length_m"]
    print(f"{stiffness:6.0f} N/m: {saved:4.1f} % less effort, at a rest length of {length:.2f} m")

# %% [markdown]
# All four cuffs of the published study, one at a time with the waist cuff:

# %%
published = cs.assess(cs.published_cuffs(), model, motion, people=0, most_frames=20)
print(published)

# %%
cs.plot(published)
