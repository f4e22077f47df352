"""Sentences on markers that do not fit a model, and on postures from markers."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.codes import KinematicsCode

KINEMATICS: Mapping[StrEnum, str] = {
    KinematicsCode.NONE_IN_COMMON: (
        "{file} shares no marker with the model and the set-up: the set-up has {followed}, the model has {known}, "
        "the file has {found}; rename them, or give --prefix"
    ),
    KinematicsCode.SEVERAL_PERSONS: (
        "{file} has markers of several persons or sides ({labels}), expected those of one; choose with --prefix, or "
        "export one person"
    ),
    KinematicsCode.NO_SUCH_PREFIX: (
        "{file} has no label that is a marker's name after the prefix {prefix}; prefixes found: {found}; correct "
        "--prefix, or leave it out"
    ),
    KinematicsCode.MARKERS_MISSING: (
        "{file} shows {seen} of {expected} markers in most frames, expected at least 60 %; missing or mostly hidden: "
        "{missing}"
    ),
    KinematicsCode.ONE_IN_COMMON: (
        "{file} shares only the marker {name} with the model {model}, expected at least two; rename the others, or "
        "give --prefix"
    ),
    KinematicsCode.WRONG_SIZE: (
        "the markers of {file} are {size:.3g} times as far apart as those of {model}; correct the unit in the file"
    ),
    KinematicsCode.MIRRORED: (
        "the markers of {file} fit the mirror image of {model} ({mirrored_mm:.0f} mm RMS) better than the model itself "
        "({given_mm:.0f} mm): left and right, or some labels, are exchanged; correct the labels, or use a model of the "
        "other side"
    ),
    KinematicsCode.NO_FIT: (
        "the markers of {file} are {given_mm:.0f} mm (RMS) from those of {model}, expected less than "
        "{limit_mm:.0f} mm; check labels and unit, and that all are of one person"
    ),
    KinematicsCode.TILTED: (
        "the body is tilted by {tilt_deg:.0f} deg from its default posture; if the person stood upright, the vertical "
        "axis of the file is not y: give it with --vertical"
    ),
    KinematicsCode.EXCHANGED: (
        "labels {one} and {other} are exchanged from {from_s:.2f} to {to_s:.2f} s (intervals: {count}): the postures "
        "there are wrong; correct the labels"
    ),
    KinematicsCode.FAR: (
        "{marker} is up to {residual_mm:.0f} mm from its place on the model in {frames} frames, the first at "
        "{first_s:.2f} s: the postures there are wrong; delete these positions, or correct the label"
    ),
    KinematicsCode.NEVER_SEEN: (
        "no frame shows {markers}: not used; check the labels of the file, or remove the tasks"
    ),
    KinematicsCode.UNKNOWN_SET: "there is no marker set {name}; choose from {known}, or a file that ends in .toml",
    KinematicsCode.WRONG_SET: "{name} cannot be read as a marker set: {reason}",
    KinematicsCode.NO_BODY: (
        "marker set {set}: {marker} is attached to {body}, which {model} does not have; it has {known}"
    ),
    KinematicsCode.UNATTACHED: (
        "{markers}: {file} attaches them to bodies that the model does not have; they are not used"
    ),
    KinematicsCode.WITHOUT_PLACE: (
        "{markers}: the location in the model is unknown, so they are not used; give location_m in your own marker set"
    ),
    KinematicsCode.UNUSED_ELEMENTS: "{file} has elements that are not used: {elements}",
    KinematicsCode.FILE_ELSEWHERE: "{file} names files that are not there; those beside it are read: {files}",
    KinematicsCode.NOT_IN_MODEL: (
        "{names}: {file} names them, and the model or the markers' file does not have them; they are not used"
    ),
    KinematicsCode.ELSEWHERE: (
        "{markers}: the model attaches them to other bodies than the marker set; the model is used"
    ),
    KinematicsCode.WRONG_FACTOR: (
        "{body} would be scaled by {factor:.2f} with the markers of {file}, expected {least:g} to {most:g}; check the "
        "labels, and the pairs of markers in the set-up"
    ),
    KinematicsCode.WRONG_MANUAL_FACTOR: (
        "{body} has the manual factor {factor:.4g} in the set-up, expected {least:g} to {most:g}; correct its scales"
    ),
    KinematicsCode.OTHER_RANGE: (
        "--from and --to override the set-up's time_range, {setup_range_s} s: frames from {range_s} s are solved"
    ),
    KinematicsCode.RANGE_NOT_COVERED: (
        "{file} does not cover the requested time, {range}: it lasts from {first_s:g} to {last_s:g} s. Only its own "
        "frames are solved"
    ),
    KinematicsCode.NOT_HELD: (
        "no visible marker determines {coordinates} in {frames} frames: the values there are not measured"
    ),
    KinematicsCode.NOT_CONVERGED: "{frames} frames not converged, the first at {first_s:.2f} s",
    KinematicsCode.GAP_OPEN: "{frames} frames do not meet the constraints of the model, the first at {first_s:.2f} s",
    KinematicsCode.NO_MARKERS: "{frames} frames without markers, the first at {first_s:.2f} s",
}
