"""Records the functions that programs call which tests start. Python imports this module by itself if its folder is on the path.

Writes each function of the project at its first call, immediately, because most of these programs are killed in the end.
"""

import os
import sys
import threading
from pathlib import Path
from types import CodeType, FrameType

OPTIMIZED = 1
"""The flag of code objects of functions, as opposed to modules and class bodies."""


def note_calls(place: str, test: str) -> None:
    src = str(Path(__file__).parents[3] / "src") + os.sep
    noted: set[CodeType] = set()
    output = os.open(place, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)

    def record_call(frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event == "call" and code not in noted:
            noted.add(code)
            if code.co_flags & OPTIMIZED and code.co_filename.startswith(src):
                last_line = max(line for _, _, line in code.co_lines() if line is not None)
                os.write(output, f"{test}\t{code.co_filename.removeprefix(src)}\t{code.co_firstlineno}\t{last_line}\n".encode())

    threading.setprofile(record_call)
    sys.setprofile(record_call)


if "MUTANTS_CALLS" in os.environ and "MUTANTS_TEST" in os.environ:
    note_calls(os.environ["MUTANTS_CALLS"], os.environ["MUTANTS_TEST"])
