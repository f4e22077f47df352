"""Which muscles carry a motion: the solver as a library, without the station.

    python examples/muscles_of_a_motion.py [--model MODEL.osim] [--motion MOTION.mot] [--plot muscles.png]

Without files it takes the bundled model and its raise of the arm. Everything between is arrays, frames first; a motion
of your own need not be a file: Motion(model.coordinate_names, time, coordinates) with coordinates (frames,
coordinates) in rad and m.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from solver.bundled import bundled_model
from solver.motion import differentiate, read_motion
from solver.osim.reader import read_osim
from solver.raise_arm import simulate_arm_raise
from solver.redundancy.motion import RedundancyOptions, solve_motion


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--model", type=Path, help="an .osim file")
    parser.add_argument("--motion", type=Path, help="coordinates over time: .mot, .sto, or .csv in rad and m")
    parser.add_argument("--plot", type=Path, default=Path("muscles.png"))
    arguments = parser.parse_args()

    model = read_osim(arguments.model) if arguments.model else bundled_model()
    motion = read_motion(arguments.motion, model) if arguments.motion else simulate_arm_raise(model)
    kinematics = differentiate(motion, cutoff=3.0)
    found = solve_motion(model, kinematics, RedundancyOptions(has_glenoid_cone=True))

    print(f"{model.name}: {len(found.time)} frames, {found.unsolved} of them unsolved; filter: {kinematics.filter}")
    peaks = np.nanmax(found.activations, axis=0)
    busiest = np.argsort(peaks)[::-1][:8]
    for muscle in busiest:
        force = np.nanmax(found.muscle_forces[:, muscle])
        print(f"{model.muscle_names[muscle]:26} activation up to {peaks[muscle]:.3f}, force up to {force:.0f} N")
    print(f"joint reaction up to {np.linalg.norm(found.reaction[:, 3:], axis=1).max():.0f} N")

    figure = Figure(figsize=(9, 4.5), layout="constrained")
    axis = figure.subplots()
    for muscle in busiest:
        axis.plot(found.time, found.activations[:, muscle], label=model.muscle_names[muscle])
    axis.set_xlabel("time [s]")
    axis.set_ylabel("activation")
    axis.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), frameon=False)
    figure.savefig(arguments.plot, dpi=120)
    print(arguments.plot)


if __name__ == "__main__":
    main()
