"""Sentences as HTML, for the pages."""

from __future__ import annotations

import re
from html import escape

from jinja2.filters import do_mark_safe
from markupsafe import Markup


def with_commands(sentence: object) -> Markup:
    """A sentence as HTML, its `commands` as code."""
    text = str(sentence) if isinstance(sentence, Markup) else escape(str(sentence))
    return do_mark_safe(re.sub(r"`([^`]+)`", r"<code>\1</code>", text))
