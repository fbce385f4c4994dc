"""``python -m pvdf_fem`` is ``pvdf-fem``."""

from pvdf_fem.cli import main

raise SystemExit(main())
