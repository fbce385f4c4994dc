"""Makes README's pictures and its sample output, in about half a minute.

    python -m reports.gallery [FOLDER]

Each picture holds, in a text of its PNG file, the scenes and charges that it shows, so that
`tests/test_guide.py` notices when it is stale.
"""

from __future__ import annotations

import sys
from pathlib import Path

from reports.gallery.pictures import PICTURES, README, SAMPLE, make_sample, write_picture


def main(arguments: list[str]) -> int:
    """Write all pictures to a folder, by default README's."""
    folder = Path(arguments[0]) if arguments else Path(__file__).parent
    for name in PICTURES:
        print(write_picture(name, folder))
    text, printed = README.read_text("utf-8"), make_sample()
    README.write_text(SAMPLE.sub(lambda _: printed, text, count=1), "utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
