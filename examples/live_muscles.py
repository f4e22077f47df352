# %% [markdown]
# # Muscles while the wearer moves
#
# Push markers frame by frame into the stream solver, and shorten the cord after two thirds of the motion. Here the
# markers are placed on the bundled model in the bundled arm raise, with 0.4 mm of noise; on a bench they come from the
# cameras.

# %%
import matplotlib.pyplot as plt
import numpy as np

import cuffstation as cs
from solver.multibody.postures import points_in_ground, postures

MARKERS = ("ij", "c7", "t8", "px", "ac", "aa", "ts", "ai", "EpL", "EpM")
model = cs.load_model()
motion = cs.load_motion(model, cutoff_hz=None, every=2)  # at 50 Hz
state = postures(model, motion.positions, motion.speeds)
places = [points_in_ground(state, marker.body, marker.location) for marker in map(model.marker, MARKERS)]
observed = np.stack(places, axis=1) + 4e-4 * np.random.default_rng(0).standard_normal((len(motion.time), 10, 3))

# %%
solver = cs.open_stream(MARKERS, model, rest_lengths={"worn": 0.80}, lag_s=0.15)
frames = []
for k, (time, positions) in enumerate(zip(motion.time, observed, strict=True)):
    if k == 2 * len(motion.time) // 3:
        solver.set_rest_length("worn", 0.70)
    frames += solver.push(time, positions)  # the frame of 150 ms ago
frames += solver.finish()
print(f"{len(frames)} frames, marker noise {1e3 * solver.marker_noise_m.mean():.1f} mm")

# %%
time = [frame.time_s for frame in frames]
figure, (above, below) = plt.subplots(2, sharex=True)
for name in ("slack", "worn"):
    above.plot(time, [frame.suits[name].effort for frame in frames], label=name)
below.plot(time, [frame.suits["worn"].cord_force_n for frame in frames])
above.set_ylabel("effort")
above.legend()
below.set(xlabel="time [s]", ylabel="cord force [N]")
figure.savefig("live.png")
