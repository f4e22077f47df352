"""Share of simulated pairs whose 95 % intervals contain the true lag and the true correlation (docs/emg.md).

    python -m benchmarks.emg_coverage [--pairs 500] [--first 40000]

--first is the seed of the first pair of each noise.
"""

import numpy as np

from benchmarks.command_line import parse_options
from fitting.emg.envelopes import EnvelopeSettings
from tests.fitting.emg.simulated import NOISES, compare_pair, emg_pairs

if __name__ == "__main__":
    options, settings = parse_options(__doc__, pairs=500, first=40000), EnvelopeSettings()
    seeds = range(options.first, options.first + options.pairs)
    print("| noise | lag covered % | correlation covered % | lag identified % | median width [ms] |")
    print("|---|---:|---:|---:|---:|")
    for noise in NOISES:
        found = [compare_pair(pair, settings) for seed in seeds for pair in emg_pairs(noise, settings, seed)]
        pairs = np.array(found, dtype=float)
        known, lag, _, rho = (f"{100 * share:.1f}" for share in pairs.mean(axis=0))
        print(f"| {noise} | {lag} | {rho} | {known} | {1000 * np.median(pairs[:, 2]):.0f} |", flush=True)
