"""Where the system is that the commands of people ask."""

from __future__ import annotations

import os
from pathlib import Path

from somrs.client.addresses import Addresses


async def site_addresses(data: Path) -> Addresses:
    """The addresses of the site on the bus that `SOMRS_BUS` names, or else of the system that runs with this data folder.

    Raises UsageError when it is not there.
    """
    return await site_on_bus() or Addresses.read(data)


async def site_on_bus() -> Addresses | None:
    """The addresses of the site on the bus that `SOMRS_BUS` names; None without the variable.

    `SOMRS_NAME` is the site's name, if there are several. Raises UsageError when it is not there.
    """
    if servers := os.environ.get("SOMRS_BUS"):
        from somrs.deployment.bus import find_site

        return await find_site(servers, os.environ.get("SOMRS_NAME"))
    return None
