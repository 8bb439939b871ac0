"""What is asked of the middleware before the first node is made."""

from __future__ import annotations

import os
from pathlib import Path

PROFILES = "FASTDDS_DEFAULT_PROFILES_FILE"
OLDER_PROFILES = "FASTRTPS_DEFAULT_PROFILES_FILE"


def keep_types_to_itself() -> None:
    """Have Fast DDS match endpoints by the names of their types, unless the environment has profiles of its own.

    Fast DDS 3 asks the first participant that shows a type it does not know for its definition, once. Where that one
    leaves before it has answered, all endpoints of this type wait without end, those of the twin too
    (`TypeLookupManager::check_type_identifier_received`). ROS 2 compares names and hashes itself. A twin whose
    endpoints carry no definitions is matched at once, whatever the other side has set.
    """
    if PROFILES not in os.environ and OLDER_PROFILES not in os.environ:
        os.environ[PROFILES] = str(Path(__file__).with_name("fastdds.xml"))
