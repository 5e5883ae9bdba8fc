"""Where components run: their inputs and effects over sockets, timers and disks, or on virtual time in one process."""
