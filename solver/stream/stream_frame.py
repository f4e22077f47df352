"""Results of the stream solver: one StreamFrame per pushed frame, with one StreamSuitFrame per scenario.

A frame is given out when its lag has elapsed. Units are in the names of fields that leave memory; angles are in
radians.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


class StreamOutcome(StrEnum):
    """Outcome of the kinematics of a frame. The first group has coordinates, the second has NaN in their place.

    SOLVED            all coordinates that were determined before are determined
    COORDINATES_LOST  hidden markers leave a coordinate undetermined that was determined before; see StreamFrame.lost
    MARKERS_EXCHANGED two labels were exchanged, and this was corrected; see StreamFrame.exchanged
    MARKER_LEFT_OUT   a marker jumped and was left out; see StreamFrame.left_out
    INTERPOLATED      no posture of its own; the frames before and after it determine one

    NO_MARKERS        no marker is visible, or too few before and after to interpolate
    NOT_CONVERGED     inverse kinematics did not converge
    GAP_OPEN          the constraints of the model cannot be met
    TIME_NOT_LATER    the time is not finite or not later than that of the frame before; the frame is refused
    """

    SOLVED = "solved"
    COORDINATES_LOST = "coordinates_lost"
    MARKERS_EXCHANGED = "markers_exchanged"
    MARKER_LEFT_OUT = "marker_left_out"
    INTERPOLATED = "interpolated"

    NO_MARKERS = "no_markers"
    NOT_CONVERGED = "not_converged"
    GAP_OPEN = "gap_open"
    TIME_NOT_LATER = "time_not_later"


class StreamSuitOutcome(StrEnum):
    """Outcome of the muscles of a scenario in a frame; the first five are those of redundancy.FrameOutcome.

    CUFF_NOT_AT_REST  a cuff has no equilibrium in this posture, or has migrated beyond the shoulder point
    """

    SOLVED = "solved"
    BEYOND_ACTIVATION_RATE = "beyond_activation_rate"
    INFEASIBLE = "infeasible"
    NOT_CONVERGED = "not_converged"
    NOT_FINITE = "not_finite"
    CUFF_NOT_AT_REST = "cuff_not_at_rest"


class StreamNotice(StrEnum):
    """Limitations of a model that hold for the whole stream.

    NO_GLENOID_CONE         the model has no glenoid markers: muscles are solved without the glenoid constraint
    NO_GLENOHUMERAL_JOINT   the model has no such joint: the joint force is NaN
    """

    NO_GLENOID_CONE = "no_glenoid_cone"
    NO_GLENOHUMERAL_JOINT = "no_glenohumeral_joint"


@dataclass(frozen=True, eq=False)
class StreamSuitFrame:
    """Muscles and suit of one scenario in one frame; NaN where the outcome gives none.

    activations        (muscles,) 0 to 1, in the order of Model.muscles
    reserves           (actuators,) of Model.actuators [N or N m]
    cord_force_n       tension of the cord; 0 without a suit
    cuff_shift_m       (2,) distance of the waist and the arm cuff from where they were put on, migration included
    glenohumeral_force_n             (3,) on the scapula, in ground
    glenohumeral_force_in_glenoid_n  (3,) compression along the cone's axis, shear towards the edge marker, shear across
                                     it; NaN without a glenoid
    effort             Σ w a² of the muscles, by the exponent of the options;  reserve_effort Σ w x² of the actuators
    """

    outcome: StreamSuitOutcome
    activations: Array
    reserves: Array
    cord_force_n: float
    cuff_shift_m: Array
    glenohumeral_force_n: Array
    glenohumeral_force_in_glenoid_n: Array
    effort: float
    reserve_effort: float

    @property
    def is_solved(self) -> bool:
        """Whether activations and effort can be used."""
        return self.outcome in {StreamSuitOutcome.SOLVED, StreamSuitOutcome.BEYOND_ACTIVATION_RATE}


@dataclass(frozen=True, eq=False)
class StreamFrame:
    """One frame of the stream; coordinates in the order of Model.coordinates.

    time_s              as it was pushed
    outcome             of the kinematics
    coordinates         (coordinates,) smoothed q [rad or m];  speeds q̇ [per s];  accelerations q̈ [per s²]
    standard_deviations (3, coordinates) of the smoothed q, q̇, q̈ from the cameras' noise and soft tissue; infinite for a
                        coordinate that markers do not determine. Neither size of the body nor places of the markers
    covariance          (coordinates, coordinates) [rad or m]² of this frame's own posture from the same causes, before
                        smoothing; NaN without one
    marker_rms_m        root mean square distance of the visible markers from the model's
    hidden              names of markers without a position
    left_out            names of markers that jumped and were not used
    exchanged           pairs of markers whose exchanged labels were corrected
    lost                names of coordinates that were determined before and are not in this frame
    suits               name of a scenario → its muscles; empty where muscles were skipped or there are no coordinates
    """

    time_s: float
    outcome: StreamOutcome
    coordinates: Array
    speeds: Array
    accelerations: Array
    standard_deviations: Array
    covariance: Array
    marker_rms_m: float
    hidden: tuple[str, ...]
    left_out: tuple[str, ...]
    exchanged: tuple[tuple[str, str], ...]
    lost: tuple[str, ...]
    suits: Mapping[str, StreamSuitFrame]
