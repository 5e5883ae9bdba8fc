"""Programs end with the process that has started them, whenever that ends."""

from __future__ import annotations

import subprocess
import sys

PROGRAM = """
import asyncio, os, time
from somrs.deployment.programs import parent_process, until_stopped
reading, writing = os.pipe()
if os.fork():
    os.read(reading, 1)
    os._exit(0)
starter = parent_process()
os.write(writing, b".")
while os.getppid() == starter:
    time.sleep(0.01)
asyncio.run(until_stopped())
print("ended")
"""


def test_a_program_whose_starter_ends_while_it_starts_ends() -> None:
    assert subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=True).stdout == "ended\n"
