"""A fitted cuff as OpenSim's BushingForce, to paste into a model's ForceSet."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from fitting.result import CuffFit
from fitting.wearable_cuff import WearableCuff

MEASURED_ALONG = (
    "k and c were measured along one line of pull and stand for all three directions; the rotational ones are zero "
    "because nothing measured them. socket_frame1 is the frame the cuff sits on, socket_frame2 the cuff's own."
)


def bushing_force(fitted: CuffFit | WearableCuff) -> str:
    """An XML element, k in N/m and c in N s/m. Raises NotIdentified if a figure is missing."""
    wearable = fitted.wearable() if isinstance(fitted, CuffFit) else fitted
    cuff = wearable.parameters()
    stiffness, damping = (" ".join([repr(value)] * 3) for value in (cuff.stiffness, cuff.damping))
    return (
        f"<BushingForce name={quoteattr(f'{cuff.name}_cuff')}>\n"
        f"  <!-- {MEASURED_ALONG} -->\n"
        f"{''.join(f'  <!-- {remark} -->{chr(10)}' for remark in wearable.remarks)}"
        f"  <socket_frame1>/bodyset/{'humerus' if cuff.site == 'arm' else 'thorax'}</socket_frame1>\n"
        f"  <socket_frame2>/bodyset/{cuff.name}_cuff</socket_frame2>\n"
        "  <rotational_stiffness>0 0 0</rotational_stiffness>\n"
        f"  <translational_stiffness>{stiffness}</translational_stiffness>\n"
        "  <rotational_damping>0 0 0</rotational_damping>\n"
        f"  <translational_damping>{damping}</translational_damping>\n"
        "</BushingForce>\n"
    )
