"""The logger of the package: silent unless a program adds a handler to it."""

from __future__ import annotations

import logging

#: Meshes, Newton iterations and the like, at the levels INFO and DEBUG.
logger = logging.getLogger("pvdf_fem")
logger.addHandler(logging.NullHandler())
