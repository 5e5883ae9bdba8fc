"""The runtime of components: inputs and effects over sockets, timers and disks, or on virtual time in one process."""
