"""The logger of the package, which is silent unless a program adds a handler to it."""

from __future__ import annotations

import logging

#: Logs meshes, Newton iterations and other steps at the levels INFO and DEBUG.
logger = logging.getLogger("pvdf_fem")
logger.addHandler(logging.NullHandler())
